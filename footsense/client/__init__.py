"""The consumer's end of CAN: frames in, forces that may be used out.

link       frames -> status, state, force, sigma, age of every leg     pure; the same in C: firmware_interface/c
reports    frames -> cause, baseline and heartbeat of every leg           pure
commands   tare, start, stop, and their results                        pure

Nothing here opens a channel or reads a clock, and nothing but `firmware_interface` is imported.
"""

from footsense.client.commands import CommandResult, PendingCommands
from footsense.client.link import LINK_IDS, LegForce, Link, LinkLimits, LinkStatus
from footsense.client.reports import REPORT_IDS, LegReport, Reports

__all__ = [
    "LINK_IDS",
    "REPORT_IDS",
    "CommandResult",
    "LegForce",
    "LegReport",
    "Link",
    "LinkLimits",
    "LinkStatus",
    "PendingCommands",
    "Reports",
]
