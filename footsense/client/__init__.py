"""Consumer's side of CAN: decodes frames, and decides whether each leg's force may be used.

::

    link         frames -> status, state, force, sigma, age of every leg     the same in C: firmware_interface/c
    gait_events  frames -> touchdowns, lift-offs and slips, each once        the same in C
    reports      frames -> cause, baseline, heartbeat, ground, calibration of every leg
    commands     tare, start, stop, and their results
    motions      motion of every leg -> frames                               the same in C

All is pure: nothing here opens a channel or reads a clock, and nothing but `firmware_interface` is imported.
"""

from footsense.client.commands import CommandAnswer, PendingCommands
from footsense.client.gait_events import GAIT_EVENT_IDS, GaitEvents, LegEvent
from footsense.client.link import LINK_IDS, LegForce, Link, LinkLimits, LinkStatus
from footsense.client.motions import Motions
from footsense.client.reports import REPORT_IDS, LegReport, Reports

__all__ = [
    "GAIT_EVENT_IDS",
    "LINK_IDS",
    "REPORT_IDS",
    "CommandAnswer",
    "GaitEvents",
    "LegEvent",
    "LegForce",
    "LegReport",
    "Link",
    "LinkLimits",
    "LinkStatus",
    "Motions",
    "PendingCommands",
    "Reports",
]
