"""`footsense install` in a folder in place of a root directory, with a fake of the programs that it calls."""

import errno
import hashlib
import tomllib
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from footsense.cli.setup import install
from footsense.cli.setup.install import installed
from footsense.cli.setup.installed_files import InstalledFiles
from footsense.errors import ConfigError, FootsenseError

ROOT = Path(__file__).parents[3]
UNITS = "etc/systemd/system"
UNIT = f"{UNITS}/footsense.service"
BUS = "device: /dev/i2c-1, legs: {lf: 0}"
CAN = "can: {interface: socketcan, channel: can0}\n"


class FakePrograms:
    """systemctl and others: they note their commands, know which units are enabled and active, and fail if told to."""

    def __init__(self) -> None:
        self.commands: list[str] = []
        self.enabled: set[str] = set()
        self.active: set[str] = set()
        self.failing = ""

    def run(self, command: tuple[str, ...]) -> str:
        words = [word for word in command[1:] if not word.startswith("-")]
        if words[:1] == ["is-enabled"]:
            return "" if words[1] in self.enabled else "exit 1"
        if words[:1] == ["is-active"]:
            return "" if words[1] in self.active else "exit 3"
        line = " ".join(command)
        if self.failing and self.failing in line:
            return "Failed: no such thing"
        self.commands.append(line)
        if words[:1] == ["enable"]:
            self.enabled |= {*words[1:]}
        if words[:1] == ["disable"]:
            self.enabled -= {word.removesuffix(".service") for word in words[1:]}
        return ""


class Computer:
    """A running system in a folder."""

    def __init__(self, root: Path) -> None:
        self.root, self.programs = root, FakePrograms()
        for path in ("bin/sh", "usr/bin/systemctl", "opt/footsense/bin/footsense"):
            self.write(path, "\x7fELF\x02")
        self.write("dev/i2c-1", "")
        self.adapter("can0", "mcp251xfd")

    def write(self, path: str, text: str) -> None:
        (self.root / path).parent.mkdir(parents=True, exist_ok=True)
        (self.root / path).write_text(text)

    def adapter(self, name: str, driver: str) -> None:
        self.write(f"sys/class/net/{name}/type", "280\n")
        device = self.root / f"sys/class/net/{name}/device"
        device.mkdir()
        (device / "driver").symlink_to(f"../../../drivers/{driver}")

    def configure(self, text: str) -> None:
        self.write("etc/footsense/footsense.yaml", text)

    def install(self, *, remove: bool = False, dry_run: bool = False) -> list[str]:
        return [*self.steps(remove=remove, dry_run=dry_run)]

    def steps(self, *, remove: bool = False, dry_run: bool = False) -> Generator[str, None, None]:
        """Yield what is said of each step before it is done."""
        run = self.programs.run
        yield from installed(self.root, run, is_running=True, remove=remove, dry_run=dry_run)

    @property
    def files(self) -> dict[str, str]:
        """Content of all files under etc, by path."""
        etc = self.root / "etc"
        return {str(path.relative_to(etc)): path.read_text() for path in etc.rglob("*") if path.is_file()}


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path)


def deployed() -> Iterator[tuple[str, Path]]:
    """Yield each installed path with its source."""
    for name, paths in install._TARGETS.items():
        for path in paths:
            yield path, ROOT / "deploy" / name


def test_a_clean_computer(computer: Computer) -> None:
    """Every file is one of `deploy`, the list of them is right, and a second time there is nothing to do."""
    said = computer.install()
    for path, source in deployed():
        target = computer.root / path[1:]
        assert target.read_bytes() == source.read_bytes()
        assert target.stat().st_mode & 0o777 == 0o644
    listed = dict(line.split("  ")[::-1] for line in computer.files["footsense/installed"].splitlines()[2:])
    assert listed == {path: hashlib.sha256(file.read_bytes()).hexdigest() for path, file in deployed()}
    assert computer.programs.commands == [
        f"systemd-sysusers --root={computer.root} footsense.conf",
        f"systemctl --root={computer.root} enable systemd-networkd",
        f"systemctl --root={computer.root} disable systemd-networkd-wait-online",
        "systemctl daemon-reload",
        "udevadm control --reload",
        "modprobe i2c-dev",
        "udevadm trigger --subsystem-match=i2c-dev --subsystem-match=gpio",
        "systemctl reload-or-restart systemd-networkd",
    ]
    assert said[-2:] == [
        "next: /opt/footsense/bin/footsense init /etc/footsense/footsense.yaml; then this once more, for its devices",
        "next: systemctl enable --now footsense footsense-exporter footsense-view",
    ]
    before, computer.programs.commands = computer.files, []
    assert computer.install()[0] == "nothing to do"
    assert (computer.files, computer.programs.commands) == (before, [])


