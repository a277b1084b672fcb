"""What the electrodes found while walking are worth: by how much they turn forces, how surely, and objections.

The misfit alone does not warn of elements that creep differently, or of a floor that adds capacitance: other electrodes
explain both. But early in a stance they would be others than late, and lightly loaded others than firmly. So the
instants are halved both ways, each half is fitted by itself, and the forces of both are compared.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.selfcal.instants import N_PARTS, Instants
from footsense.calibration.selfcal.walking_fit import Electrodes, fit_again, misfit_of, readings_of
from footsense.calibration.standing.fit import N_ELECTRODE_PARAMETERS
from footsense.calibration.twin import GAIN, STRAY
from footsense.foot.directions import angles_between_deg
from footsense.frames import Mask, Vector

#: Draws from the covariance, and the seed of them.
_DRAWS, _SEED = 16, 1
#: Least number of instants for a judgement, and of a half.
MIN_INSTANTS, _MIN_HALF = 36, 9
#: Least turn that is worth a calibration [deg], and over its standard deviation [1].
_MIN_TURN_DEG, _MIN_TURN_SIGMAS = 0.3, 2.0
#: Largest angle between the forces of both halves over the turn [1].
_MAX_HALVES_REL = 0.5
#: Largest change of a parameter over its standard deviation before walking [1].
_MAX_CHANGE_SIGMAS = 4.0
#: Largest share of stances in which an element is beyond its range [1].
_MAX_SATURATED_REL = 0.3


class Turn(NamedTuple):
    """By how much electrodes turn the forces of usual loads against those known before.

    Attributes:
        deg: Mean angle [deg].
        sigma_deg: Mean angle to expect from what is not known of the electrodes [deg].
    """

    deg: float
    sigma_deg: float


def turn_of_forces(models: DesignModels, before: Electrodes, now: Electrodes, instants: Instants) -> Turn:
    """Return by how much the forces of some instants turn, from one set of electrodes to another.

    Args:
        models: Models of the foot's type.
        before: The electrodes known before.
        now: Those found.
        instants: Instants of usual loads.
    """
    random = np.random.default_rng(_SEED)
    off = random.multivariate_normal(
        np.zeros(N_ELECTRODE_PARAMETERS), now.covariance, _DRAWS, method="cholesky"
    )
    draws = now.parameters + np.pad(off, ((0, 0), (0, len(now.parameters) - off.shape[1])))
    found_n = _forces_n(models, now.parameters, instants)
    before_n = _forces_n(models, before.parameters, instants)
    drawn_deg = [angles_between_deg(_forces_n(models, one, instants), found_n).mean() for one in draws]
    return Turn(float(angles_between_deg(before_n, found_n).mean()), float(np.mean(drawn_deg)))


def _forces_n(models: DesignModels, parameters: Vector, instants: Instants) -> Vector:
    readings, unloaded_pf = readings_of(models, parameters, instants)
    stray_pf = np.minimum(parameters[STRAY], 0.5 * unloaded_pf)
    gain_rel = np.maximum(1.0 + parameters[GAIN], 0.5)
    return models.estimate_in_foot_frame(readings.capacitance_pf, unloaded_pf, stray_pf, gain_rel).force_n


class Evidence(NamedTuple):
    """What a judgement is made of.

    Attributes:
        models: Models of the foot's type.
        before: The electrodes known before.
        now: Those found.
        instants: Instants of usual loads.
        turn: By how much those found turn their forces.
        saturated_rel: Share of the stances in which an element was beyond its range [1].
    """

    models: DesignModels
    before: Electrodes
    now: Electrodes
    instants: Instants
    turn: Turn
    saturated_rel: float

    def objection(self) -> str:
        """Return why the electrodes are not proposed as a calibration; empty if nothing speaks against them."""
        return next(self._objections(), "")

    def _objections(self) -> Iterator[str]:
        n, turn = len(self.instants.t_ns), self.turn
        if n < MIN_INSTANTS:
            yield f"{n} of {MIN_INSTANTS} instants so far"
        if self.saturated_rel > _MAX_SATURATED_REL:
            yield f"an element is beyond its range in {self.saturated_rel:.0%} of the stances"
        if turn.deg < max(_MIN_TURN_DEG, _MIN_TURN_SIGMAS * turn.sigma_deg):
            yield "no improvement to expect"
        sigma = np.sqrt(np.diag(self.before.covariance))
        change = (self.now.parameters - self.before.parameters)[:N_ELECTRODE_PARAMETERS] / sigma
        if (largest := float(np.abs(change).max())) > _MAX_CHANGE_SIGMAS:
            yield f"a parameter changed by {largest:.1f} standard deviations, more than any should"
        for words, half in _halves(self.instants).items():
            if min(np.count_nonzero(half), np.count_nonzero(~half)) < _MIN_HALF:
                yield f"too few instants {words}"
            yield from self._objections_of_halves(words, half)

    def _objections_of_halves(self, words: str, half: Mask) -> Iterator[str]:
        one, other = (self.instants.subset(part) for part in (half, ~half))
        fits = [fit_again(self.models, self.before, part, self.now.parameters) for part in (one, other)]
        forces_n = [_forces_n(self.models, fit.parameters, self.instants) for fit in fits]
        differ_deg = float(angles_between_deg(*forces_n).mean())
        if differ_deg > _MAX_HALVES_REL * self.turn.deg:
            yield f"instants {words} differ by {differ_deg:.1f} deg"
        held_out = misfit_of(self.models, fits[0].parameters, other)
        if held_out > misfit_of(self.models, self.before.parameters, other):
            yield f"instants {words} do not explain one another"


def _halves(instants: Instants) -> dict[str, Mask]:
    """Return the ways to halve instants, in words: early ones, with the early middle ones, and light ones."""
    change_pf = (instants.capacitance_pf - instants.baseline_pf).mean(axis=1)
    middle = instants.part == N_PARTS // 2
    odd = np.cumsum(middle) % 2 == 1
    return {
        "early and late in the stances": (instants.part == 0) | (middle & odd),
        "of light and of firm loads": change_pf < np.median(change_pf),
    }
