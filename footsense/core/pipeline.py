"""From a scan to forces: stray and baseline removed, gap closures normalised, one network call for all legs.

A leg whose value may not be used gets a state that says why, and NaN instead of a force.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.core import quality
from footsense.core.baseline import Baselines, TareLimits
from footsense.core.design import CapacitorDesign
from footsense.core.filling import Filling
from footsense.core.skew import SkewRemoval
from footsense.frames import (
    ELEMENTS,
    USABLE,
    CapFrame,
    Command,
    CommandKind,
    ForceFrame,
    Outcome,
    Result,
    State,
    Zero,
)
from footsense.ports import Estimator

Vector = NDArray[np.float64]

_USABLE = np.array(sorted(USABLE), np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What the network's card says about its inputs and outputs.

    Attributes:
        design: The capacitors that it was trained for.
        closure_rel_min: Smallest trained input of each element [1], shape (9,).
        closure_rel_max: Largest trained input of each element [1], shape (9,).
        moments: Second moments of the closures, for filling in missing ones, shape (9, 9).
    """

    design: CapacitorDesign
    closure_rel_min: Vector
    closure_rel_max: Vector
    moments: Vector


class Pipeline:
    """Turns scans into forces, and keeps each leg's baseline.

    Args:
        estimator: The network, for twice the legs: each leg's force is estimated two ways to know its error.
        calibration: What its card says.
        stray_pf: Known capacitance in parallel with each element [pF], shape (legs, 9).
        unloaded_pf: What each element of the free foot is expected to read, without stray [pF], shape (legs, 9).
        tare: When a tare is granted.
        max_age_ns: Age from which a measurement may not be used any more [ns].
        flags: Flags that every frame carries.
    """

    def __init__(
        self,
        estimator: Estimator,
        calibration: Calibration,
        stray_pf: Vector,
        unloaded_pf: Vector,
        tare: TareLimits,
        max_age_ns: int,
        flags: int = 0,
    ) -> None:
        self._estimator = estimator
        self._calibration = calibration
        self._filling = Filling(calibration.moments)
        self._stray_pf = stray_pf
        self._unloaded_pf = unloaded_pf
        self._max_age_ns = max_age_ns
        self._flags = flags
        n_legs = len(stray_pf)
        self._baselines = Baselines(unloaded_pf, tare)
        self._skew = SkewRemoval(n_legs, ELEMENTS)
        self._opened = np.zeros((n_legs, ELEMENTS), bool)
        self._stopped = np.zeros(n_legs, bool)

    def obey(self, command: Command) -> Outcome | None:
        """Begin what a command asks for; a tare ends in a later scan, the rest at once."""
        if command.kind is CommandKind.TARE:
            self._baselines.begin(command.leg)
            return None
        self._stopped[command.leg] = command.kind is CommandKind.STOP
        return Outcome(command, Result.DONE, f"{command.kind.name.lower()} obeyed")

    def process(self, scan: CapFrame, now_ns: int) -> tuple[ForceFrame, tuple[Outcome, ...]]:
        """Return the forces of a scan as of `now_ns`, and the tares that ended with it."""
        # A code of zero divides by zero; what comes of it is judged like any other reading.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return self._process(scan, now_ns)

    def _process(self, scan: CapFrame, now_ns: int) -> tuple[ForceFrame, tuple[Outcome, ...]]:
        calibration, design = self._calibration, self._calibration.design
        capacitance_pf = scan.capacitance_pf - self._stray_pf
        outcomes = self._baselines.observe(capacitance_pf, scan.reading)
        # NaN compares as False: an element that was not read is neither open, shut nor out of range.
        opened = quality.open_elements(capacitance_pf, self._unloaded_pf)
        missing = quality.missing_elements(opened)
        if opened.any():
            capacitance_pf = capacitance_pf - quality.floating_pf(scan.capacitance_pf, opened)
        # A line that breaks or returns was whole for a part of the scan, and what it does to the other elements too.
        unsettled = opened | (opened != self._opened).any(axis=1, keepdims=True)
        self._opened = opened
        # Moved to one time as distances, which do not jump when a tare moves the baseline. What is open or unsettled
        # has none: a line through its last one would take the element's return for a load.
        distance_um = np.where(unsettled, np.nan, design.plate_distance_um(capacitance_pf))
        aligned = self._skew.apply(distance_um, scan.t_ns, missing)
        rest_um = design.plate_distance_um(self._baselines.baseline_pf)
        closure_rel = (rest_um - aligned.values) / design.gap_um

        shut = closure_rel > quality.SHUT_REL
        outside = (closure_rel < calibration.closure_rel_min) | (closure_rel > calibration.closure_rel_max)
        oldest_ns = scan.t_ns.min(axis=1)

        state = np.full(len(capacitance_pf), State.VALID, np.uint8)
        state[missing.any(axis=1)] = State.DEGRADED
        state[(outside & ~missing).any(axis=1)] = State.OUT_OF_RANGE
        state[(now_ns - oldest_ns > self._max_age_ns) | ~aligned.together] = State.STALE
        self._baselines.mark_untared(state)
        quality.converter_states(state, scan.reading, opened & ~missing, shut & ~missing)
        state[self._stopped] = State.STOPPED

        coarser_rel = (rest_um - aligned.coarser) / design.gap_um
        force_n, sigma_n = self._estimate(state, missing, closure_rel, coarser_rel)
        return ForceFrame(
            sequence=scan.sequence,
            t_sent_ns=now_ns,
            t_ns=np.where(oldest_ns > 0, scan.t_ns.sum(axis=1) // ELEMENTS, 0),
            force_n=force_n,
            sigma_n=sigma_n,
            state=state,
            fault_mask=quality.fault_mask((scan.reading != 0) | opened | shut),
            flags=self._baselines.flags | np.uint8(self._flags),
            cause=np.zeros(len(state), np.uint8),
            zero=Zero.none(len(state)),
        ), outcomes

    def _estimate(
        self, state: NDArray[np.uint8], missing: NDArray[np.bool_], closure_rel: Vector, coarser_rel: Vector
    ) -> tuple[Vector, Vector]:
        """Return force and sigma [N], shape (legs, 3), NaN where `state` is not or no longer usable.

        Sigma is the network's own on a load at rest, and what the removal of skew may have left in motion.
        """
        usable = np.isin(state, _USABLE)
        both_missing = np.concatenate((missing, missing))
        both_rel = np.where(
            np.concatenate((usable, usable))[:, None], np.concatenate((closure_rel, coarser_rel)), 0.0
        )
        both_n, both_sigma_n = self._estimator.estimate(
            self._filling.fill(both_rel, both_missing), both_missing
        )
        force_n, coarser_n = both_n[: len(state)], both_n[len(state) :]
        sigma_n = np.hypot(both_sigma_n[: len(state)], force_n - coarser_n)
        nowhere = usable & ~(np.isfinite(force_n) & np.isfinite(sigma_n)).all(axis=1)
        state[nowhere] = State.OUT_OF_RANGE
        unknown = ~usable | nowhere
        force_n[unknown] = sigma_n[unknown] = np.nan
        return force_n, sigma_n
