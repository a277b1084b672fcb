"""A measured capacitive insole: its sessions, and a fit of the form of our rubber to its readings.

Each element reads a polynomial of an effective pressure, as of `sim/rubber.py` but for its scale:

    e = p + sum_j w_j (p_j - p) + c (z - p)

with play operators p_j and a Kelvin chain z of 10 s. The pressure was logged without times, so its clock, offset and
rate, is fitted too; what creeps within a second or two cannot be told from an offset.

Source:
    Belli et al., Modeling and Calibration of Pressure-Sensing Insoles via a New Plenum-Based Chamber, Sensors 23, 4501,
    2023; data of the left insole: github.com/ami-iit/paper_belli_2023_sensors_insole-calibration, BSD-3.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.io import loadmat

from footsense.errors import FootsenseError
from footsense.frames import Mask, Vector
from footsense.sim.rubber import CREEP_TIME_S, PLAY_OPERATOR_WIDTHS_N

#: Files of the sessions, in the order of the paper, the calibration first.
SESSIONS = {
    "calibration": "calibration_dataset.mat",
    "validation 1": "validation_dataset_1.mat",
    "validation 2": "validation_dataset_2.mat",
    "validation 3": "validation_dataset_3.mat",
    "steps": "experiment_Inf_15September_steps_1.mat",
    "dynamic": "experiment_Inf_17September_dynamic_2.mat",
}
#: A table of some elements of the same sessions, in place of the files.
REDUCED_FILE = "insole.csv"
#: Pressure of full scale [bar], and reading without any dielectric's change [counts].
FULL_SCALE_BAR, REST_COUNTS = 3.4, 250.0
#: Samples that make one: the median of their pressures, the mean of their readings.
_BLOCK = 32
#: An element is used that follows the pressure so well [1], and never jumps by more [counts]: some jump by 15 to 40.
_MIN_CORRELATION, MAX_JUMP_COUNTS = 0.8, 12.0
#: Widths of the play operators over full scale, as 1 N is of the rubber, and time of the creep [s].
_WIDTHS_REL, _CREEP_S = PLAY_OPERATOR_WIDTHS_N, float(CREEP_TIME_S[-1])
_N_MEMORY = len(_WIDTHS_REL) + 1
#: Largest weight of each, power of the polynomial, and rounds of the fit.
_MAX_WEIGHT, _DEGREE, _ROUNDS = 0.5, 3, 12


class Session(NamedTuple):
    """Readings of one session at equal steps.

    Attributes:
        step_s: Time between two samples [s].
        pressure_rel: Pressure over full scale, by a clock of its own [1], shape (n,).
        reading: Readings, growing with pressure [counts], shape (n, elements).
    """

    step_s: float
    pressure_rel: Vector
    reading: Vector


class InsoleFit(NamedTuple):
    """Fit of one reading to the pressure's history.

    Attributes:
        polynomial: Coefficients of the reading by powers of the effective pressure [counts], lowest first.
        memory: Weights of the play operators and of the creep [1], shape (4,).
        clock: Offset [s] and rate [1] of the pressure's clock.
        misfit: What the fit leaves [counts], shape (n,).
    """

    polynomial: Vector
    memory: Vector
    clock: Vector
    misfit: Vector


def read_sessions(folder: Path, max_jump_counts: float = MAX_JUMP_COUNTS) -> dict[str, Session]:
    """Return the sessions in a folder, of the elements that follow the pressure in all of them.

    Args:
        folder: Has the files of `SESSIONS`, or a reduced table.
        max_jump_counts: An element that jumps by more between two samples is left out [counts].

    Raises:
        FootsenseError: It has neither.
    """
    reduced = folder / REDUCED_FILE
    if reduced.is_file():
        rows = np.loadtxt(reduced, delimiter=",")
        parts = {name: rows[rows[:, 0] == number] for number, name in enumerate(SESSIONS)}
        return {
            name: Session(part[0, 1] * 1e-3, part[:, 2] * 1e-4, part[:, 3:] * 0.1)
            for name, part in parts.items()
        }
    missing = [file for file in SESSIONS.values() if not (folder / file).is_file()]
    if missing:
        raise FootsenseError(f"{folder}: has no {missing[0]}, and no {REDUCED_FILE}")
    sessions = {name: _read_session(folder / file) for name, file in SESSIONS.items()}
    works = np.all([_works(session, max_jump_counts) for session in sessions.values()], axis=0)
    return {name: one._replace(reading=one.reading[:, works]) for name, one in sessions.items()}


def _read_session(file: Path) -> Session:
    experiment = loadmat(file)["experiment"]
    logged, pressure_bar = experiment["C"][0, 0], experiment["P"][0, 0][:, 0]
    n = min(len(logged), len(pressure_bar)) // _BLOCK
    blocks = logged[: n * _BLOCK, 2:].reshape(n, _BLOCK, -1)
    return Session(
        step_s=float(np.diff(logged[:, 1]).mean()) * _BLOCK,
        pressure_rel=np.median(pressure_bar[: n * _BLOCK].reshape(n, _BLOCK), axis=1) / FULL_SCALE_BAR,
        reading=REST_COUNTS - blocks.mean(axis=1),
    )


def _works(session: Session, max_jump_counts: float) -> Mask:
    """Return which elements follow the pressure, shape (elements,)."""
    centred = session.reading - session.reading.mean(axis=0)
    pressure = session.pressure_rel - session.pressure_rel.mean()
    scale = np.linalg.norm(centred, axis=0) * np.linalg.norm(pressure)
    works: Mask = (centred.T @ pressure >= _MIN_CORRELATION * scale) & (scale > 0.0)
    works &= np.abs(np.diff(session.reading, axis=0)).max(axis=0) < max_jump_counts
    return works


def pressure_on_clock(session: Session, clock: Vector) -> Vector:
    """Return the pressure at the times of the readings [1], shape (n,).

    Args:
        session: The session.
        clock: As of `InsoleFit`.
    """
    t_s = np.arange(len(session.pressure_rel)) * session.step_s
    pressure_rel: Vector = np.interp(t_s * (1.0 + clock[1]) + clock[0], t_s, session.pressure_rel)
    return pressure_rel


def memory_states(pressure_rel: Vector, step_s: float) -> Vector:
    """Return what play operators and creep are behind the pressure [1], shape (n, 4)."""
    played, crept = np.full(len(_WIDTHS_REL), pressure_rel[0]), pressure_rel[0]
    kept, states = np.exp(-step_s / _CREEP_S), np.empty((len(pressure_rel), _N_MEMORY))
    for n, now in enumerate(pressure_rel):
        played = np.clip(played, now - _WIDTHS_REL, now + _WIDTHS_REL)
        crept = now + kept * (crept - now)
        states[n] = [*(played - now), crept - now]
    return states


def fit_reading(
    session: Session, reading: Vector, *, memory: Vector | None = None, clock: Vector | None = None
) -> InsoleFit:
    """Fit one reading by Gauss-Newton; return the best of all rounds.

    Args:
        session: The session.
        reading: A reading of it, or the mean of some [counts], shape (n,).
        memory: Weights as of `InsoleFit`; None to fit them.
        clock: Clock of the pressure; None to fit it.
    """
    weights = np.zeros(_N_MEMORY) if memory is None else memory
    found = np.zeros(2) if clock is None else clock
    t_s, n = np.arange(len(reading)) * session.step_s, _DEGREE + 1
    fits: list[InsoleFit] = []
    for _ in range(_ROUNDS):
        if not fits or clock is None:
            pressure = pressure_on_clock(session, found)
            states = memory_states(pressure, session.step_s)
        powers = np.vander(pressure + states @ weights, n, increasing=True)
        polynomial: Vector = np.asarray(np.linalg.lstsq(powers, reading, rcond=None)[0], np.float64)
        fits.append(InsoleFit(polynomial, weights, found, reading - powers @ polynomial))
        slope = (powers[:, :-1] @ (polynomial[1:] * np.arange(1, n)))[:, None]
        by_time = (
            slope * np.gradient(pressure, session.step_s)[:, None] * np.column_stack([np.ones_like(t_s), t_s])
        )
        free = [powers, *([slope * states] if memory is None else ()), *([by_time] if clock is None else ())]
        if len(free) == 1:
            break
        step = np.linalg.lstsq(np.hstack(free), fits[-1].misfit, rcond=None)[0][n:]
        if memory is None:
            weights, step = np.clip(weights + step[:_N_MEMORY], 0.0, _MAX_WEIGHT), step[_N_MEMORY:]
        if clock is None:
            found = found + step
    return min(fits, key=lambda fit: float(fit.misfit.std()))


def predicted_reading(fit: InsoleFit, pressure_rel: Vector, states: Vector) -> Vector:
    """Return the reading that a fit expects [counts], shape (n,), of a pressure and its `memory_states`."""
    effective = pressure_rel + states @ fit.memory
    reading: Vector = np.vander(effective, len(fit.polynomial), increasing=True) @ fit.polynomial
    return reading
