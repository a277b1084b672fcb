"""An observer that keeps systemd informed: ready with the first forces, alive while cycles come."""

from footsense.frames import Cycle, Flag, State
from footsense.telemetry.systemd import SystemdNotifier, watchdog_interval_ns

_STATUS_PERIOD_NS = 10_000_000_000


class Supervision:
    """Tells systemd what it needs to know; without systemd it does nothing.

    Args:
        notifier: The way to systemd.
        legs: Names of the legs in the order of the frames' rows.
    """

    def __init__(self, notifier: SystemdNotifier, legs: tuple[str, ...]) -> None:
        self._notifier = notifier
        self._legs = legs
        self._interval_ns = watchdog_interval_ns()
        self._alive_ns: int | None = None
        self._status_ns = 0

    def observe(self, cycle: Cycle) -> None:
        """Report the first cycle as readiness, and later ones as a sign of life when one is due."""
        now_ns = cycle.forces.t_sent_ns
        if self._alive_ns is None:
            self._notifier.ready(self._status(cycle))
            self._alive_ns = self._status_ns = now_ns
        if self._interval_ns is not None and now_ns - self._alive_ns >= self._interval_ns:
            self._notifier.watchdog()
            self._alive_ns = now_ns
        if now_ns - self._status_ns >= _STATUS_PERIOD_NS:
            self._notifier.status(self._status(cycle))
            self._status_ns = now_ns

    def close(self) -> None:
        """Say that the service ends because it was asked to."""
        self._notifier.stopping()
        self._notifier.close()

    def _status(self, cycle: Cycle) -> str:
        states = zip(self._legs, cycle.forces.state.tolist(), strict=True)
        status = ", ".join(f"{leg} {State(state).name.lower()}" for leg, state in states)
        degraded = any(flags & Flag.DEGRADED_TIMING for flags in cycle.forces.flags.tolist())
        return f"degraded timing; {status}" if degraded else status
