"""From a scan to forces: stray and baseline removed, gap closures normalised, one network call for all legs.

A leg whose value may not be used gets a state that says why, and NaN instead of a force.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.core import quality
from footsense.core.baseline import TareLimits, TareWindow, Verdict
from footsense.core.design import CapacitorDesign
from footsense.core.skew import SkewRemoval
from footsense.frames import (
    ELEMENTS,
    CapFrame,
    Command,
    CommandKind,
    Flag,
    ForceFrame,
    Outcome,
    Result,
    State,
)
from footsense.ports import Estimator

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What the network's card says about its inputs and outputs.

    Attributes:
        design: The capacitors that it was trained for.
        closure_rel_min: Smallest trained input of each element [1], shape (9,).
        closure_rel_max: Largest trained input of each element [1], shape (9,).
        sigma_floor_n: Standard deviation of each component at zero load [N], shape (3,).
        sigma_rel: What each newton of load adds to it [1], shape (3,).
    """

    design: CapacitorDesign
    closure_rel_min: Vector
    closure_rel_max: Vector
    sigma_floor_n: Vector
    sigma_rel: Vector


class Pipeline:
    """Turns scans into forces, and keeps each leg's baseline.

    Args:
        estimator: The network.
        calibration: What its card says.
        stray_pf: Known capacitance in parallel with each element [pF], shape (legs, 9).
        tare: When a tare is granted.
        max_age_ns: Age from which a measurement may not be used any more [ns].
        flags: Flags that every frame carries.
    """

    def __init__(
        self,
        estimator: Estimator,
        calibration: Calibration,
        stray_pf: Vector,
        tare: TareLimits,
        max_age_ns: int,
        flags: int = 0,
    ) -> None:
        self._estimator = estimator
        self._calibration = calibration
        self._stray_pf = stray_pf
        self._tare_limits = tare
        self._max_age_ns = max_age_ns
        n_legs = len(stray_pf)
        #: Unloaded capacitance without stray [pF], NaN until a tare has succeeded.
        self._baseline_pf = np.full((n_legs, ELEMENTS), np.nan)
        self._unloaded_pf = np.full((n_legs, ELEMENTS), calibration.design.rest_pf)
        self._skew = SkewRemoval(n_legs, ELEMENTS)
        self._stopped = np.zeros(n_legs, bool)
        self._flags = np.full(n_legs, flags, np.uint8)
        # Every leg is tared at start, again and again until that succeeds.
        self._windows: dict[int, TareWindow] = {leg: TareWindow(tare) for leg in range(n_legs)}
        self._commanded: set[int] = set()
        self._last_refusal: dict[int, Result] = {}

    def obey(self, command: Command) -> Outcome | None:
        """Begin what a command asks for; a tare ends in a later scan, the rest at once."""
        if command.kind is CommandKind.TARE:
            self._windows[command.leg] = TareWindow(self._tare_limits)
            self._commanded.add(command.leg)
            return None
        self._stopped[command.leg] = command.kind is CommandKind.STOP
        return Outcome(command, Result.DONE, f"{command.kind.name.lower()} obeyed")

    def process(self, scan: CapFrame, now_ns: int) -> tuple[ForceFrame, tuple[Outcome, ...]]:
        """Return the forces of a scan as of `now_ns`, and the tares that ended with it."""
        # A code of zero divides by zero; what comes of it is judged like any other reading.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return self._process(scan, now_ns)

    def _process(self, scan: CapFrame, now_ns: int) -> tuple[ForceFrame, tuple[Outcome, ...]]:
        capacitance_pf = scan.capacitance_pf - self._stray_pf
        outcomes = self._tare(capacitance_pf) if self._windows else ()
        calibration = self._calibration
        closure_rel = (
            calibration.design.closure_um(capacitance_pf, self._baseline_pf) / calibration.design.gap_um
        )
        closure_rel = self._skew.apply(closure_rel, scan.t_ns)
        # NaN compares as False: an element that was not read is neither open, shut nor out of range.
        opened = quality.open_elements(capacitance_pf, self._unloaded_pf)
        shut = closure_rel > quality.SHUT_REL
        outside = (closure_rel < calibration.closure_rel_min) | (closure_rel > calibration.closure_rel_max)

        state = np.full(len(capacitance_pf), State.VALID, np.uint8)
        state[outside.any(axis=1)] = State.OUT_OF_RANGE
        state[now_ns - scan.t_ns.min(axis=1) > self._max_age_ns] = State.STALE
        self._mark_untared(state)
        quality.converter_states(state, scan.reading, opened, shut)
        state[self._stopped] = State.STOPPED

        valid = state == State.VALID
        force_n = self._estimator.estimate(np.where(valid[:, None], closure_rel, 0.0))
        force_n[~valid] = np.nan
        magnitude_n = np.sqrt((force_n * force_n).sum(axis=1, keepdims=True))
        return ForceFrame(
            sequence=scan.sequence,
            t_sent_ns=now_ns,
            t_ns=np.where(scan.t_ns.min(axis=1) > 0, scan.t_ns.sum(axis=1) // ELEMENTS, 0),
            force_n=force_n,
            sigma_n=calibration.sigma_floor_n + calibration.sigma_rel * magnitude_n,
            state=state,
            fault_mask=quality.fault_mask((scan.reading != 0) | opened | shut),
            flags=self._flags.copy(),
        ), outcomes

    def _mark_untared(self, state: NDArray[np.uint8]) -> None:
        untared = np.isnan(self._baseline_pf[:, 0])
        if untared.any():
            state[untared] = State.TARING
            state[[leg for leg in np.flatnonzero(untared).tolist() if leg in self._last_refusal]] = (
                State.NO_BASELINE
            )

    def _tare(self, capacitance_pf: Vector) -> tuple[Outcome, ...]:
        outcomes = []
        for leg, window in list(self._windows.items()):
            verdict = window.add(capacitance_pf[leg], self._unloaded_pf[leg])
            if verdict is None:
                continue
            outcome = self._conclude(leg, verdict)
            if outcome is not None:
                outcomes.append(outcome)
        return tuple(outcomes)

    def _conclude(self, leg: int, verdict: Verdict) -> Outcome | None:
        """Take or refuse a baseline; a first tare that is refused begins anew, and says so once per reason."""
        del self._windows[leg]
        commanded = leg in self._commanded
        repeated = self._last_refusal.get(leg) is verdict.result
        self._commanded.discard(leg)
        if verdict.baseline_pf is not None:
            self._baseline_pf[leg] = self._unloaded_pf[leg] = verdict.baseline_pf
            self._last_refusal.pop(leg, None)
            self._flags[leg] &= ~np.uint8(Flag.TARE_REFUSED)
        else:
            self._last_refusal[leg] = verdict.result
            if np.isnan(self._baseline_pf[leg, 0]):
                self._windows[leg] = TareWindow(self._tare_limits)
            else:
                self._flags[leg] |= Flag.TARE_REFUSED
        if repeated and not commanded:
            return None
        return Outcome(Command(CommandKind.TARE, leg), verdict.result, verdict.reason)
