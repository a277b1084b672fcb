"""The configuration says what it means, and refuses what contradicts itself with the path and the remedy."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from firmware_interface.wire_timing import can_bits_per_s
from footsense.cli.setup.check_config import (
    check_config,
)
from footsense.config import DEFAULT, SMALL_BOARD, load_config
from footsense.config.contradictions import warnings
from footsense.config.sections import Metrics
from footsense.errors import ConfigError
from footsense.frames import LEGS

DEPLOY = Path(__file__).parents[3] / "deploy"

ONE_BUS = """\
board: fdc1004
buses:
  - device: /dev/i2c-1
    legs: {lf: 0, rf: 1}
can: {interface: socketcan}
"""

ADDRESSES = ONE_BUS.replace("legs: {lf: 0, rf: 1}", "addresses: {lf: 0x2C, rf: 0x2D}").replace(
    "fdc1004", "ad7147"
)
MCU = "board: mcu\nserial: {device: sim}\ncan: {interface: virtual}\n"


@pytest.mark.parametrize(
    ("interface", "channel"), [("socketcan", "can0"), ("udp_multicast", "239.74.163.2"), ("virtual", "can0")]
)
def test_the_channel_follows_the_interface(file: Path, interface: str, channel: str) -> None:
    file.write_text(ONE_BUS.replace("socketcan", interface))
    assert load_config(file).can.channel == channel


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "robot.yaml"


@pytest.mark.parametrize(
    "name",
    [
        "footsense.yaml",
        "footsense-two-buses.yaml",
        "footsense-mcu.yaml",
        "footsense-fdc1004.yaml",
    ],
)
def test_the_examples_are_right(name: str) -> None:
    """The example files hold all six legs and nothing to warn of."""
    config = load_config(DEPLOY / name)
    assert config.legs == LEGS == SMALL_BOARD.legs
    assert warnings(config) == ()


def test_the_commented_values_are_the_defaults(file: Path) -> None:
    """What the example calls a default is what an absent key means."""
    file.write_text(ADDRESSES.removeprefix("board: ad7147\n"))
    short, long = load_config(file), load_config(DEPLOY / "footsense.yaml")
    assert (short.board, short.tare, short.max_age_ms) == (long.board, long.tare, long.max_age_ms)
    assert short.effective == long.effective
    assert (short.baseline, short.contact) == (long.baseline, long.contact)
    assert (short.buses[0].mux, short.buses[0].rate_hz) == (long.buses[0].mux, long.buses[0].rate_hz)
    assert long.metrics == Metrics()
    assert short.ring is None


def test_the_default_loads_a_bus_of_500_kbit_by_less_than_40_percent() -> None:
    """All frames of six legs, events of two steps a second included."""
    for robot in (DEFAULT, SMALL_BOARD):
        assert can_bits_per_s(len(robot.legs), robot.forces_hz) < 0.4 * 500_000


@pytest.mark.parametrize(
    ("text", "key", "found"),
    [
        ("model: my.onnx", "model", "my.onnx"),
        ("feet: {lf: foot-0007}\ncalibrations: feet/", "calibrations", "feet"),
        # It keeps a slash, by which it is no released name.
        ("foot_type: ./my-foot", "foot_type", "my-foot"),
    ],
)
def test_a_relative_path_is_one_beside_the_file(
    file: Path, monkeypatch: pytest.MonkeyPatch, text: str, key: str, found: str
) -> None:
    """Wherever the daemon is started, there too."""
    for folder in ("feet/foot-0007", "my-foot"):
        (file.parent / folder).mkdir(parents=True)
    file.write_text(ONE_BUS + text)
    assert getattr(load_config(file), key) == str(file.parent / found)
    monkeypatch.chdir(file.parent)
    assert getattr(load_config(Path(file.name)), key) == str(file.parent / found)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (
            ONE_BUS.replace("socketcan", "vcan"),
            "(a CAN device of Linux: interface: socketcan, channel: can0, or vcan0)",
        ),
        (
            ONE_BUS.replace("fdc1004", "ad7746") + "scan: {rate_sps: 91}",
            ":1: board: the board ad7746 is gone; the last commit that knows it is 27dcc809; use ad7147",
        ),
        (
            ONE_BUS.replace("fdc1004", "fdc1004_columns"),
            ":1: board: the board fdc1004_columns is gone; the last commit that knows it is 0e63fae9; use ad7147",
        ),
        (
            ONE_BUS.replace("socketcan", "socketcan, fd: false"),
            "can.fd: the frames of CAN FD are gone; take this key away: classic frames pass on a bus of CAN FD",
        ),
        (ONE_BUS + "scan: {rate_sps: 300}", ":6: scan.rate_sps: '300' is none of 100, 200, 400"),
        (
            ONE_BUS.replace("rf: 1", "rf: 0"),
            ":4: buses[0].legs.rf: channel 0 is already that of lf; free",
        ),
        (
            ONE_BUS.replace("can:", "  - device: /dev/i2c-2\n    legs: {lf: 2}\ncan:"),
            ":6: buses[1].legs.lf: lf is already a leg of buses[0]",
        ),
        (
            ONE_BUS.replace("can:", "  - device: /dev/i2c-1\n    legs: {lm: 2}\ncan:"),
            ":5: buses[1].device: /dev/i2c-1 is already the device of buses[0]",
        ),
        (
            "board: mcu\ncan: {interface: virtual}",
            "board: mcu needs the line to the microcontroller: serial: {device: ...}",
        ),
        (
            ONE_BUS.replace("fdc1004", "mcu") + "serial: {device: sim}",
            ":2: buses: the board mcu has no I2C bus; take buses away, or use another board",
        ),
        ("can: {interface: virtual}", "the board ad7147 is read over I2C: name its buses, with their legs"),
        (MCU + "scan: {rate_sps: 100}", "scan: the microcontroller scans at serial.rate_hz"),
        (
            MCU + "publish_every: 1",
            "publish_every: every record of the microcontroller is published; take pu",
        ),
        (MCU + "max_age_ms: 6", "max_age_ms: a scan takes 5 ms and more: every force"),
        (MCU.replace("sim", "sim, legs: [lf, rf, lf]"), "serial.legs[2]: lf is named twice"),
        (ONE_BUS + "feet: {lf: foot-0001, rf: foot-0001}", "feet.rf: foot-0001 is already mounted on lf"),
        (ONE_BUS + "calibrations: feet/", "calibrations: no foot is named; name them under feet"),
        (ONE_BUS + "feet: {lf: foot-0007}\ncalibrations: feet/", ":6: feet.lf: "),
        (ONE_BUS + "foot_type: ./my-foot", ":6: foot_type: no foot type ./my-foot: "),
        (
            ONE_BUS + "feet: {lf: foot-0001}\ncalibrations: feet/\nmodel: my.onnx",
            "model: each calibration brings the network that it was fitted on; take model or calibrations away",
        ),
        (
            ONE_BUS.replace("legs: {lf: 0, rf: 1}", "leg: lf\n    legs: {rf: 1}"),
            "buses[0].legs: name its legs with their channels of the multiplexer, under leg the one",
        ),
        (
            ADDRESSES.replace("0x2D", "0x2C"),
            ":4: buses[0].addresses.rf: address 0x2c is already that of lf; free are 0x2d, 0x2e, 0x2f",
        ),
        (ADDRESSES.replace("0x2D", "0x30"), "0x2c to 0x2f, by the straps ADD0 and ADD1 of an AD7147"),
        (
            ADDRESSES.replace("ad7147", "fdc1004"),
            "buses[0].addresses: the converters of board fdc1004 have one address; name channels of a",
        ),
        (
            ADDRESSES + "scan: {rate_sps: 200}",
            ":6: scan: the board ad7147 converts at one rate; take scan away",
        ),
        (
            ONE_BUS.replace("legs: {lf: 0, rf: 1}", "leg: lf\n    mux: {address: 0x72}"),
            "buses[0].mux: its legs are directly on the adapter; take mux away",
        ),
        (
            ONE_BUS.replace("can:", "  - {device: sim, leg: lm}\ncan:"),
            "buses[1].device: simulated and real buses cannot be mixed",
        ),
        (
            ONE_BUS.replace("{lf: 0, rf: 1}", "{lf: 0, rf: 1, lm: 2, rm: 3}") + "publish_every: 1",
            "400 forces/s take 444 kbit/s, more than 70% of 500 kbit/s; use 1000000, or publish_every: 2",
        ),
        (ONE_BUS + "feet: {lm: foot-0001}", "feet.lm: no bus has the leg lm; the legs are lf, rf"),
        (
            ONE_BUS + "foot_type: quadruped",
            "robot.yaml:6: foot_type: no foot type quadruped: did you mean quadruped-12kg? there are aoyagi-3x3, ",
        ),
        (
            ONE_BUS + "foot_type: hexapod_2kg",
            "no foot type hexapod_2kg: did you mean hexapod-2kg? there are ",
        ),
        (
            ONE_BUS.split("can:", maxsplit=1)[0],
            "robot.yaml:1: the key can is missing: a section of keys (interface: socketcan, channel: can0 on a robot)",
        ),
    ],
)
def test_a_contradiction_names_its_path_and_remedy(file: Path, text: str, wanted: str) -> None:
    """Settings that cannot work together are refused where they stand in the file."""
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config(file)
    assert wanted in str(caught.value)


@pytest.mark.parametrize(
    ("text", "warned_of"),
    [
        (ONE_BUS.replace("can:", "    mux: {address: 0x70}\ncan:"), ["buses[0].mux.address"]),
        (MCU.replace("sim", "/dev/ttyACM0"), ["serial.device", "can.interface"]),
        (ONE_BUS + "metrics: {address: 0.0.0.0}", ["metrics.address"]),
    ],
)
def test_what_is_allowed_but_often_a_mistake_is_warned_of(
    file: Path, text: str, warned_of: list[str]
) -> None:
    """0x70 works until somebody adds a servo board; a port may change its name; metrics have no password."""
    file.write_text(text)
    assert [warning.partition(":")[0] for warning in warnings(load_config(file))] == warned_of


def test_check_config_refuses_a_ring_that_would_replace_a_file(tmp_path: Path) -> None:
    other, file = tmp_path / "passwd", tmp_path / "robot.yaml"
    other.write_text("root:x:0:0\n")
    file.write_text(f"{ONE_BUS}ring: {other}\n")
    result = CliRunner().invoke(check_config, [str(file)])
    assert str(result.exception) == f"{other}: holds something else than footsense's cycles"
    other.unlink()
    assert CliRunner().invoke(check_config, [str(file)]).exit_code == 0


def test_check_config_explains_a_file(file: Path) -> None:
    """Where each leg is, where its forces go, how much of CAN that takes, and what to expect of feet as they come."""
    said = said_of(DEPLOY / "footsense-two-buses.yaml")
    assert "/dev/i2c-3 board fdc1004, multiplexer 0x71, channels rf 0, rm 1, rr 2" in said
    of_addresses = said_of(DEPLOY / "footsense.yaml")
    assert "/dev/i2c-3 board ad7147, addresses rf 0x2c, rm 0x2d, rr 0x2e" in of_addresses
    assert "CAN can0, of whose 500 kbit/s up to 36 % are taken" in said
    assert "page http://127.0.0.1:8765, " in said
    assert (
        "no foot named on lf, lm, lr, rf, rm, rr: uncalibrated, expect errors of 17 deg in direction and 17% in size"
        in said
    )
    assert "feet of type aoyagi-3x3" in said
    assert "range normal loads up to 0.648 N if the force leans 14 deg, 0.363 N if 30" in said
    assert (
        "overload with one to three overloaded elements the force is less exact, with more there is none"
        in said
    )
    assert "no force above 2 N, the largest of the training" in said
    assert "forces up to 100 forces/s on CAN of each leg" in said
    assert "force step" not in said
    assert "max age" not in said
    file.write_text(ONE_BUS + "foot_type: quadruped-12kg\n")
    said = said_of(file)
    assert "; force step 10 mN" in said
    assert "expect errors of 17 deg in direction and 18% in size" in said
    file.write_text(ONE_BUS + "feet: {rf: foot-0007}\n")
    said = said_of(file)
    assert "no foot named on lf: uncalibrated, expect" in said
    assert "no calibration of foot-0007 on rf: uncalibrated, expect" in said
    settings = json.loads(CliRunner().invoke(check_config, [str(file), "--json"]).stdout)
    assert (settings["uncalibrated"], settings["max_age_ms"]) == (["lf", "rf"], 90)


def test_a_file_of_something_else_is_told_as_what_it_is() -> None:
    file = DEPLOY / "test-stand.yaml"
    result = CliRunner().invoke(check_config, [str(file)])
    assert isinstance(result.exception, ConfigError)
    assert str(result.exception) == (
        f"{file}: is a test stand's file, not a robot's: footsense test-stand record --reference {file}"
    )


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ("/dev/i2c-1", 'buses[0].device: "i2c-1" is wrong; it has to be text such as /dev/i2c-1, or sim'),
        ("socketcan}", 'can.channel: "a/b" is wrong; it has to be a network interface such as can0'),
    ],
)
def test_a_text_that_does_not_fit_is_answered_with_one_that_does(file: Path, wrong: str, says: str) -> None:
    file.write_text(ONE_BUS.replace(wrong, {"/dev/i2c-1": "i2c-1"}.get(wrong, "socketcan, channel: a/b}")))
    with pytest.raises(ConfigError) as caught:
        load_config(file)
    assert str(caught.value).endswith(says)


def said_of(file: Path) -> str:
    result = CliRunner().invoke(check_config, [str(file)])
    assert result.exit_code == 0, result.output
    return " ".join(result.output.split())
