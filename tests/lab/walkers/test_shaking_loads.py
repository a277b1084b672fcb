"""Loads that shake: as much as those of a robot under a learned policy, by numbers that were measured of one."""

import itertools

import numpy as np

from footsense.frames import Mask, Vector
from footsense.lab.walkers.made_up import SHAKING, MadeUpLoads
from footsense.lab.walkers.simulate import LOG_STEP_S, WalkerLog

LOG = MadeUpLoads(SHAKING, 5950, 12.0).kept_log()
#: Time of a stance that is not its middle [ms].
EDGE_MS = 40


def mid_stances(log: WalkerLog) -> list[tuple[int, slice]]:
    """Return leg and rows of the middle of each whole stance of over 150 ms."""
    found = []
    for leg in range(len(log.legs)):
        loaded: Mask = np.asarray(log.force_n[:, leg].any(axis=1))
        edges = np.flatnonzero(np.diff(loaded.astype(int)))
        found += [
            (leg, slice(first + EDGE_MS, last - EDGE_MS))
            for first, last in itertools.pairwise(edges)
            if loaded[first + 1] and last - first > 150
        ]
    return found


def tangential_n(log: WalkerLog, leg: int, rows: slice) -> Vector:
    """Return the tangential force of a foot [N], shape (n, 3)."""
    force_n, normal = log.force_n[rows, leg], log.normal[rows, leg]
    part: Vector = force_n - (force_n * normal).sum(axis=1, keepdims=True) * normal
    return part


def test_a_quarter_of_the_tangential_power_is_fast() -> None:
    """Above 40 Hz, in mid-stance."""
    fast, all_of_it = 0.0, 0.0
    for leg, rows in mid_stances(LOG):
        part = tangential_n(LOG, leg, rows)[:, :2]
        window = np.hanning(len(part))[:, None]
        power = np.abs(np.fft.rfft((part - part.mean(axis=0)) * window, axis=0)) ** 2
        fast += power[np.fft.rfftfreq(len(part), LOG_STEP_S) > 40.0].sum()
        all_of_it += power.sum()
    assert 0.2 < fast / all_of_it < 0.3


def test_contacts_roll_and_feet_shake_as_measured() -> None:
    """Contacts at 95 to 190 deg/s, 5 % of the accelerations above 114 m/s2 or so; nothing rubs more than it can."""
    rates = [
        np.degrees(np.linalg.norm(np.diff(LOG.normal[rows, leg], axis=0), axis=1)) / LOG_STEP_S
        for leg, rows in mid_stances(LOG)
    ]
    assert 95.0 < np.sqrt(np.mean(np.concatenate(rates) ** 2)) < 190.0
    swinging = ~LOG.force_n.any(axis=2)
    size = np.linalg.norm(LOG.acceleration_m_s2[swinging], axis=1)
    assert 90.0 < np.percentile(size, 95) < 140.0
    normal_n = (LOG.force_n * LOG.normal).sum(axis=2)
    size_n = np.linalg.norm(LOG.force_n - normal_n[..., None] * LOG.normal, axis=2)
    assert (normal_n >= 0.0).all()
    assert (size_n <= 0.6001 * normal_n).all()


def test_a_seed_is_one_set_of_loads() -> None:
    """The same from the same seed, others from another."""
    np.testing.assert_array_equal(LOG.force_n, MadeUpLoads(SHAKING, 5950, 12.0).kept_log().force_n)
    assert (LOG.force_n != MadeUpLoads(SHAKING, 5951, 12.0).kept_log().force_n).any()
