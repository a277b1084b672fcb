"""Encoders and decoders of the CAN frames, equivalent to `footsense.dbc`.

force gait reports commands   the frames, by content
codes crc8 signals            what they share: states and causes, protection, codecs from tables of signals
socketcan                     `struct can_frame` of Linux, and its error frames

The id of a leg's frame is 0x100 + 8 * kind + node (1..8), the kinds in the order of their priority.
All are between 0x101 and 0x17F, which CANopen devices of any node id leave free.

Source:
    CiA 301, table of restricted CAN-IDs.
"""
