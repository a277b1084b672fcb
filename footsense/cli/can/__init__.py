"""Commands that receive forces from CAN, besides `footsense monitor`."""
