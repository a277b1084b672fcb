"""Progress bar of a simulation that runs as fast as possible."""

from contextlib import ExitStack

from footsense.frames import Cycle
from footsense.ports import Observer
from footsense.progress import progress_bar

_NS_PER_S = 1_000_000_000


class SimulationProgressBar(Observer):
    """Observer that shows the simulated time as a progress bar.

    Args:
        start_ns: Time at the start [ns].
        duration_s: Length of the run [s].
    """

    def __init__(self, start_ns: int, duration_s: float) -> None:
        self._stack = ExitStack()
        self._start_ns = start_ns
        self._shown_s = 0
        self._seconds_done = self._stack.enter_context(progress_bar("simulated", duration_s))

    def observe(self, cycle: Cycle) -> None:
        """Update the progress bar at each new second of simulated time."""
        now_s = (cycle.forces.t_sent_ns - self._start_ns) // _NS_PER_S
        if now_s != self._shown_s:
            self._shown_s = now_s
            self._seconds_done(now_s)

    def close(self) -> None:
        """Remove the progress bar."""
        self._stack.close()
