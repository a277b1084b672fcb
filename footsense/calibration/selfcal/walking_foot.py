"""One foot of a robot that walks: its scans in, what is known of its electrodes out."""

import math
from dataclasses import replace

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.selfcal.instants import Instants, LegScans, StanceSampler
from footsense.calibration.selfcal.judgement import MAX_INSTANTS, Turn, judge_electrodes
from footsense.calibration.selfcal.state import FootIdentity, KeptInstants, SelfcalState
from footsense.calibration.selfcal.walking_fit import (
    INSTANTS_PER_FIT,
    electrodes_before_walking,
    fit_instants,
    wandered,
)
from footsense.calibration.standing.fit import N_ELECTRODE_PARAMETERS
from footsense.foot.parameters import FootParameters

#: Instants of the first half minute or so, of which every stance is used; then those of a fit in every so many [ns].
N_FAST, _PERIOD_NS = 120, 30_000_000_000
_NS_PER_MINUTE = 60e9
#: Largest share of stances in which an element is beyond its range, or open [1].
_MAX_SATURATED_REL = 0.3
#: Mean angle of a direction error over the standard deviation of each of its two components [1].
_MEAN_OVER_SIGMA = math.sqrt(math.pi / 2.0)


class WalkingFoot:
    """A foot whose electrodes are found while it walks.

    Args:
        models: Models of its type.
        of: What it is.
        known: Its calibration in use, else the parameters by which the service reads it.
        expected_deg: Direction error to expect with these by their electrodes, mean over loads [deg].
        state: Its state of an earlier time; None to begin anew.
        slept_min: Time since then [min].

    Attributes:
        of: What it is.
        known: The parameters in use.
        expected_deg: As given.
        electrodes: What is known of the electrodes.
        n_instants: Instants so far.
        turn: By how much they turn forces against those in use; None before the first fit.
        objection: Why they are not proposed as a calibration; empty if they are.
    """

    def __init__(
        self,
        models: DesignModels,
        of: FootIdentity,
        known: FootParameters,
        expected_deg: float,
        state: SelfcalState | None = None,
        slept_min: float = 0.0,
    ) -> None:
        self._models, self.of, self.known, self.expected_deg = models, of, known, expected_deg
        design = models.response.design
        self._before = electrodes_before_walking(design, known, calibrated=bool(of.calibration))
        self._sampler = StanceSampler(known.unloaded_pf)
        self._waiting, self._last_ns = Instants.joined([]), 0
        self.electrodes, self._kept, self.n_instants = self._before, Instants.joined([]), 0
        self._saturated_before_rel = 0.0
        self.turn: Turn | None = None
        self.objection = ""
        if state is not None:
            self.electrodes = wandered(state.electrodes(), slept_min)
            self._kept, self.n_instants = state.kept.instants(), state.n_instants
            self._saturated_before_rel = state.saturated_rel
            if state.turn_deg is not None and state.turn_sigma_deg is not None:
                self.turn = Turn(state.turn_deg, state.turn_sigma_deg)
            self.objection = state.objection

    @property
    def saturated_rel(self) -> float:
        """Share of the stances in which an element was beyond its range, or open [1]."""
        n_stances = self._sampler.n_stances
        return self._sampler.n_saturated / n_stances if n_stances else self._saturated_before_rel

    @property
    def is_proposed(self) -> bool:
        """Whether nothing speaks against taking its electrodes into use, and it has a name."""
        return self.turn is not None and not self.objection and bool(self.of.foot)

    def add(self, scans: LegScans) -> None:
        """Use the stances that end within further scans."""
        pause_ns = _PERIOD_NS if self.n_instants >= N_FAST else 0
        found = self._sampler.add(scans, self._last_ns + pause_ns)
        self._waiting = Instants.joined([self._waiting, found])
        while len(self._waiting.t_ns) >= INSTANTS_PER_FIT:
            some = self._waiting.subset(slice(INSTANTS_PER_FIT))
            self._waiting = self._waiting.subset(slice(INSTANTS_PER_FIT, None))
            self._use(some)

    def _use(self, instants: Instants) -> None:
        now_ns = int(instants.t_ns[-1])
        if self._last_ns:
            self.electrodes = wandered(self.electrodes, (now_ns - self._last_ns) / _NS_PER_MINUTE)
        is_first = self.n_instants == 0 and not self.of.calibration
        self.electrodes, _ = fit_instants(self._models, self.electrodes, instants, first=is_first)
        self._last_ns, self.n_instants = now_ns, self.n_instants + len(instants.t_ns)
        self._kept = Instants.joined([self._kept, instants]).subset(slice(-MAX_INSTANTS, None))

    def judge(self) -> None:
        """Compute turn and objection anew; takes some tenths of a second."""
        if self.n_instants:
            found = self._models, self._before, self.electrodes, self._kept
            self.turn, self.objection = judge_electrodes(*found, self.expected_deg)
            if (share := self.saturated_rel) > _MAX_SATURATED_REL:
                self.objection = f"an element is beyond its range or open in {share:.0%} of the stances"

    def state(self, written: str) -> SelfcalState:
        """Return its state.

        Args:
            written: Time, UTC, ISO 8601.
        """
        return SelfcalState(
            of=self.of,
            written=written,
            n_instants=self.n_instants,
            saturated_rel=self.saturated_rel,
            turn_deg=self.turn and self.turn.deg,
            turn_sigma_deg=self.turn and self.turn.sigma_deg,
            objection=self.objection,
            parameters=tuple(self.electrodes.parameters[:N_ELECTRODE_PARAMETERS].tolist()),
            floor_pf=tuple(self.electrodes.floor_pf.tolist()),
            covariance=tuple(map(tuple, self.electrodes.covariance.tolist())),
            kept=KeptInstants.of(self._kept),
        )

    def parameters(self) -> FootParameters:
        """Return the parameters of the foot with the electrodes that were found; stiffness and mount are as known."""
        unknown_rel = np.radians(self.turn.sigma_deg) / _MEAN_OVER_SIGMA if self.turn else 0.0
        unloaded_pf = np.median(self._kept.baseline_pf, axis=0) if self.n_instants else self.known.unloaded_pf
        found = self.electrodes.of(self.known, unloaded_pf, self._models.response.design)
        return replace(found, error_rel=max(self.known.error_rel, float(unknown_rel)))
