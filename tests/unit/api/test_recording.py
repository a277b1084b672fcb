"""Walks as arrays: those of a file are what the file holds, and a simulated one knows the truth."""

import sys
from pathlib import Path

import numpy as np
import pytest

import footsense
from footsense.errors import ConfigError, RecordingError
from footsense.frames import GaitEventKind
from footsense.recording.replay import Replay

GOLDEN = Path(__file__).parents[2] / "golden" / "measured_walk.mcap"


@pytest.fixture(scope="module")
def golden() -> footsense.Recording:
    return footsense.read(GOLDEN)


@pytest.fixture(scope="module")
def simulated() -> footsense.Recording:
    return footsense.simulate("tripod", duration_s=1.6)


def test_the_arrays_are_those_of_the_file(golden: footsense.Recording) -> None:
    cycles = list(Replay(GOLDEN))
    n, start_ns = len(cycles), cycles[0].forces.t_sent_ns
    assert golden.legs == ("lf", "lm", "lr", "rf", "rm", "rr")
    assert golden.force_n.shape == golden.sigma_n.shape == (n, 6, 3)
    assert golden.capacitance_pf.shape == golden.reading_t_s.shape == (n, 6, 9)
    assert golden.true_force_n is None
    for k in (0, 300, n - 1):
        forces, scan = cycles[k].forces, cycles[k].scan
        assert golden.t_s[k] == (forces.t_sent_ns - start_ns) * 1e-9
        np.testing.assert_array_equal(golden.force_n[k], forces.force_n)
        np.testing.assert_array_equal(golden.sigma_n[k], forces.sigma_n)
        np.testing.assert_array_equal(golden.state[k], forces.state)
        np.testing.assert_array_equal(golden.capacitance_pf[k], scan.capacitance_pf)
        read = scan.t_ns != 0
        np.testing.assert_array_equal(golden.reading_t_s[k][read], (scan.t_ns[read] - start_ns) * 1e-9)
        assert np.isnan(golden.reading_t_s[k][~read]).all()
    assert np.isfinite(golden.force_n[golden.usable]).all()
    assert np.isnan(golden.force_n[~golden.usable]).all()


def test_the_events_are_those_of_the_file_on_the_axis_of_the_cycles(golden: footsense.Recording) -> None:
    cycles = list(Replay(GOLDEN))
    start_ns = cycles[0].forces.t_sent_ns
    told = [event for cycle in cycles if cycle.forces.gait for event in cycle.forces.gait.events]
    assert [(event.t_s, event.leg, event.kind) for event in golden.events] == [
        ((event.t_ns - start_ns) * 1e-9, golden.legs[event.leg], GaitEventKind(event.kind).name.lower())
        for event in told
    ]
    first = next(event for event in golden.events if event.kind == "touchdown")
    row, leg = int(np.searchsorted(golden.t_s, first.t_s + 0.1)), golden.legs.index(first.leg)
    assert golden.contact[row, leg]


def test_what_is_cut_short_is_read_as_far_as_it_is_whole(tmp_path: Path) -> None:
    cut = tmp_path / "walk.mcap.partial"
    cut.write_bytes(GOLDEN.read_bytes()[:200_000])
    with pytest.warns(UserWarning, match=r"walk.mcap.partial: cut short or damaged at byte \d+") as warned:
        walk = footsense.read(cut)
    assert 100 < len(walk.t_s) < 585
    assert warned[0].filename == __file__
    cut.write_bytes(GOLDEN.read_bytes()[:3000])
    with pytest.raises(RecordingError, match="cut"):
        footsense.read(cut)


def test_a_simulated_walk_has_the_force_that_each_foot_felt(simulated: footsense.Recording) -> None:
    assert simulated.true_force_n is not None
    assert simulated.true_force_n.shape == simulated.force_n.shape
    assert simulated.t_s[0] == 0.0
    assert 1.5 < simulated.t_s[-1] < 1.6
    standing = simulated.contact & (simulated.t_s > 1.2)[:, None]
    error_n = np.linalg.norm(simulated.force_n - simulated.true_force_n, axis=-1)[standing]
    assert standing.sum() > 100
    assert np.sqrt((error_n**2).mean()) < 0.03


def test_a_robot_of_a_file_walks_without_its_can_and_ring(tmp_path: Path) -> None:
    """Its frames would reach the controller of the robot, and its cycles the readers of its service."""
    robot = tmp_path / "robot.yaml"
    ring = tmp_path / "ring"
    robot.write_text(
        f"buses: [{{device: /dev/i2c-1, legs: {{lf: 0, rf: 1}}}}]\n"
        f"can: {{interface: socketcan, channel: can9}}\nring: {ring}\n"
    )
    walk = footsense.simulate("hanging", duration_s=0.2, config=robot)
    assert walk.legs == ("lf", "rf")
    assert not ring.exists()


def test_wrong_simulations_are_refused_in_one_line() -> None:
    with pytest.raises(ConfigError, match="no scene 'tripot': there are faults, hanging"):
        footsense.simulate("tripot")
    with pytest.raises(ValueError, match="duration_s is above 0, got 0"):
        footsense.simulate(duration_s=0.0)


@pytest.mark.slow  # pandas is imported
def test_a_table_has_a_row_for_each_cycle_and_leg(simulated: footsense.Recording) -> None:
    table = simulated.to_dataframe()
    n, n_legs = simulated.state.shape
    assert len(table) == n * n_legs
    assert simulated.true_force_n is not None
    one = table[table.leg == "rm"]
    np.testing.assert_array_equal(one.t_s, simulated.t_s)
    np.testing.assert_array_equal(one.fz_n, simulated.force_n[:, 4, 2])
    np.testing.assert_array_equal(one.sigma_x_n, simulated.sigma_n[:, 4, 0])
    np.testing.assert_array_equal(one.true_fy_n, simulated.true_force_n[:, 4, 1])
    np.testing.assert_array_equal(one.capacitance_pf_7, simulated.capacitance_pf[:, 4, 7])
    assert (one.state == "VALID").tolist() == (simulated.state[:, 4] == footsense.State.VALID).tolist()
    assert one.usable.tolist() == simulated.usable[:, 4].tolist()


def test_without_pandas_the_error_says_what_to_install(
    simulated: footsense.Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(
        footsense.FootsenseError, match=r"^to_dataframe\(\) needs pandas: pip install pandas$"
    ):
        simulated.to_dataframe()


def test_a_scene_for_other_feet_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """The loads of a hexapod of 2 kg are far beyond the paper's foot."""
    footsense.simulate("hexapod_2kg", duration_s=0.1)
    [told] = caplog.messages
    assert told.endswith(
        "its loads are for foot type hexapod-2kg; these feet, aoyagi-3x3, may be overloaded by them, or not feel them; "
        "set foot_type: hexapod-2kg in the file of --config"
    )
