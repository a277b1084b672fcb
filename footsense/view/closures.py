"""Gap closures of all elements from readings and baselines, as the estimation computes them."""

from collections import deque

import numpy as np

from footsense.daemon.recording_header import ClosureConversion
from footsense.frames import CommandKind, Cycle, Result, Vector


class ClosureConverter:
    """Converts readings and baselines of all legs into gap closures.

    Args:
        conversion: Parameters of the elements.
    """

    def __init__(self, conversion: ClosureConversion) -> None:
        self.stray_pf = np.array(conversion.stray_pf)
        self._distance_times_capacitance_pf = np.array(conversion.distance_times_capacitance_pf)

    @np.errstate(divide="ignore", invalid="ignore")
    def closure_rel(self, cycle: Cycle, baseline_pf: Vector) -> Vector:
        """Return the closures over the gap [1], shape (legs, elements); NaN without reading or baseline.

        Args:
            cycle: The cycle with the readings.
            baseline_pf: Unloaded reading of each element, without stray [pF], shape (legs, elements).
        """
        reading_pf = cycle.scan.capacitance_pf - self.stray_pf
        closure_rel: Vector = self._distance_times_capacitance_pf * (1.0 / baseline_pf - 1.0 / reading_pf)
        return closure_rel


class ReconstructedBaselines:
    """Baselines of a recording, reconstructed from tares and mean drift, as recordings do not contain them.

    A tare is the mean of the scans before its result. Drift tracking moves the elements of a leg nearly alike: its
    mean is added to each.

    Args:
        stray_pf: Capacitance in parallel with each element [pF], shape (legs, elements).
        window_scans: Scans that a tare averages.
    """

    def __init__(self, stray_pf: Vector, window_scans: int) -> None:
        self._stray_pf = stray_pf
        self._tared_pf = np.full(stray_pf.shape, np.nan)
        self._windows = [deque[Vector](maxlen=window_scans) for _ in stray_pf]
        self._newest_ns = [0] * len(stray_pf)

    def baseline_pf_after(self, cycle: Cycle) -> Vector:
        """Return the baselines after the next cycle, without stray [pF], shape (legs, elements).

        Returns:
            The baselines, shape (legs, elements), NaN before the first tare.
        """
        scan = cycle.scan
        oldest, newest = scan.t_ns.min(axis=1).tolist(), scan.t_ns.max(axis=1).tolist()
        for leg, window in enumerate(self._windows):
            if oldest[leg] > self._newest_ns[leg]:  # every element has been read anew
                self._newest_ns[leg] = newest[leg]
                window.append(scan.capacitance_pf[leg] - self._stray_pf[leg])
        for outcome in cycle.ended_commands:
            if outcome.command.kind is CommandKind.TARE and outcome.result is Result.DONE:
                leg = outcome.command.leg
                self._tared_pf[leg] = np.mean(self._windows[leg], axis=0)
        drift_pf = np.nan_to_num(cycle.forces.baseline.mean_pf)
        return self._tared_pf + drift_pf[:, None]
