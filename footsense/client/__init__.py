"""Consumer's side of CAN: decodes frames, decides whether each leg's force may be used, and connects to a service.

::

    link         frames -> status, state, force, sigma, age of every leg     the same in C: firmware_interface/c
    gait_events  frames -> touchdowns, lift-offs and slips, each once        the same in C
    reports      frames -> cause, baseline, heartbeat, ground, calibration of every leg
    commands     tare, start, stop, and their results
    motions      motion of every leg -> frames                               the same in C

All that is pure: it opens no channel and reads no clock, and imports nothing but `firmware_interface`.
`footsense.connect` is made of it:

::

    feet         connect(...) -> Feet: forces and events of a running service
    listener     receives all frames of a channel, for `feet`, `footsense monitor` and `footsense ros2`
    commander    sends commands and waits for their answers, for `feet` and `footsense tare`
    events       FootEvent

The wheel `footsense-client` is this folder and what it imports (`deploy/client`); it needs python-can alone.
"""

from firmware_interface.can.codes import StepPhase
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
    "StepPhase",
]
