"""Files of a foot: network card, checksum, calibration."""
