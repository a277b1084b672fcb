"""A foot type forwards and backwards: forces to capacitances, and capacitances to forces."""

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from msgspec.structs import replace

import footsense
from footsense.config import DEFAULT
from footsense.config.sections import Bus
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.foot_types import released_path
from footsense.daemon.models import load_models
from footsense.errors import ModelError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import CapFrame, Vector
from footsense.recording.replay import Replay
from footsense.sim.fabrication import PAPER_TOLERANCES, draw_deviations
from tests.support.calibrations import as_designed, calibration, parameters

GOLDEN = Path(__file__).parents[2] / "golden" / "measured_walk.mcap"
FOOT = footsense.Foot("aoyagi-3x3")
ESTIMATOR = footsense.Estimator("aoyagi-3x3")
#: Times of some scans a hundredth of a second apart [s].
T_S = 0.01 * np.arange(60)


def stances(n_feet: int = 1) -> Vector:
    """Return forces of feet that hang for 0.3 s and then stand on sloping ground [N], shape (60, feet, 3)."""
    force_n = np.zeros((len(T_S), n_feet, 3))
    for foot in range(n_feet):
        force_n[30:, foot] = (0.05 * foot, 0.1, 0.4 + 0.1 * foot)
    return force_n


@given(arrays(np.float64, array_shapes(max_dims=3, max_side=3), elements=st.floats(0.0, 1.2)))
def test_a_foot_takes_forces_of_any_leading_shape(fz_n: Vector) -> None:
    """Each force gives what it gives alone."""
    force_n = np.stack([0.2 * fz_n, -0.1 * fz_n, fz_n], axis=-1)
    pf = FOOT.capacitance_pf(force_n)
    assert pf.shape == (*fz_n.shape, 9)
    for at in np.ndindex(fz_n.shape):
        np.testing.assert_allclose(pf[at], FOOT.capacitance_pf(force_n[at]), rtol=1e-12)
        if fz_n[at] == 0.0:
            np.testing.assert_allclose(pf[at], FOOT.unloaded_pf, rtol=1e-12)


def test_a_normal_off_the_force_moves_the_contact() -> None:
    force_n = [0.0, 0.0, 0.5]
    middle, ahead = FOOT.capacitance_pf(force_n, normal=[[0.0, 0.0, 3.0], [-0.3, 0.0, 1.0]])
    np.testing.assert_allclose(middle, FOOT.capacitance_pf(force_n))
    # The ground leans towards the tail: the ball touches ahead of its middle, and the first row closes.
    assert ahead[:3].sum() > middle[:3].sum()
    assert ahead[6:].sum() < middle[6:].sum()


