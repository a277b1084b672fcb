"""Live ROS 2 messages of the legs received from CAN, in wall-clock time."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from footsense.daemon.can_listener import LegSnapshot
from footsense.ros2.leg_messages import LegSample
from footsense.ros2.topics import DIAGNOSTICS_PERIOD_NS, TopicMessage, TopicMessageBuilder

if TYPE_CHECKING:
    from footsense.client import LegEvent

#: Period of the contacts [ns]: that of `Gait` and `Ground` on CAN.
_CONTACT_MESSAGE_PERIOD_NS = 100_000_000


def live_sample(snapshot: LegSnapshot, wall_ns: int) -> LegSample:
    """Return a leg's state, force and contact as a sample, from the values received on CAN.

    Args:
        snapshot: The leg.
        wall_ns: The present time, since 1970 [ns].
    """
    leg, force, report = snapshot.leg, snapshot.force, snapshot.report
    if not snapshot.is_current:
        return LegSample(leg)
    sample = LegSample(
        leg,
        state=force.state,
        cause=report.cause if report.cause_state is force.state else None,
        force_n=force.force_n,
        sigma_n=force.sigma_n,
        fault_mask=force.fault_mask,
        baseline_status=report.baseline,
    )
    if force.usable and force.age_ns is not None:
        sample = sample._replace(t_wall_ns=wall_ns - force.age_ns, age_ms=force.age_ns * 1e-6)
    if report.gait is not None:
        sample = sample._replace(contact=report.gait.contact, slip=report.gait.slip)
    if report.ground is not None:
        sample = sample._replace(
            ground_normal=report.ground.normal, friction_coefficient=report.ground.friction
        )
    return sample


class LiveMessages:
    """Decides which ROS 2 messages of the legs are due, and builds them.

    Args:
        topics: The messages of the legs.
    """

    def __init__(self, topics: TopicMessageBuilder) -> None:
        self._topics = topics
        self._n_frames: dict[str, int] = {}
        self._events: dict[str, LegEvent | None] = {}
        self._states: list[object] = []
        self._contact_ns = self._diagnosed_ns = -math.inf

    def due_messages(self, snapshots: Sequence[LegSnapshot], wall_ns: int, now_ns: int) -> list[TopicMessage]:
        """Return the messages due now: a wrench for each new force, contact and diagnostics periodically.

        Args:
            snapshots: The legs.
            wall_ns: The present time, since 1970 [ns].
            now_ns: The present time on a clock that does not step [ns].
        """
        messages = self._topics.transforms(wall_ns) if self._diagnosed_ns < 0 else []
        contacts_due = now_ns - self._contact_ns >= _CONTACT_MESSAGE_PERIOD_NS
        samples = [live_sample(snapshot, wall_ns) for snapshot in snapshots]
        for snapshot, sample in zip(snapshots, samples, strict=True):
            leg = snapshot.leg
            if snapshot.n_force_frames != self._n_frames.get(leg):
                self._n_frames[leg] = snapshot.n_force_frames
                messages += self._topics.wrench(sample)
            if contacts_due or snapshot.event is not self._events.get(leg):
                self._events[leg] = snapshot.event
                messages.append(self._topics.contact(sample))
        if contacts_due:
            self._contact_ns = now_ns
        states = [(sample.state, sample.cause) for sample in samples]
        if states != self._states or now_ns - self._diagnosed_ns >= DIAGNOSTICS_PERIOD_NS:
            self._states, self._diagnosed_ns = list(states), now_ns
            messages.append(self._topics.diagnostics(samples, wall_ns))
        return messages
