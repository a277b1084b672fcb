"""Page `real-sensors`: sensors that others measured, as witnesses of what is assumed of rubber, gains and drift."""

from collections.abc import Sequence

import numpy as np

from footsense.calibration.parameter_fit import PRIOR_SIGMA
from footsense.calibration.twin import GAIN
from footsense.frames import Vector
from footsense.lab.measured.insole import (
    FULL_SCALE_BAR,
    MAX_JUMP_COUNTS,
    InsoleFit,
    Session,
    fit_reading,
    memory_states,
    predicted_reading,
    pressure_on_clock,
    read_sessions,
)
from footsense.lab.report import StudyContext, Values
from footsense.sim.fabrication import SESSION_GAIN_REL
from footsense.sim.rubber import CREEP_REL, ViscoelasticRubber

TITLE = "Real sensors: what others measured, against what is assumed here"

#: Where the data are to be had, by their folder in that of `--data`; a study without this needs none.
DATA = {
    "insole": "github.com/ami-iit/paper_belli_2023_sensors_insole-calibration, Data/left_insole, BSD-3",
}
_CALIBRATION = "calibration"
#: Bins of the pressure in which a loop is measured, and samples in each branch of three of them, at least.
_N_BINS, _MIN_SAMPLES = 20, 5
#: Standard deviation of a normal distribution over its median absolute deviation.
_SIGMA_PER_MAD = 1.4826
#: Samples of a block; every other block makes a half of a session.
_N_BLOCK = 20
#: Rubber of the simulation: creep and play over what it assumes.
_INSOLE, _RUBBER = "the insole", "`sim/rubber.py`"
_RUBBERS = {_RUBBER: (1.0, 1.0), "its play x 3": (1.0, 3.0), "its creep and play x 3": (3.0, 3.0)}


def compute(context: StudyContext) -> Values:
    """Fit the insole's sessions, and find what its gains are in later ones."""
    folder = context.data_folder(DATA)
    sessions = read_sessions(folder / "insole")
    means = {name: one.reading.mean(axis=1) for name, one in sessions.items()}
    fits = {name: fit_reading(one, means[name]) for name, one in sessions.items()}
    context.report_progress("sessions fitted")
    first, fitted = sessions[_CALIBRATION], fits[_CALIBRATION]
    # The foam is one: all elements have the memory of their mean.
    ours = [fit_reading(first, one, clock=fitted.clock, memory=fitted.memory) for one in first.reading.T]
    pressure = pressure_on_clock(first, fitted.clock)
    context.report_progress("elements fitted")
    everything = read_sessions(folder / "insole", np.inf)
    readings = everything[_CALIBRATION].reading.T
    all_ours = [fit_reading(first, one, clock=fitted.clock, memory=fitted.memory) for one in readings]
    later = {name: one for name, one in sessions.items() if name != _CALIBRATION}
    loops = {_INSOLE: _loop(pressure, means[_CALIBRATION])}
    for name, factors in _RUBBERS.items():
        loops[name] = _loop(pressure, _rubber_reading(pressure, first.step_s, *factors))
    return {
        "creep_rel": CREEP_REL[-1],
        "gain_sigma": PRIOR_SIGMA[GAIN][0],
        "session_gain": SESSION_GAIN_REL,
        "full_scale_bar": FULL_SCALE_BAR,
        "max_jump_counts": MAX_JUMP_COUNTS,
        "n_elements": first.reading.shape[1],
        "range_counts": float(np.ptp(means[_CALIBRATION])),
        "forms": {name: _form_figures(one, means[name], fits[name]) for name, one in sessions.items()},
        "loops": {
            name: {"largest": float(np.abs(loop).max()), "mean": float(np.abs(loop).mean())}
            for name, loop in loops.items()
        },
        "gains": {name: _gain_figures(one, ours, fits[name].clock) for name, one in later.items()},
        "n_elements_of_all": everything[_CALIBRATION].reading.shape[1],
        "gains_of_all": {name: _gain_figures(everything[name], all_ours, fits[name].clock) for name in later},
    }


def _form_figures(session: Session, mean: Vector, fit: InsoleFit) -> Values:
    """Return what each form leaves of the mean reading over its range, and the memory of the last."""
    none = np.zeros_like(fit.memory)
    forms = {
        "static": fit_reading(session, mean, memory=none, clock=np.zeros(2)),
        "clock": fit_reading(session, mean, memory=none),
        "memory": fit,
    }
    left = {name: float(one.misfit.std() / np.ptp(mean)) for name, one in forms.items()}
    return left | {"play": float(fit.memory[:-1].sum()), "creep": float(fit.memory[-1])}


def _gains(session: Session, fits: Sequence[InsoleFit], clock: Vector, rows: slice | Vector) -> Vector:
    """Return the slope of each element's readings over those that its fit expects [1], shape (n,)."""
    pressure = pressure_on_clock(session, clock)
    states = memory_states(pressure, session.step_s)
    expected = [predicted_reading(fit, pressure, states)[rows] for fit in fits]
    pairs = zip(expected, session.reading[rows].T, strict=True)
    return np.array([np.polyfit(one, reading, 1)[0] for one, reading in pairs])


def _gain_figures(session: Session, fits: Sequence[InsoleFit], clock: Vector) -> Values:
    """Return the elements' gains against the first session: common, spread of single ones, and of two halves."""
    gain = _gains(session, fits, clock, slice(None))
    block = np.arange(len(session.reading)) // _N_BLOCK
    halves = [_gains(session, fits, clock, block % 2 == half) for half in (0, 1)]
    own = gain / np.median(gain)
    return {
        "common": float(np.median(gain)),
        "deviation": _robust_deviation(own),
        "low": float(np.percentile(own, 5)),
        "high": float(np.percentile(own, 95)),
        # Half of the samples have twice the variance, and their difference four times.
        "by_chance": _robust_deviation(halves[0] / halves[1]) / 2.0,
    }


def _loop(pressure: Vector, reading: Vector) -> Vector:
    """Return by how much the reading is larger after the largest pressure, over its range [1], by pressure."""
    falling = np.arange(len(pressure)) > np.argmax(pressure)
    place = np.digitize(pressure, np.linspace(pressure.min(), pressure.max(), _N_BINS + 1)[1:-1])
    loop = []
    for n in range(1, _N_BINS - 1):
        near = np.abs(place - n) <= 1
        branches = [near & ~falling, near & falling]
        if min(int(one.sum()) for one in branches) < _MIN_SAMPLES:
            continue
        middle = float(pressure[place == n].mean())
        up, down = (np.polyval(np.polyfit(pressure[one] - middle, reading[one], 1), 0.0) for one in branches)
        loop.append((down - up) / np.ptp(reading))
    return np.array(loop)


def _rubber_reading(pressure: Vector, step_s: float, creep: float, play: float) -> Vector:
    """Return the effective load of the simulated rubber on a history of the pressure, whose full scale is 1 N."""
    rubber, up = ViscoelasticRubber(creep, play), np.array([0.0, 0.0, 1.0])
    loads = [rubber.next_effective_load(round(n * step_s * 1e9), up, p * up) for n, p in enumerate(pressure)]
    return np.array([force_n[2] for _, force_n in loads])


def _robust_deviation(values: Vector) -> float:
    return float(_SIGMA_PER_MAD * np.median(np.abs(values - np.median(values))))
