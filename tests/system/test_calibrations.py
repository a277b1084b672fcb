"""The daemon with calibrations: feet as they were made say what they feel, also when warm; another foot gives none."""

import json
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from footsense.can.interface import Can
from footsense.cli.recordings import replay
from footsense.cli.setup.check_config import check_config
from footsense.clock import wall_time_iso
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.daemon.estimation import mounted_feet
from footsense.daemon.foot_types import released_path
from footsense.daemon.models import load_calibrations, load_models
from footsense.daemon.service import open_service
from footsense.errors import ModelError
from footsense.foot.network_card import add_checksum
from footsense.foot.parameters import UNKNOWN_TEMPERATURE_SIGMA_REL
from footsense.frames import Cycle, Leg, State
from footsense.recording.replay import Replay
from footsense.sim.scene import Effects, Scene, Warming
from footsense.sim.scene_loads import Constant
from tests.support.calibrations import calibration
from tests.support.cycles import without_temperatures
from tests.support.seen import Seen
from tests.system.simulated_test_stand import MADE, true_parameters

FORCE_N = (0.3, -0.2, 0.7)
ROOM_C, KELVIN = 25.0, 20.0

#: Two feet of one batch, with the same load.
SCENE = Scene(description="pressed", load=Constant(force_n=FORCE_N), lead_in_s=0.6, fabrication=MADE)
UNTIL_NS = 900_000_000


def warm(from_s: float, over_s: float) -> Scene:
    """Return a scene in which feet carry half of that from 2 s on, and become warm."""
    effects = Effects(warming=Warming(from_s=from_s, over_s=over_s, kelvin=KELVIN))
    load = Constant(force_n=(0.2, -0.1, 0.5))
    return Scene(description="pressed", load=load, lead_in_s=2.0, fabrication=MADE, effects=effects)


def config(feet: Path, **mounted: str) -> Config:
    return Config(
        buses=(Bus(device="sim", legs={"lf": 0, "rf": 1}),),
        can=Can(interface="virtual"),
        feet=msgspec.convert(mounted, dict[Leg, str]),
        calibrations=str(feet),
    )


def write_both(feet: Path, **given: Any) -> Path:
    """Write the calibrations of both feet, as a perfect calibration would that was made just now."""
    given = {"made": wall_time_iso()} | given
    for number in (0, 1):
        calibration(feet, f"foot-000{7 + number}", parameters=true_parameters(number), **given)
    return feet


def run(
    robot: Config, scene: Scene = SCENE, until_ns: float = UNTIL_NS, record: Path | None = None
) -> list[Cycle]:
    """Run until both feet have been pressed for a while; of feet that become warm, their temperature is told."""
    seen = Seen()
    with open_service(robot, scene, record=record, real_time=False) as service:
        if warming := scene.effects.warming:
            service.temperature_c = lambda: np.full(
                2, ROOM_C + warming.temperature_change_k_at(service.clock.now_ns())
            )
        service.observers.append(seen)
        service.run(until_ns=until_ns)
    return seen.cycles


def test_feet_with_calibrations_say_what_they_feel(tmp_path: Path) -> None:
    """Both legs valid, and within the sum of what calibration and network may leave.

    Sigma is that of a foot whose temperature nobody knows, 2.5 % of the force, and little else.
    """
    write_both(tmp_path)
    robot = config(tmp_path, lf="foot-0007", rf="foot-0008")
    forces = run(robot)[-1].forces
    assert forces.state.tolist() == [State.VALID, State.VALID]
    assert np.abs(forces.force_n - FORCE_N).max() < 0.02
    assert forces.sigma_n.max() < 0.06 * np.linalg.norm(FORCE_N)
    without = msgspec.structs.replace(
        robot, calibrations=None, tare=msgspec.structs.replace(robot.tare, unloaded_limit_rel=1.0)
    )
    assert np.abs(run(without)[-1].forces.force_n - FORCE_N).max() > 0.05


def test_another_foot_is_found_by_its_fingerprint(tmp_path: Path) -> None:
    """Feet that were swapped give no force: what they read unloaded is not what the calibrations of their legs say."""
    write_both(tmp_path)
    cycles = run(config(tmp_path, lf="foot-0008", rf="foot-0007"))
    assert cycles[-1].forces.state.tolist() == [State.NO_BASELINE, State.NO_BASELINE]
    assert np.isnan(cycles[-1].forces.force_n).all()
    first = next(outcome for cycle in cycles for outcome in cycle.ended_commands)
    assert first.reason.startswith("the foot is not unloaded, or another than foot-0008: element ")


def test_calibrations_that_cannot_be_used(tmp_path: Path) -> None:
    """A foot without a calibration, and two that were fitted on different networks."""
    write_both(tmp_path)
    with pytest.raises(ModelError, match="foot-0009: no such calibration"):
        load_calibrations(config(tmp_path, lf="foot-0009"))
    other = tmp_path / "other.onnx"
    other.write_bytes(
        add_checksum(released_path("network.onnx").read_bytes()[:-86] + b"\x72\x04\x0a\x00\x12\x00")
    )
    calibration(tmp_path, "foot-0010", network=other)
    with pytest.raises(ModelError, match=r"foot-0010: fitted on network .* a robot has one network"):
        load_calibrations(config(tmp_path, lf="foot-0008", rf="foot-0010"))


def test_a_leg_without_a_named_foot_is_told_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """It goes on as before, by the design."""
    write_both(tmp_path)
    assert list(load_calibrations(config(tmp_path, rf="foot-0008"))) == ["rf"]
    assert "lf: no foot is named under feet" in caplog.text


