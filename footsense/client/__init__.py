"""For whoever uses the forces: frames as they come from CAN in, forces that may be used out.

link       frames -> status, state, force, sigma, age of every leg     pure; the same in C: firmware_interface/c
reports    frames -> cause, zero and heartbeat of every leg               pure
commands   tare, start, stop, and the answers to them                  pure

Nothing here opens a channel or reads a clock, and nothing but `firmware_interface` is imported.
"""

from footsense.client.commands import Commands, Ended
from footsense.client.link import LINK_IDS, Limits, Link, Status, View
from footsense.client.reports import REPORT_IDS, Report, Reports

__all__ = [
    "LINK_IDS",
    "REPORT_IDS",
    "Commands",
    "Ended",
    "Limits",
    "Link",
    "Report",
    "Reports",
    "Status",
    "View",
]
