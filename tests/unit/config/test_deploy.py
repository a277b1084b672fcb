"""The files in `deploy/` say what the service needs, in a form that systemd and udev read."""

import re
import shutil
import subprocess
from configparser import RawConfigParser
from pathlib import Path

import pytest

from footsense.cli.setup.install import _TARGETS
from footsense.errors import ConfigError, FootsenseError, ModelError
from footsense.recording.fault_recordings import FAULT_FOLDER
from footsense.sim.can.interface import AS_DEPLOYED
from footsense.telemetry.electrodes import STATE_FOLDER
from footsense.telemetry.feet import ODOMETER_FILE

DEPLOY = Path(__file__).parents[3] / "deploy"
UNIT, EXPORTER = DEPLOY / "footsense.service", DEPLOY / "footsense-exporter.service"
SELFCAL = DEPLOY / "footsense-selfcal.service"
SNAPSHOT = DEPLOY / "footsense-snapshot.service"
VIEW = DEPLOY / "footsense-view.service"
ROS2 = DEPLOY / "footsense-ros2.service"
UNITS = (UNIT, EXPORTER, VIEW, ROS2, SELFCAL, SNAPSHOT)


def parsed(path: Path) -> RawConfigParser:
    """Return a systemd file's sections; keys keep their case, and one that is set twice is an error.

    Exceptions from a list, as of system calls, are a key of their own.
    """
    parser = RawConfigParser(delimiters=("=",), comment_prefixes=("#",), interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(path.read_text().replace("=~", "~="))
    return parser


def test_the_service_is_watched_and_started_again() -> None:
    """The supervisor hears when forces come, restarts a loop that hangs or fails, and not a wrong configuration."""
    service = parsed(UNIT)["Service"]
    assert service["Type"] == "notify"
    assert int(service["WatchdogSec"]) > 0
    assert service["Restart"] == "on-failure"
    assert service["RestartPreventExitStatus"].split() == ["2", "66", "78"]
    assert {ConfigError.exit_code, ModelError.exit_code} == {66, 78}
    assert service["KillMode"] == "mixed"
    assert (
        service["ExecStart"] == "/opt/footsense/bin/footsense -v run --config /etc/footsense/footsense.yaml"
    )


@pytest.mark.parametrize(
    ("unit", "command"),
    [
        (EXPORTER, "exporter"),
        (VIEW, "view"),
        (ROS2, "ros2"),
        (SELFCAL, "selfcal"),
        (SNAPSHOT, "snapshot --of-faults /var/lib/footsense/faults"),
    ],
)
def test_exporter_and_page_always_come_back_and_may_do_little(unit: Path, command: str) -> None:
    """Each restarts whatever ended it, takes no time of the loop, and reaches loopback, CAN and memory at most."""
    exporter, service = parsed(unit)["Service"], parsed(UNIT)["Service"]
    assert exporter["Restart"] == "always"
    assert (
        exporter["ExecStart"]
        == f"/opt/footsense/bin/footsense {command} --config /etc/footsense/footsense.yaml"
    )
    assert exporter["User"] == service["User"]
    assert exporter["RestrictRealtime"] == "yes"
    assert "CPUSchedulingPolicy" not in exporter
    families = "none" if unit in {SELFCAL, SNAPSHOT} else "AF_INET AF_INET6"
    allowed = "AF_UNIX AF_CAN AF_INET AF_INET6 AF_NETLINK" if unit == ROS2 else families
    assert exporter["RestrictAddressFamilies"] == allowed
    hardened = {
        key for key in service if key.startswith(("Protect", "Restrict", "Private", "NoNew", "Capab"))
    }
    assert all(exporter[key] == service[key] for key in hardened - {"RestrictAddressFamilies"})


def test_no_unit_takes_the_memory_of_the_robot() -> None:
    """Each has a bound, the loop's the largest."""
    bounds = [parsed(unit)["Service"]["MemoryMax"] for unit in UNITS]
    assert bounds == ["512M", "256M", "256M", "256M", "256M", "256M"]


@pytest.mark.parametrize(
    ("unit", "folder"),
    [(EXPORTER, ODOMETER_FILE.parent), (SELFCAL, STATE_FOLDER), (SNAPSHOT, FAULT_FOLDER)],
)
def test_what_a_program_keeps_is_where_its_unit_lets_it_write(unit: Path, folder: Path) -> None:
    assert Path("/var/lib") / parsed(unit)["Service"]["StateDirectory"] == folder


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")
@pytest.mark.parametrize("unit", UNITS)
def test_systemd_has_no_complaint(tmp_path: Path, unit: Path) -> None:
    """The supervisor knows every key, once the program stands where the unit says."""
    copy = tmp_path / unit.name
    copy.write_text(unit.read_text().replace("/opt/footsense/bin/footsense", "/bin/true"))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(copy)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert [line for line in done.stderr.splitlines() if unit.name in line] == []


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")
@pytest.mark.parametrize("unit", UNITS)
def test_a_service_that_was_taken_over_may_do_little(unit: Path) -> None:
    """By systemd's own measure: an exposure of 10 is an ordinary service, and these have at most 1.5."""
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=yes", "--no-pager", "--threshold=15", str(unit)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, [line for line in done.stdout.splitlines() if not line.startswith("✓")]


def test_can0_comes_up_by_itself_and_keeps_no_old_frame() -> None:
    """The bit rate is footsense's default, and the rest is what the simulation of a breaking bus is about."""
    network = parsed(DEPLOY / "80-can0.network")
    can, one_shot = network["CAN"], parsed(DEPLOY / "80-can0-one-shot.conf")["CAN"]
    assert (network["Match"]["Name"], can["BitRate"]) == ("can0", "500000")
    assert can["RestartSec"] == f"{AS_DEPLOYED.restart_ns // 1_000_000}ms"
    # Many adapters have no one-shot mode, and stay down with it.
    assert "OneShot" not in can
    assert dict(one_shot) == {"OneShot": "yes"}
    assert AS_DEPLOYED.one_shot
    assert int(network["PFIFOHeadDrop"]["PacketLimit"]) == AS_DEPLOYED.queue_frames
    assert AS_DEPLOYED.head_drop


def test_gs_usb_has_the_same_settings_but_for_what_it_does_not_know() -> None:
    """Its file comes first, matches that driver alone, and asks for no restart after bus-off."""
    other, gs_usb = parsed(DEPLOY / "80-can0.network"), parsed(DEPLOY / "79-can0-gs_usb.network")
    assert gs_usb["Match"].pop("Driver") == "gs_usb"
    assert other["CAN"].pop("RestartSec")
    assert {name: dict(gs_usb[name]) for name in gs_usb} == {name: dict(other[name]) for name in other}


def test_a_missing_device_delays_the_boot_by_less_than_five_seconds() -> None:
    """Each device that the unit waits for gets the short timeout; systemd's own is 90 s."""
    unit, timeouts = parsed(UNIT)["Unit"], parsed(DEPLOY / "footsense-device.conf")["Unit"]
    assert float(timeouts["JobTimeoutSec"]) == float(timeouts["JobRunningTimeoutSec"]) < 5
    short = [path.split("/")[-2].removesuffix(".d") for path in _TARGETS["footsense-device.conf"]]
    assert short == unit["Wants"].split() == unit["After"].split()


def test_a_drop_in_adds_to_what_the_unit_allows() -> None:
    """Its group beside i2c, its devices beside the adapters."""
    for name, group, devices in (("serial", "dialout", "char-tty"), ("mux-reset", "gpio", "char-gpiochip")):
        lines = (DEPLOY / f"footsense-{name}.conf").read_text().splitlines()
        section, *settings = [line for line in lines if not line.startswith("#")]
        assert section == "[Service]"
        assert settings[0] == f"SupplementaryGroups={group}"
        assert all(re.fullmatch(rf"DeviceAllow={devices}\w* rw", line) for line in settings[1:])
        assert len(settings) > 1


def test_the_page_has_every_exit_code_and_none_is_systemd_s() -> None:
    """The labels of systemd begin at 2; from 64 to 78 it shows those of sysexits.h."""
    kinds: list[type[FootsenseError]] = [FootsenseError, *FootsenseError.__subclasses__()]
    codes = {kind.exit_code for kind in kinds}
    page = (DEPLOY.parent / "docs/troubleshooting.md").read_text()
    listed = re.findall(r"^\| (\d+)(?: `\w+`)? \|", page, re.MULTILINE)
    assert {str(code) for code in codes} | {"0", "2", "130"} == set(listed)
    assert all(64 <= code <= 78 for code in codes - {1})
