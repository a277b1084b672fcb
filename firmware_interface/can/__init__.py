"""Encoders and decoders of the CAN frames, equivalent to `footsense.dbc`.

force gait reports commands   the frames, by content; `all_legs`: forces of all legs in one frame of CAN FD
codes crc8 signals            what they share: states and causes, protection, codecs from tables of signals
socketcan                     `struct can_frame` of Linux, and its error frames
"""
