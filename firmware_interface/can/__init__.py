"""Encoders and decoders of the CAN frames, equivalent to `footsense.dbc`.

force gait reports commands   the frames, by content; `all_legs`: forces of all legs in one frame of CAN FD
codes crc8                    what they share: states and causes, protection, checks of ids and codes
socketcan                     `struct can_frame` of Linux, and its error frames
"""
