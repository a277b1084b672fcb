"""What can go wrong on the CAN bus, and when, as parts of a scene."""

import math
from typing import Annotated

import msgspec
from msgspec import Meta

__all__ = ["CanBusOff", "CanDown", "CanFault", "CanNoAck", "CanQueueFull", "CanTraffic"]

_NS_PER_S = 1_000_000_000


class _CanFault(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="fault"):
    """A fault from `at_s` until `until_s`, or for good."""

    at_s: Annotated[float, Meta(ge=0.0)]
    until_s: Annotated[float, Meta(gt=0.0)] | None = None

    @property
    def at_ns(self) -> int:
        """When it begins [ns]."""
        return round(self.at_s * _NS_PER_S)

    @property
    def until_ns(self) -> float:
        """When it ends [ns]."""
        return math.inf if self.until_s is None else round(self.until_s * _NS_PER_S)


class CanNoAck(_CanFault, frozen=True, tag="can_no_ack"):
    """No other node is there to acknowledge: the plug is out, or the controller is switched off."""


class CanBusOff(_CanFault, frozen=True, tag="can_bus_off"):
    """CAN high and low are shorted: no bit gets through, and the controller goes bus-off again and again."""


class CanDown(_CanFault, frozen=True, tag="can_down"):
    """The interface is down; or gone, as an adapter that is unplugged and comes back as a new one."""

    unplugged: bool = False


class CanQueueFull(_CanFault, frozen=True, tag="can_queue_full"):
    """Another program on the same computer sends more than the bus takes, with the lowest priority."""

    rate_hz: Annotated[float, Meta(gt=0.0, le=100_000.0)] = 10_000.0


class CanTraffic(_CanFault, frozen=True, kw_only=True, tag="can_traffic"):
    """Another node sends frames of 8 bytes."""

    can_id: Annotated[int, Meta(ge=0, le=0x7FF)] = 0x080
    rate_hz: Annotated[float, Meta(gt=0.0, le=10_000.0)]


CanFault = CanNoAck | CanBusOff | CanDown | CanQueueFull | CanTraffic
