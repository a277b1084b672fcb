"""What a gait controller asks of a foot: contact and its times, load share, ground normal, friction, slip."""
