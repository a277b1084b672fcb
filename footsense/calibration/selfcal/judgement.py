"""What the electrodes found while walking are worth: by how much they turn forces, how surely, and objections.

The misfit alone does not warn of elements that creep differently, or of a floor that adds capacitance: other electrodes
explain both. But early in a stance they would be others than late, and lightly loaded others than firmly. So the
instants are halved both ways, each half is fitted by itself, and the forces of both are compared.
"""

from typing import NamedTuple

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.selfcal.instants import N_PARTS, Instants
from footsense.calibration.selfcal.walking_fit import fit_again, misfit_of
from footsense.calibration.standing.fit import N_ELECTRODE_PARAMETERS, Electrodes
from footsense.calibration.twin import GAIN, STRAY
from footsense.foot.directions import angles_between_deg
from footsense.frames import Mask, Vector

#: Seed of the draws from the covariance.
_SEED = 1
#: Least number of instants for a judgement of their halves, and most that it takes.
MIN_INSTANTS, MAX_INSTANTS = 36, 72
#: Least turn that is worth a calibration [deg], and over its standard deviation [1].
_MIN_TURN_DEG, _MIN_TURN_SIGMAS = 0.3, 1.25
#: Standard deviation of any turn that is worth a calibration, over the error of the electrodes known before [1].
_CONFIRMS_REL = 0.5
#: Largest distance of one half from the electrodes of the other, over the usual one [1].
_MAX_HELD_OUT = 1.0
#: Largest change of a parameter over its standard deviation before walking [1].
_MAX_CHANGE_SIGMAS = 4.0


class Turn(NamedTuple):
    """By how much electrodes turn the forces of usual loads against those known before.

    Attributes:
        deg: Mean angle [deg].
        sigma_deg: Mean angle to expect from what is not known of the electrodes [deg].
    """

    deg: float
    sigma_deg: float


def _spread_deg(models: DesignModels, electrodes: Electrodes, instants: Instants) -> float:
    """Return the mean angle between the forces with electrodes and with a draw of their covariance each [deg]."""
    n, random = len(instants.t_ns), np.random.default_rng(_SEED)
    own = electrodes.own_covariance
    drawn = np.tile(electrodes.parameters, (n, 1))
    drawn[:, : len(own)] += random.multivariate_normal(np.zeros(len(own)), own, n, method="cholesky")
    drawn_n = _forces_n(models, electrodes._replace(parameters=drawn), instants)
    return float(angles_between_deg(_forces_n(models, electrodes, instants), drawn_n).mean())


def _forces_n(models: DesignModels, electrodes: Electrodes, instants: Instants) -> Vector:
    parameters = electrodes.parameters
    unloaded_pf = np.median(instants.baseline_pf, axis=0)
    capacitance_pf = instants.capacitance_pf - instants.baseline_pf + unloaded_pf - electrodes.floor_pf
    stray_pf = np.minimum(parameters[..., STRAY], 0.5 * unloaded_pf)
    gain_rel = np.maximum(1.0 + parameters[..., GAIN], 0.5)
    return models.estimate_in_foot_frame(capacitance_pf, unloaded_pf, stray_pf, gain_rel).force_n


def judge_electrodes(
    models: DesignModels, before: Electrodes, now: Electrodes, instants: Instants, expected_deg: float
) -> tuple[Turn, str]:
    """Return by how much electrodes turn forces, and why they are not proposed as a calibration; empty if they are.

    Half of the angle between the halves of the instants, beyond that which they leave open each, counts in the standard
    deviation of the turn.

    Args:
        models: Models of the foot's type.
        before: The electrodes known before.
        now: Those found.
        instants: Instants of usual loads, at least one.
        expected_deg: Mean angle to expect with those known before, as old as they are [deg].
    """
    before_n = _forces_n(models, now._replace(parameters=before.parameters), instants)
    found_n = _forces_n(models, now, instants)
    turn = Turn(float(angles_between_deg(before_n, found_n).mean()), _spread_deg(models, now, instants))
    n = len(instants.t_ns)
    if n < MIN_INSTANTS:
        return turn, f"{n} of {MIN_INSTANTS} instants so far"
    halves = _halves(instants)
    found = {words: _fit_halves(models, before, now, instants, half) for words, half in halves.items()}
    worst_deg = max(differ_deg for _, differ_deg in found.values())
    turn = turn._replace(sigma_deg=float(np.hypot(turn.sigma_deg, 0.5 * worst_deg)))
    sigma = np.sqrt(np.diag(before.own_covariance))
    change = (now.parameters - before.parameters)[:N_ELECTRODE_PARAMETERS] / sigma
    is_turned = turn.deg >= max(_MIN_TURN_DEG, _MIN_TURN_SIGMAS * turn.sigma_deg)
    if not (is_turned or turn.sigma_deg <= _CONFIRMS_REL * expected_deg):
        return turn, "no improvement to expect"
    if (largest := float(np.abs(change).max())) > _MAX_CHANGE_SIGMAS:
        return turn, f"a parameter changed by {largest:.1f} standard deviations"
    for words, (parameters, _) in found.items():
        held_out = instants.subset(~halves[words])
        of_before = misfit_of(models, before.parameters, held_out) if is_turned else _MAX_HELD_OUT
        if not misfit_of(models, parameters, held_out) <= min(of_before, _MAX_HELD_OUT):
            return turn, f"instants {words} do not explain one another"
    return turn, ""


def _fit_halves(
    models: DesignModels, before: Electrodes, now: Electrodes, instants: Instants, half: Mask
) -> tuple[Vector, float]:
    """Return the parameters by one half, and the mean angle between both halves' forces beyond the expected [deg]."""
    fits = [fit_again(models, before, instants.subset(which), now.parameters) for which in (half, ~half)]
    forces_n = [_forces_n(models, fit.electrodes, instants) for fit in fits]
    spreads = [_spread_deg(models, fit.electrodes, instants) for fit in fits]
    differ_deg = float(angles_between_deg(*forces_n).mean())
    beyond_deg = float(np.sqrt(max(differ_deg**2 - np.square(spreads).sum(), 0.0)))
    return fits[0].electrodes.parameters, beyond_deg


def _halves(instants: Instants) -> dict[str, Mask]:
    """Return the ways to halve instants, in words: early ones, with the early middle ones, and light ones."""
    change_pf = (instants.capacitance_pf - instants.baseline_pf).mean(axis=1)
    middle = instants.part == N_PARTS // 2
    odd = np.cumsum(middle) % 2 == 1
    return {
        "early and late in the stances": (instants.part == 0) | (middle & odd),
        "of light and of firm loads": change_pf < np.median(change_pf),
    }
