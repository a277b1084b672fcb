"""Files of a foot: metadata card of the network, checksum trailer, calibration folder."""
