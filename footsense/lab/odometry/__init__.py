"""What a robot gains of its feet: its odometry, with contact from different sensors."""
