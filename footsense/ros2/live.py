"""Samples of the legs received from CAN, for live messages."""

import math
from collections.abc import Sequence

from firmware_interface.can.codes import NODE_IDS
from footsense.client import LegEvent
from footsense.client.listener import LegSnapshot
from footsense.ros2.messages import LegSample

#: Period of the contact states [ns]: that of `Ground` on CAN.
_CONTACT_PERIOD_NS = 100_000_000


class LiveSamples:
    """Turns the values received from CAN into samples of the legs; knows which of them are new."""

    def __init__(self) -> None:
        self._n_frames: dict[str, int] = {}
        self._contact_ns = -math.inf

    def samples(
        self, snapshots: Sequence[LegSnapshot], events: Sequence[LegEvent], wall_ns: int, now_ns: int
    ) -> list[LegSample]:
        """Return a sample of each leg.

        Args:
            snapshots: The legs.
            events: The gait events received since the samples before.
            wall_ns: The present time, since 1970 [ns].
            now_ns: The present time on the clock of the events [ns].
        """
        contacts_due = now_ns - self._contact_ns >= _CONTACT_PERIOD_NS
        if contacts_due:
            self._contact_ns = now_ns
        samples = []
        for snapshot in snapshots:
            leg, n_frames = snapshot.leg, snapshot.n_force_frames
            told = [
                (event.kind, None if event.t_ns is None else wall_ns - now_ns + event.t_ns)
                for event in events
                if event.node == NODE_IDS[leg]
            ]
            samples.append(
                _live_sample(snapshot, wall_ns)._replace(
                    is_new_force=n_frames != self._n_frames.get(leg),
                    is_new_contact=contacts_due or bool(told),
                    events=told,
                )
            )
            self._n_frames[leg] = n_frames
        return samples


def _live_sample(snapshot: LegSnapshot, wall_ns: int) -> LegSample:
    leg, force, report = snapshot.leg, snapshot.force, snapshot.report
    if not snapshot.is_current:
        return LegSample(leg)
    sample = LegSample(
        leg,
        state=force.state,
        cause=report.fault.cause if report.fault and report.fault.state is force.state else None,
        force_n=force.force_n,
        sigma_n=force.sigma_n,
        fault_mask=force.fault_mask,
        contact=force.contact,
        contact_probability=force.contact_probability,
        holds=force.holds,
        baseline_status=report.baseline.status if report.baseline else None,
    )
    if force.usable and force.age_ns is not None:
        sample = sample._replace(t_wall_ns=wall_ns - force.age_ns, age_ms=force.age_ns * 1e-6)
    if report.ground is not None:
        sample = sample._replace(
            ground_normal=report.ground.normal, friction_coefficient=report.ground.friction
        )
    return sample
