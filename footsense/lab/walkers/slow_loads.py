"""Loads of feet that are set down slowly, made up: what touches are dated by that take a second to rise.

Their kind is that of feet with Hall-effect sensors under walking hexapods with servo drives: a load rises over 0.3 to
3 s, waits on plateaus, and ripples. A touch begins as that of every load: the first time that the normal force exceeds
a hundredth of the peak (`walker_scores.FIRST_LOAD_REL`).
"""

from itertools import pairwise

import numpy as np

from footsense.frames import Vector
from footsense.lab.walkers.robots import GRAVITY_M_S2
from footsense.lab.walkers.simulate import LOG_STEP_S

#: Least and longest rise, time at full load, fall and swing [s], drawn evenly over their logarithm.
RISE_S, SWING_S = (0.3, 3.0), (0.2, 3.0)
_HOLD_S, _FALL_S = (0.2, 1.0), (0.15, 1.0)
#: Load of a stance over the peak [1]; most plateaus of a rise; ripple over the load [1], and its frequency [Hz].
_LOAD_REL, _MOST_PLATEAUS, _RIPPLE_REL, _RIPPLE_HZ = (0.6, 1.0), 2, (0.02, 0.1), (2.0, 12.0)
#: Lean of the contact's normal [deg], and tangential over normal force [1].
_LEAN_DEG, _RATIO = 12.0, 0.25
#: Height and way of a swing [m], and shake of the drives in it [m/s2, rms] with its correlation time [s].
_LIFT_M, _STRIDE_M, _SHAKE_M_S2, _SHAKE_S = 0.02, 0.05, 0.7, 0.008


def slow_foot(t_s: Vector, rng: np.random.Generator) -> tuple[Vector, Vector, Vector]:
    """Return force, contact normal and acceleration of a foot, each of shape (n, 3)."""
    load_rel = np.zeros_like(t_s)
    normal, ratio = np.tile([0.0, 0.0, 1.0], (len(t_s), 1)), np.zeros((len(t_s), 3))
    white = rng.normal(size=(len(t_s), 3))
    kernel = np.exp(-np.arange(0.0, 5.0 * _SHAKE_S, LOG_STEP_S) / _SHAKE_S)
    kernel *= _SHAKE_M_S2 / np.linalg.norm(kernel)
    acceleration_m_s2 = np.stack([np.convolve(one, kernel)[: len(t_s)] for one in white.T], axis=1)
    acceleration_m_s2[:, 2] += GRAVITY_M_S2
    start_s = 0.0
    while start_s < t_s[-1]:
        swing_s, rise_s, hold_s, fall_s = (
            float(np.exp(rng.uniform(*np.log(span)))) for span in (SWING_S, RISE_S, _HOLD_S, _FALL_S)
        )
        down_s = start_s + swing_s
        end_s = down_s + rise_s + hold_s + fall_s
        swings = (t_s >= start_s) & (t_s < down_s)
        turn = 2.0 * np.pi * (t_s[swings] - start_s) / swing_s
        acceleration_m_s2[swings, 0] += 2.0 * np.pi * _STRIDE_M / swing_s**2 * np.sin(turn)
        acceleration_m_s2[swings, 2] += 2.0 * np.pi**2 * _LIFT_M / swing_s**2 * np.cos(turn)
        stands = (t_s >= down_s) & (t_s < end_s)
        since_s = t_s[stands] - down_s
        fallen = _smooth((since_s - rise_s - hold_s) / fall_s)
        ripple = rng.uniform(*_RIPPLE_REL) * np.sin(
            2.0 * np.pi * (rng.uniform(*_RIPPLE_HZ) * since_s + rng.uniform())
        )
        load_rel[stands] = (
            rng.uniform(*_LOAD_REL) * _rise(since_s / rise_s, rng) * (1.0 - fallen) * (1.0 + ripple)
        )
        lean, along = np.radians(_LEAN_DEG) * rng.normal(size=2) / 2.0, rng.uniform(0.0, 2.0 * np.pi)
        towards = np.array([*lean, 1.0]) / np.linalg.norm([*lean, 1.0])
        sideways = np.cross(towards, [-np.sin(along), np.cos(along), 0.0])
        normal[stands] = towards
        ratio[stands] = rng.uniform(0.0, _RATIO) * sideways / np.linalg.norm(sideways)
        start_s = end_s
    return load_rel[:, None] * (normal + ratio), normal, acceleration_m_s2


def _rise(share: Vector, rng: np.random.Generator) -> Vector:
    """Return the load after shares of its rise [1], shape (n,): some smooth steps with plateaus between them."""
    n_steps = 1 + int(rng.integers(_MOST_PLATEAUS + 1))
    edges = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, size=2 * n_steps - 1))])
    edges /= edges[-1]
    levels = np.concatenate([[0.0], np.sort(rng.uniform(size=n_steps - 1)), [1.0]])
    load_rel = np.zeros_like(share)
    for begin, end, (low, high) in zip(edges[::2], edges[1::2], pairwise(levels), strict=True):
        load_rel += (high - low) * _smooth((share - begin) / (end - begin))
    return load_rel


def _smooth(share: Vector) -> Vector:
    """Return a smooth step from 0 to 1 [1], shape (n,)."""
    inside = np.clip(share, 0.0, 1.0)
    return np.asarray(inside * inside * (3.0 - 2.0 * inside))