@pytest.mark.parametrize(
    ("force_n", "normal", "message"),
    [
        ([0.0, 1.0], None, r"force_n: its last axis has the three components x, y, z; got shape \(2,\)"),
        ([0.0, 0.0, np.nan], None, "force_n: has a number that is not finite"),
        ([0.0, 0.0, 1.0], [0.0, 0.0, 0.0], "normal: one has no length"),
        ([0.0, 1.0, 0.0], None, "reaches down to an elevation of 25 deg"),
    ],
)
def test_loads_without_a_meaning_are_refused(force_n: Any, normal: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FOOT.capacitance_pf(force_n, normal)


def test_a_recorded_walk_gives_the_forces_of_the_service_again() -> None:
    """Of its readings and their times; another processor may round otherwise."""
    walk = footsense.read(GOLDEN)
    forces = ESTIMATOR.run(walk.capacitance_pf, walk.t_s, walk.reading_t_s)
    np.testing.assert_array_equal(forces.state, walk.state)
    np.testing.assert_allclose(forces.force_n, walk.force_n, atol=1e-4)


@pytest.mark.slow
def test_the_forces_of_a_simulated_walk_are_those_that_its_feet_felt() -> None:
    walk = footsense.simulate("tripod", duration_s=5.0)
    forces = ESTIMATOR.run(walk.capacitance_pf, walk.t_s, walk.reading_t_s)
    np.testing.assert_allclose(forces.sigma_n, walk.sigma_n, atol=1e-3)
    np.testing.assert_array_equal(forces.contact, walk.contact)
    assert walk.true_force_n is not None
    assert forces.usable[walk.t_s > 0.3].all()
    error_n = (forces.force_n - walk.true_force_n)[walk.t_s > 0.9]
    assert (np.sqrt((error_n**2).mean(axis=(0, 1))) < (0.015, 0.005, 0.016)).all()


def test_scans_read_at_once_give_the_forces_of_their_rows() -> None:
    """After the eight scans of the tare, at any rate."""
    for period_s in (0.001, 0.1):
        forces = ESTIMATOR.run(FOOT.capacitance_pf(stances(3)), period_s * np.arange(len(T_S)))
        assert forces.force_n.shape == (len(T_S), 3, 3)
        assert not forces.usable[:7].any()
        assert forces.usable[10:].all()
        np.testing.assert_allclose(forces.force_n[10:], stances(3)[10:], atol=0.012)
        assert forces.contact[35:].all()
        assert not forces.contact[:30].any()
        assert (forces.sigma_n[35:] > 0.0).all()


def test_with_the_unloaded_capacitances_the_first_row_has_a_force() -> None:
    """Also of a foot that stands from the beginning, and whose elements are not all as designed."""
    gain_rel = 1.0 + 0.05 * np.linspace(-1.0, 1.0, 9)
    standing_pf = gain_rel * FOOT.capacitance_pf(stances()[30:, 0])
    t_s = T_S[: len(standing_pf)]
    assert not ESTIMATOR.run(standing_pf, t_s).usable.any()
    given_n = footsense.Estimator(unloaded_pf=gain_rel * FOOT.unloaded_pf).run(standing_pf, t_s)
    assert given_n.force_n.shape == (len(t_s), 3)
    assert given_n.usable.all()
    assert given_n.contact[-1]
    np.testing.assert_allclose(given_n.force_n, stances()[30:, 0], atol=0.05)


@pytest.mark.parametrize("name", ["foot-0007", "foot-0007/manifest.json"])
def test_a_calibrated_foot_is_read_by_its_calibration(tmp_path: Path, name: str) -> None:
    """Its strays, its stiffness and its mount; by the design alone it would not be tared at all."""
    turned = parameters().mount
    made = as_designed(
        stray_pf=np.full(9, 0.4),
        unloaded_pf=np.full(9, FOOT.unloaded_pf + 0.4),
        stiffness_rel=0.2,
        mount=turned,
    )
    calibration(tmp_path, parameters=made)
    pf = FOOT.capacitance_pf(stances()[:, 0]) + 0.4
    estimator = footsense.Estimator(calibration=tmp_path / name)
    assert estimator.foot_type == "aoyagi-3x3"
    forces = estimator.run(pf, T_S)
    assert forces.usable[10:].all()
    np.testing.assert_allclose(forces.force_n[10:], stances()[10:, 0] @ (1.2 * turned), atol=0.015)
    assert not ESTIMATOR.run(pf, T_S).usable.any()
    with pytest.raises(ModelError, match="for foot type 'aoyagi-3x3', this robot's feet are 'hexapod-2kg'"):
        footsense.Estimator("hexapod-2kg", calibration=tmp_path / name)


def test_a_calibrated_foot_has_the_forces_and_sigma_of_the_service(tmp_path: Path) -> None:
    """Bit for bit; nobody tells the temperature of either."""
    calibration(tmp_path, parameters=as_designed(stiffness_rel=0.2, mount=parameters().mount))
    bus = Bus(device="sim0", addresses={"lf": 0x2C})
    robot = replace(DEFAULT, buses=(bus,), feet={"lf": "foot-0007"}, calibrations=str(tmp_path))
    service = pipeline_for(load_models(robot), 0)
    cycles = list(islice(Replay(GOLDEN), 200))
    scans = [
        CapFrame(row, scan.t_ns[:1], scan.capacitance_pf[:1], scan.reading[:1])
        for row, scan in enumerate(cycle.scan for cycle in cycles)
    ]
    sent_ns = [cycle.forces.t_sent_ns for cycle in cycles]
    frames = [service.process(*of_time)[0] for of_time in zip(scans, sent_ns, strict=True)]
    forces = footsense.Estimator(calibration=tmp_path / "foot-0007").run(
        [scan.capacitance_pf[0] for scan in scans],
        1e-9 * np.array(sent_ns),
        1e-9 * np.array([scan.t_ns[0] for scan in scans]),
    )
    assert forces.usable[100:].all()
    for name in ("force_n", "sigma_n", "state"):
        np.testing.assert_array_equal(getattr(forces, name), [getattr(frame, name)[0] for frame in frames])


@settings(max_examples=5)
@given(st.permutations(range(4)))
def test_each_foot_is_estimated_by_itself(order: list[int]) -> None:
    """But for how soon its fit at rest is done: there is one round of one foot in each row."""
    pf = FOOT.capacitance_pf(stances(4))
    together, alone = ESTIMATOR.run(pf[:, order], T_S), ESTIMATOR.run(pf[:, order[0]], T_S)
    np.testing.assert_allclose(together.force_n[:, 0], alone.force_n, atol=2e-3)
    np.testing.assert_allclose(together.force_n[-1, 0], alone.force_n[-1], atol=1e-6)
    np.testing.assert_array_equal(together.state[:, 0], alone.state)


def test_an_element_without_readings_makes_a_foot_degraded() -> None:
    pf = FOOT.capacitance_pf(stances(2))
    pf[:, 0, 4] = np.nan
    forces = ESTIMATOR.run(pf, T_S)
    assert forces.state[-1].tolist() == [footsense.State.DEGRADED, footsense.State.VALID]
    assert forces.usable[-1].all()
    np.testing.assert_allclose(forces.force_n[-1, 0], stances(2)[-1, 0], atol=0.1)


def test_a_foot_without_a_force_is_in_contact_with_nothing() -> None:
    """From the row on in which its readings end, though it stood."""
    pf = FOOT.capacitance_pf(stances()[:, 0])
    pf[50:] = np.nan
    forces = ESTIMATOR.run(pf, T_S)
    assert forces.contact.tolist() == [False] * 30 + [True] * 20 + [False] * 10
    assert not forces.usable[50:].any()


WALK_PF = FOOT.capacitance_pf(stances()[:, 0])


@pytest.mark.parametrize(
    ("given_arrays", "message"),
    [
        (
            (WALK_PF[:, :8], T_S),
            r"capacitance_pf: its last axis has the nine elements of a foot; got shape \(60, 8\)",
        ),
        ((WALK_PF[:0], T_S[:0]), r"capacitance_pf: has no readings; got shape \(0, 9\)"),
        ((WALK_PF[0], T_S), r"capacitance_pf: shape \(n, 9\) or \(n, feet, 9\), got \(9,\)"),
        ((WALK_PF, T_S[1:]), r"t_s: a time for each of the 60 rows of readings, got shape \(59,\)"),
        ((WALK_PF, T_S[::-1]), "t_s: the times do not increase"),
        (
            (WALK_PF, np.full(60, np.nan)),
            "t_s: the times do not increase from row to row, or one is not finite",
        ),
        (
            (WALK_PF * 1e3, T_S),
            r"is in pF, about 5 pF of an element; the median is 5.68e\+03, which looks like fF",
        ),
        ((WALK_PF * 1e-12, T_S), "the median is 5.68e-12, which looks like F"),
        ((WALK_PF * np.nan, T_S), "capacitance_pf: has no finite number"),
        ((WALK_PF, T_S, T_S), r"reading_t_s: a time for each reading, shape \(60, 9\), got \(60,\)"),
        (
            (WALK_PF, T_S, np.tile(T_S[:, None] + 0.1, 9)),
            "reading_t_s: a reading is later than the time of its row",
        ),
        ((WALK_PF, T_S, -np.tile(T_S[:, None], 9)), "reading_t_s: the times of an element go back"),
        ((WALK_PF, T_S * 1e3, np.tile(T_S[:, None] * 1e3, 9)), "to its next; are they in ms"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_in_one_line(
    given_arrays: tuple[Vector, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        ESTIMATOR.run(*given_arrays)


def test_a_scanned_walk_without_its_times_is_refused() -> None:
    """Each element would be taken to be as new as the newest."""
    walk = footsense.read(GOLDEN.with_name("small_board.mcap"))
    with pytest.raises(
        ValueError, match=r"give their times too: run\(walk.capacitance_pf, walk.t_s, walk.reading"
    ):
        ESTIMATOR.run(walk.capacitance_pf, walk.t_s)


@pytest.mark.parametrize("kind", [footsense.Foot, footsense.Estimator])
def test_an_unknown_foot_type_is_refused_in_one_line(kind: type) -> None:
    with pytest.raises(ModelError, match="no foot type nobody"):
        kind("nobody")


def test_the_sigma_of_feet_as_made_holds_what_nobody_knows_of_them() -> None:
    """Of 40 feet that stand, the unloaded reading of each given: they err by much, and sigma is not much more."""
    response, force_n = FootResponse.load(released_path("response.npz")), stances(1)
    made = [
        Specimen(response, draw_deviations(response, PAPER_TOLERANCES, 0, number)) for number in range(40)
    ]
    normal: Vector = force_n[:, 0] / np.maximum(np.linalg.norm(force_n, axis=2), 1e-9)
    normal[~force_n[:, 0].any(axis=1)] = (0.0, 0.0, 1.0)
    read_pf = np.stack([foot.capacitance_pf(normal, force_n[:, 0]) for foot in made], axis=1)
    forces = footsense.Estimator(unloaded_pf=[foot.unloaded_pf for foot in made]).run(read_pf, T_S)
    stands = forces.usable & force_n.any(axis=2)
    error_n, sigma_n = (forces.force_n - force_n)[stands], forces.sigma_n[stands]
    assert stands.sum() > 0.9 * force_n.any(axis=2).sum() * len(made)
    assert (np.abs(error_n) < 2.0 * sigma_n).mean() > 0.93
    assert (np.abs(error_n) < 5.0 * sigma_n).mean() > 0.995
    assert np.square(sigma_n).mean() < 1.8**2 * np.square(error_n).mean()