def test_the_wheel_has_what_is_installed() -> None:
    """From a wheel the same files are installed as from a checkout."""
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    packaged = {path for path in wheel["force-include"] if path.startswith("deploy/")}
    names = {*install._TARGETS, install._SERIAL, install._MUX_RESET}
    assert packaged == {f"deploy/{name}" for name in names}
    assert all(wheel["force-include"][path] == f"footsense/{path}" for path in packaged)


def test_what_was_there_before_is_there_after_a_removal(computer: Computer) -> None:
    """A drop-in of the user's stays, and a network service that was enabled before stays enabled."""
    computer.programs.enabled = {"systemd-networkd", "systemd-networkd-wait-online"}
    computer.write(f"{UNIT}.d/override.conf", "[Service]\nCPUAffinity=1\n")
    computer.write("etc/passwd", "")
    before = computer.files
    computer.install()
    assert computer.files != before
    computer.install(remove=True)
    assert computer.files == before
    assert computer.programs.enabled == {"systemd-networkd", "systemd-networkd-wait-online"}
    assert not (computer.root / f"{UNITS}/sys-subsystem-net-devices-can0.device.d").exists()
    assert computer.install(remove=True)[0] == "nothing to do"


def test_networkd_that_is_for_can0_alone_goes_with_it(computer: Computer) -> None:
    """It does not hold up a boot on NetworkManager's network, neither with footsense nor after it."""
    computer.install()
    assert computer.programs.enabled == {"systemd-networkd"}
    computer.install()
    computer.install(remove=True)
    assert computer.programs.enabled == set()


def test_a_dry_run_says_the_same_and_does_nothing(computer: Computer) -> None:
    """The steps are those of the real run."""
    before = computer.files
    planned = computer.install(dry_run=True)
    assert (computer.files, computer.programs.commands) == (before, [])
    assert "dry run: nothing was done" in planned
    done = computer.install()
    assert planned[: planned.index("dry run: nothing was done")] == done[: done.index("done")]


