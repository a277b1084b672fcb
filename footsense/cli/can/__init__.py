"""Commands that listen on CAN, beside `footsense monitor`."""