def test_a_foot_that_has_no_calibration_yet(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """It is read as designed if its unloaded readings are configured; a calibration that is there has its own."""
    write_both(tmp_path)
    robot = msgspec.structs.replace(
        config(tmp_path, lf="foot-0009", rf="foot-0008"), unloaded_pf={"lf": (5.0,) * 9, "rf": (9.0,) * 9}
    )
    models = load_models(robot)
    assert list(models.calibrations_by_leg) == ["rf"]
    assert "lf: foot-0009 has no calibration in" in caplog.text
    left, right = mounted_feet(models).unloaded_pf
    assert left.tolist() == [5.0] * 9
    assert right.max() < 8.0


def test_check_config_lists_the_calibrations(tmp_path: Path) -> None:
    """Which foot, since when, on how many loads, and how good."""
    write_both(tmp_path / "feet", made="2026-03-01T12:00:00Z")
    file = tmp_path / "robot.yaml"
    file.write_text(
        "buses: [{device: sim, legs: {lf: 0, rf: 1}}]\ncan: {interface: virtual}\n"
        "feet: {lf: foot-0007, rf: foot-0008}\ncalibrations: feet\n"
    )
    said = json.loads(CliRunner().invoke(check_config, [str(file), "--json"]).stdout)["calibrations"]["lf"]
    assert (said["foot"], said["made"], said["n_loads"]) == ("foot-0007", "2026-03-01T12:00:00Z", 362)
    assert said["held_out"]["calibrated"]["direction_deg"] == 1.5
    assert said["held_out"]["design_only"]["magnitude_gf"] == 18.7


def test_a_recording_knows_its_calibrations(tmp_path: Path) -> None:
    """Replayed later with the same calibrations it gives the same; with others it says so, or refuses to compare."""
    feet, walk = tmp_path / "feet", tmp_path / "walk.mcap"
    write_both(feet)
    run(config(feet, lf="foot-0007", rf="foot-0008"), record=walk)
    result = CliRunner().invoke(replay, [str(walk), "--check"])
    assert "cycles equal bit for bit" in result.output, result.exception
    elsewhere = tmp_path / "elsewhere"
    feet.rename(elsewhere)
    result = CliRunner().invoke(replay, [str(walk), "--check"])
    assert "foot-0007: no such calibration" in str(result.exception)
    result = CliRunner().invoke(replay, [str(walk), "--check", "--calibrations", str(elsewhere)])
    assert "cycles equal bit for bit" in result.output, result.exception
    calibration(tmp_path / "new", "foot-0007", parameters=true_parameters(0), n_loads=20)
    calibration(tmp_path / "new", "foot-0008", parameters=true_parameters(1))
    result = CliRunner().invoke(replay, [str(walk), "--check", "--calibrations", str(tmp_path / "new")])
    assert "lf was recorded with the calibration " in str(result.exception)
    result = CliRunner().invoke(replay, [str(walk), "--calibrations", str(tmp_path / "new")])
    assert (result.exit_code, "warning: " in result.stderr) == (0, True)


def test_a_known_temperature_corrects_and_an_unknown_one_widens(tmp_path: Path) -> None:
    """20 K make forces 8 % too small; sigma covers it where they are not known."""
    size_n = float(np.linalg.norm((0.2, -0.1, 0.5)))
    # Warm before the tare, so that only the rubber is another one.
    at_start = warm(from_s=0.0, over_s=0.01)
    known, unknown = (
        run(
            config(write_both(tmp_path / name, temperature_c=at_c), lf="foot-0007", rf="foot-0008"),
            at_start,
            3e9,
        )[-1].forces
        for name, at_c in (("known", ROOM_C), ("unknown", None))
    )
    for forces in (known, unknown):
        assert forces.state.tolist() == [State.VALID, State.VALID]
    known_n, unknown_n = (np.linalg.norm(forces.force_n, axis=1) for forces in (known, unknown))
    assert np.abs(known_n / size_n - 1.0).max() < 0.025
    np.testing.assert_allclose(unknown_n / size_n, 1.0 / 1.088, atol=0.02)
    assert (unknown.sigma_n[:, 2] > UNKNOWN_TEMPERATURE_SIGMA_REL * unknown.force_n[:, 2]).all()
    assert (known.sigma_n[:, 2] < unknown.sigma_n[:, 2]).all()


@pytest.mark.slow
def test_a_replay_is_as_warm_as_the_walk_was(tmp_path: Path) -> None:
    """Temperatures are recorded when they change; without them the same readings give other sigmas from the start."""
    walk = tmp_path / "walk.mcap"
    robot = config(write_both(tmp_path / "feet", temperature_c=ROOM_C), lf="foot-0007", rf="foot-0008")
    cycles = run(robot, warm(from_s=2.2, over_s=0.1), 2.6e9, walk)  # while they carry
    told = [cycle.temperature_c for cycle in cycles if cycle.temperature_c is not None]
    assert 2 < len(told) < 50
    np.testing.assert_allclose(told[-1] - told[0], KELVIN)
    recorded = [cycle.temperature_c for cycle in Replay(walk) if cycle.temperature_c is not None]
    np.testing.assert_array_equal(recorded, told)
    result = CliRunner().invoke(replay, [str(walk), "--check"])
    assert "cycles equal bit for bit" in result.output, result.exception
    old = without_temperatures(walk, tmp_path / "old.mcap")
    assert CliRunner().invoke(replay, [str(old)]).output == f"{len(cycles)} cycles replayed\n"
    result = CliRunner().invoke(replay, [str(old), "--check"])
    assert re.search(r"leg lf: sigma_[xyz]_n was", str(result.exception))