def test_an_upgrade(computer: Computer, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is new comes, what is gone goes, and the running services are named, not restarted."""
    with monkeypatch.context() as older:
        older.setitem(install._TARGETS, "footsense-serial.conf", ("/etc/udev/rules.d/98-gone.rules",))
        older.delitem(install._TARGETS, "79-can0-gs_usb.network")
        older.setitem(install._TARGETS, "footsense-view.service", ("/etc/systemd/system/footsense.service",))
        computer.install()
    computer.configure(f"buses: [{{device: sim, legs: {{lf: 0}}}}]\n{CAN}")
    computer.programs.active = {"footsense", "footsense-view"}
    computer.programs.commands = []
    said = computer.install()
    assert not (computer.root / "etc/udev/rules.d/98-gone.rules").exists()
    for path, source in deployed():
        assert (computer.root / path[1:]).read_bytes() == source.read_bytes()
    assert said[-1] == "next, with the robot at rest: systemctl restart footsense footsense-view"
    assert not [line for line in computer.programs.commands if " restart footsense" in line]


@pytest.mark.parametrize("remove", [False, True])
def test_one_that_was_cut_short_is_finished_or_undone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, remove: bool
) -> None:
    """Whatever step of an upgrade was the last, the next installation completes it, and a removal leaves nothing."""
    for n_steps in range(100):
        computer = Computer(tmp_path / str(n_steps))
        with monkeypatch.context() as older:
            older.setitem(
                install._TARGETS, "footsense-view.service", ("/etc/systemd/system/footsense.service",)
            )
            computer.install()
        done = computer.steps()
        is_complete = [next(done, None) for _ in range(n_steps)][-1:] == [None]
        done.close()
        computer.install(remove=remove)
        assert computer.install(remove=remove)[0] == "nothing to do"
        if remove:
            assert computer.files == {}
        else:
            assert all(
                (computer.root / path[1:]).read_bytes() == file.read_bytes() for path, file in deployed()
            )
        if is_complete:
            break
    assert n_steps > 10


def test_a_step_that_fails(computer: Computer) -> None:
    """One line says which and why; set right, the same command completes."""
    computer.programs.failing = "sysusers"
    with pytest.raises(
        FootsenseError, match=r"systemd-sysusers --root=\S+ footsense.conf: Failed: no such thing; set"
    ):
        computer.install()
    computer.programs.failing = ""
    assert "done" in computer.install()


def test_a_full_card(computer: Computer, monkeypatch: pytest.MonkeyPatch) -> None:
    """The line says how to free some of it; the file that did not fit has its old content or none."""
    write = InstalledFiles.write

    def full(self: InstalledFiles, path: str, content: bytes) -> None:
        if path.endswith(".rules"):
            raise OSError(errno.ENOSPC, "No space left on device", path)
        write(self, path, content)

    with monkeypatch.context() as patched:
        patched.setattr(InstalledFiles, "write", full)
        with pytest.raises(
            FootsenseError, match=r"No space left on device: free some of the card .*repeat this"
        ):
            computer.install()
    assert "done" in computer.install()


def test_a_unit_that_was_edited_by_hand(computer: Computer) -> None:
    """Neither an installation nor a removal touches it: the line names file, line and where the edit belongs."""
    computer.install()
    unit = computer.root / UNIT
    unit.write_text(unit.read_text().replace("#CPUAffinity=1", "CPUAffinity=1"))
    number = unit.read_text().splitlines().index("CPUAffinity=1") + 1
    before = computer.files
    with pytest.raises(
        FootsenseError, match=rf"^/{UNIT}:{number}: edited by hand; keep .*systemctl edit UNIT"
    ):
        computer.install()
    with pytest.raises(
        FootsenseError, match=rf"^/{UNIT}: edited by hand; keep .*remove the file, and repeat"
    ):
        computer.install(remove=True)
    assert computer.files == before
    unit.unlink()
    assert f"write /{UNIT}" in computer.install()


def test_files_that_were_installed_by_hand_are_taken_over(computer: Computer) -> None:
    """Those of this version; what footsense has never written is edited by hand, whatever it is."""
    computer.write(UNIT, (ROOT / "deploy/footsense.service").read_text())
    assert f"write /{UNIT}" not in computer.install()
    computer.install(remove=True)
    assert not (computer.root / UNIT).exists()
    computer.write(UNIT, "[Service]\nExecStart=/home/pi/feet\n")
    with pytest.raises(FootsenseError, match=f"^/{UNIT}:1: edited by hand"):
        computer.install()


@pytest.mark.parametrize(
    ("config", "drop_in"),
    [
        ("board: mcu\nserial: {device: /dev/ttyACM0, legs: [lf]}\n", "serial"),
        (f"buses: [{{{BUS}, mux: {{reset: {{device: /dev/gpiochip0, line: 17}}}}}}]\n", "mux-reset"),
    ],
)
def test_a_drop_in_by_the_configuration(computer: Computer, config: str, drop_in: str) -> None:
    """The service may use the devices that its configuration names, and no longer once it names none."""
    name = f"{UNIT}.d/footsense-{drop_in}.conf".removeprefix("etc/")
    computer.install()
    assert name not in computer.files
    computer.configure(config + CAN)
    computer.install()
    assert computer.files[name] == (ROOT / f"deploy/footsense-{drop_in}.conf").read_text()
    computer.configure(f"buses: [{{{BUS}}}]\n{CAN}")
    computer.install()
    assert name not in computer.files
    computer.configure("bord: mcu\n")
    with pytest.raises(ConfigError, match="bord: unknown key"):
        computer.install()


def test_the_service_waits_for_the_devices_of_its_configuration(computer: Computer) -> None:
    """As long as for the usual ones, by the names that systemd gives them; simulated ones are not waited for."""
    second = "{device: /dev/i2c-3, addresses: {rf: 0x2C}}"
    own = f"board: ad7147\nbuses: [{{device: /dev/i2c-1, addresses: {{lf: 0x2C}}}}, {second}]\n"
    computer.configure(f"{own}can: {{interface: socketcan, channel: can-feet}}\n")
    computer.install()
    units = r"dev-i2c\x2d1.device dev-i2c\x2d3.device sys-subsystem-net-devices-can\x2dfeet.device"
    drop_in = f"{UNIT}.d/footsense-devices.conf".removeprefix("etc/")
    assert f"After={units}\nWants={units}\n" in computer.files[drop_in]
    limit = (ROOT / "deploy/footsense-device.conf").read_text()
    for unit in units.split():
        assert computer.files[f"systemd/system/{unit}.d/footsense.conf"] == limit
    computer.configure("buses: [{device: sim, legs: {lf: 0}}]\ncan: {interface: virtual}\n")
    computer.install()
    assert drop_in not in computer.files
    assert not (computer.root / UNITS / r"dev-i2c\x2d3.device.d").exists()


@pytest.mark.parametrize(
    ("path", "text", "says"),
    [
        ("bin/sh", "\x7fELF\x01", "is a system of 32 bit, .* take the 64 bit image"),
        ("usr/bin/systemctl", None, "has no systemd"),
        ("opt/footsense/bin/footsense", None, "not there, and the services start it: install footsense"),
    ],
)
def test_a_computer_that_cannot_be_a_robot_s(
    computer: Computer, path: str, text: str | None, says: str
) -> None:
    """One line, and nothing is written; a removal works all the same."""
    if text is None:
        (computer.root / path).unlink()
    else:
        computer.write(path, text)
    with pytest.raises(FootsenseError, match=says):
        computer.install()
    assert computer.files == {}
    assert computer.install(remove=True)[0] == "nothing to do"


def test_adapters_that_are_not_there(computer: Computer) -> None:
    """The computer is installed all the same, and each missing one has a line with its remedy."""

    def warnings() -> list[str]:
        return [line for line in computer.install() if line.startswith("warning: ")]

    assert warnings() == []
    (computer.root / "dev/i2c-1").unlink()
    (computer.root / "sys/class/net/can0").rename(computer.root / "sys/class/net/can1")
    i2c, can = warnings()
    assert "no I2C adapter: dtparam=i2c_arm=on" in i2c
    assert "no can0: can1 has no settings yet" in can
    computer.write("dev/i2c-1", "")
    (computer.root / "sys/class/net/can1").rename(computer.root / "gone")
    (line,) = warnings()
    assert "no CAN interface: plug in the adapter; a HAT needs the line dtoverlay=" in line
    computer.write("sys/bus/spi/devices/spi0.0/modalias", "spi:mcp2515\n")
    (line,) = warnings()
    assert "spi0.0: the CAN controller of the overlay does not answer" in line


def test_a_channel_that_the_service_may_not_use(computer: Computer) -> None:
    """`footsense init` writes it on a computer without CAN, and the unit allows sockets of CAN alone."""
    computer.configure(f"buses: [{{{BUS}}}]\ncan: {{interface: udp_multicast}}\n")
    (line,) = [line for line in computer.install() if line.startswith("warning: ")]
    assert line.endswith(
        "/etc/footsense/footsense.yaml: can.interface: udp_multicast never leaves the computer, and footsense.service "
        "may not use it; the robot's controller needs socketcan"
    )
    assert "RestrictAddressFamilies=AF_UNIX AF_CAN" in computer.files["systemd/system/footsense.service"]


@pytest.mark.parametrize(
    ("driver", "is_told"), [("mcp251x", True), ("mcp251xfd", True), ("kvaser_usb", False)]
)
def test_one_shot_on_an_adapter_without_it(computer: Computer, driver: str, *, is_told: bool) -> None:
    """Can0 would stay down: the line names the file to remove."""
    (computer.root / "sys/class/net/can0/device/driver").unlink()
    (computer.root / "sys/class/net/can0/device/driver").symlink_to(f"../../../drivers/{driver}")
    drop_in = "etc/systemd/network/80-can0.network.d/one-shot.conf"
    computer.write(drop_in, (ROOT / "deploy/80-can0-one-shot.conf").read_text())
    told = [line for line in computer.install() if "one-shot" in line]
    assert [f"can0 ({driver}) has no one-shot mode" in line for line in told] == [True] * is_told
