"""Coverage of a session, its next load, and the checks of the reference."""

import itertools
from typing import Any

import numpy as np
import pytest

from footsense.calibration.checks import reference_findings
from footsense.calibration.guide import MIN_ELEVATION_DEG, Coverage
from footsense.cli.test_stand.compass import Compass
from footsense.config.test_stand import Axes, SimulatedSensor, StandConfig
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.reference.sensor_mounting import NEWTONS_PER_UNIT, SensorMounting
from tests.support.presses import direction


def test_the_next_loads_make_a_complete_set() -> None:
    """Applying each next load covers two magnitudes, with few more loads than wanted."""
    coverage = Coverage(40)
    while not coverage.is_complete:
        azimuth_deg, elevation_deg, magnitude_gf = coverage.next_load
        assert MIN_ELEVATION_DEG <= elevation_deg <= 90.0
        coverage.add_load(magnitude_gf * GRAM_FORCE_N * direction(azimuth_deg, elevation_deg))
    assert 40 <= coverage.n_loads <= 44
    assert coverage.counts[1] == 0
    assert coverage.progress_text().startswith(
        f"{coverage.n_loads} loads, at least 40 wanted; directions covered: "
    )


@pytest.mark.parametrize(
    "forces_n",
    [
        np.tile(direction(30.0, 60.0), (100, 1)),
        np.array([0.5 * direction(3.6 * k, 40.0 + 0.5 * k) for k in range(100)]),
        np.array([0.3 * (1 + k % 3) * direction(1.8 * k, 40.0 + 7 * (k % 8)) for k in range(100)]),
    ],
    ids=["one direction", "one magnitude", "one side"],
)
def test_many_loads_are_not_enough_where_they_are_alike(
    forces_n: np.ndarray[tuple[int, int], np.dtype[np.float64]],
) -> None:
    """A hundred from one direction, with one magnitude, or from one side only."""
    coverage = Coverage(20)
    for force_n in forces_n:
        coverage.add_load(force_n)
    assert not coverage.is_complete


def feet(seed: int, n: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Return forces and what a badly made foot makes of them."""
    random = np.random.default_rng(seed)
    forces_n = np.array(
        [
            random.uniform(0.4, 1.4) * direction(random.uniform(0, 360), random.uniform(45, 80))
            for _ in range(n)
        ]
    )
    return forces_n, 1.2 * forces_n + random.normal(0.0, 0.15, forces_n.shape)


def judged(
    reading_n: object, estimate_n: object, units: str, axes: list[str], mount_deg: tuple[float, ...]
) -> list[str]:
    described: dict[str, Any] = {
        "sensor": SimulatedSensor(),
        "rated": (1.0, 1.0, 1.0),
        "units": units,
        "mount_deg": mount_deg,
    }
    test_stand = StandConfig(axes=Axes(**dict(zip("xyz", axes, strict=True))), **described)
    return reference_findings(test_stand, np.asarray(reading_n), np.asarray(estimate_n))


@pytest.mark.parametrize("seed", range(5))
def test_a_plausible_reference_passes(seed: int) -> None:
    """A foot that is off by a fifth contradicts nobody, nor does one that says nothing, nor do four loads."""
    forces_n, estimate_n = feet(seed)
    assert judged(forces_n, estimate_n, "gf", ["-x", "-y", "-z"], (0, 0, 10)) == []
    assert judged(9.8 * forces_n, np.full_like(forces_n, np.nan), "gf", ["x", "y", "z"], (0, 0, 0)) == []
    assert judged(9.8 * forces_n[:4], estimate_n[:4], "gf", ["x", "y", "z"], (0, 0, 0)) == []


@pytest.mark.parametrize(("named", "meant"), list(itertools.permutations(["N", "kgf", "gf"], 2)))
def test_wrong_units_are_named(named: str, meant: str) -> None:
    """Each taken for each other."""
    forces_n, estimate_n = feet(1)
    reading_n = forces_n * NEWTONS_PER_UNIT[named] / NEWTONS_PER_UNIT[meant]
    (line,) = judged(reading_n, estimate_n, named, ["-x", "-y", "-z"], (0, 0, 0))
    assert f"its readings seem to be in {meant}, and the test stand's file says units: {named}" in line


@pytest.mark.parametrize("mount_deg", [(0.0, 0.0, 0.0), (0.0, 0.0, 20.0)])
@pytest.mark.parametrize("given", [["y", "x", "-z"], ["-x", "-y", "z"], ["x", "y", "-z"], ["-z", "-x", "-y"]])
def test_wrong_axes_are_named_with_those_that_fit(
    given: list[str], mount_deg: tuple[float, float, float]
) -> None:
    """Swapped, with wrong signs, or all against each other, also on a sensor that is turned besides."""
    forces_n, estimate_n = feet(2)
    right = ["-x", "-y", "-z"]
    sensor = forces_n @ np.linalg.inv(
        SensorMounting(dict(zip("xyz", right, strict=True)), mount_deg, "N", 1.0, (9, 9, 9)).to_foot_force_n(
            np.eye(3)
        )[0]
    )
    reading_n = SensorMounting(
        dict(zip("xyz", given, strict=True)), mount_deg, "N", 1.0, (9, 9, 9)
    ).to_foot_force_n(sensor)[0]
    (line,) = judged(reading_n, estimate_n, "N", given, mount_deg)
    assert "axes: {x: -x, y: -y, z: -z} would fit" in line


def test_wrong_axes_without_a_fitting_map_are_reported() -> None:
    """Straight presses alone say that a sign is wrong, not which map would fit."""
    forces_n = np.tile([0.0, 0.0, 1.0], (8, 1))
    (line,) = judged(-forces_n, forces_n, "N", ["x", "y", "z"], (0, 0, 0))
    assert "180 deg away" in line
    assert "press from more sides" in line


def test_the_compass_points_at_what_is_missing() -> None:
    """A load towards the left is marked on the left; the next load, and the force just now, in their directions."""
    coverage = Coverage(40)
    for magnitude_n in (0.5, 1.5):
        coverage.add_load(magnitude_n * direction(90.0, 50.0))
    drawn = Compass(coverage).draw(direction(180.0, 50.0)).plain.splitlines()
    assert (drawn[0].strip(), drawn[-1].strip()) == ("forward", "back")
    left, middle, right = 8, 16, 24
    assert (drawn[6][left], drawn[6][right], drawn[2][middle], drawn[10][middle]) == ("#", ".", ".", "+")
    assert sum(line.count("X") for line in drawn) == 1
    coverage.add_load(0.5 * direction(270.0, 50.0))
    assert Compass(coverage).draw(np.full(3, np.nan)).plain.splitlines()[6][right] == "o"
