"""Command `footsense init`: find a robot's adapters and feet, and write its file."""

import logging
from collections.abc import Callable
from pathlib import Path

import click
from msgspec.structs import replace
from rich.console import Console, Group

from footsense import strict_yaml
from footsense.can.channel import can_interfaces
from footsense.can.interface import Can
from footsense.cli.options import FILE
from footsense.cli.setup.check_config import RANGES_N
from footsense.cli.setup.probe import diagnoses_lines
from footsense.cli.setup.robot_file import check_is_new, robot_file
from footsense.config import DEFAULT, Config
from footsense.config.contradictions import first_contradiction
from footsense.config.sections import Bus
from footsense.daemon.setup.found_feet import SIMULATED, devices, robot_on
from footsense.daemon.setup.probe import probe
from footsense.daemon.simulation import is_simulated
from footsense.errors import ConfigError
from footsense.foot.type_folders import released_names
from footsense.frames import ALL_LEGS
from footsense.sim.scene import load_scene

#: Where forces go without a CAN interface: to programs on this computer.
_LOCAL_CAN = Can(interface="udp_multicast", commands=True)


@click.command()
@click.argument("target", type=FILE, default="robot.yaml", metavar="[FILE]")
@click.option(
    "--device",
    "chosen",
    multiple=True,
    help="I2C adapter (repeat it for several) or serial port with the feet, or `sim` for a simulated robot. "
    "Without it, you are asked.",
)
@click.option(
    "--legs", "legs_text", default="", help="Legs in the order of their channels, such as 'lf lr rf rr'."
)
@click.option(
    "--foot-type",
    type=click.Choice(released_names()),
    help="Type of the feet, by the largest load on one; without it you are asked, or with --device it is "
    f"{DEFAULT.foot_type}.",
)
@click.option("--can", "can_name", help="CAN interface for the forces. Default: the first of this computer.")
def init(
    target: Path, chosen: tuple[str, ...], legs_text: str, foot_type: str | None, can_name: str | None
) -> None:
    """Find the adapters and feet of a robot, and write its FILE (robot.yaml), which is never overwritten.

    Unknown addresses are only asked for an acknowledge, as `i2cdetect` does.
    """  # noqa: DOC501 - click shows this text
    check_is_new(target)
    logging.getLogger("footsense.acquisition").setLevel(logging.ERROR)  # the diagnoses replace its warnings
    names = devices()
    asks = not chosen
    try:
        chosen = chosen or _asked_devices(names)
        can = _can(can_name, is_real=not any(device.startswith(SIMULATED) for device in chosen))
        scene = load_scene("hanging")
        config = robot_on(chosen, _legs(legs_text), can, scene)
        click.echo(_found_text(config))
        hang_free = False
        if asks and config.serial is None:
            config = _with_asked_legs(config, legs_text, lambda legs: robot_on(chosen, legs, can, scene))
        if asks and foot_type is None:
            click.echo("Types of feet, by the largest normal load on one if the force leans 14 deg, and 30:")
            for name in released_names():
                click.echo("  {}: {:g} N, {:g} N".format(name, *RANGES_N[name]))
            foot_type = click.prompt(
                "Their type",
                type=click.Choice(released_names()),
                default=DEFAULT.foot_type,
                show_choices=False,
            )
        config = replace(config, foot_type=foot_type or DEFAULT.foot_type)
        if asks and not is_simulated(config):
            hang_free = click.confirm("Do all feet hang free, with nothing that presses them?", default=False)
    except click.Abort:
        raise ConfigError(
            "nothing was written: a question has no answer; `footsense init --device sim` asks none, nor does "
            f"--device with one of {', '.join(names) or 'the adapters of a robot'}"
        ) from None
    found = probe(config, scene if is_simulated(config) else None)
    text = robot_file(config, found, names, hang_free=hang_free)
    strict_yaml.load(text, Config, where=f"what was found, as {target}", check=first_contradiction)
    target.write_text(text, "utf-8")
    if found.diagnoses:
        Console(highlight=False).print(Group(*diagnoses_lines(found)))
    click.echo(f"wrote {target}; next:\n  footsense check-config {target}\n  footsense run --config {target}")


def _asked_devices(names: dict[str, str]) -> tuple[str, ...]:
    """Ask which devices have the feet."""
    if not names:
        click.echo("This computer has no I2C adapter and no serial port.")
        click.confirm("Write a simulated robot?", default=True, abort=True)
        return (SIMULATED,)
    choices = names | {SIMULATED: "a simulated robot, without hardware"}
    for number, (device, name) in enumerate(choices.items(), 1):
        click.echo(f"  {number}  {device}  {name}")
    while True:
        answer = click.prompt("Which of them has the feet? Several: 1,2", default="1")
        numbers = [part.strip() for part in answer.split(",")]
        if all(part.isdecimal() and 1 <= int(part) <= len(choices) for part in numbers):
            return tuple([*choices][int(part) - 1] for part in numbers)
        click.echo(f"{answer}: not among 1 to {len(choices)}")


def _with_asked_legs(config: Config, legs_text: str, robot_of: Callable[[list[str]], Config]) -> Config:
    """Ask for the legs until they are right, and return the robot that has them."""
    usual = " ".join(config.legs)
    while True:
        answer = click.prompt("Their legs, in this order", default=legs_text or usual)
        try:
            return config if answer == usual else robot_of(_legs(answer))
        except ConfigError as error:
            click.echo(str(error))


def _can(name: str | None, *, is_real: bool) -> Can:
    """Return where the forces go: the CAN interface of this name, or the first one; a simulation's stay here."""
    if name is None:
        name = next(iter(can_interfaces()), None) if is_real else None
    return _LOCAL_CAN if name is None else Can(interface="socketcan", channel=name)


def _legs(text: str) -> list[str]:
    legs = text.replace(",", " ").split()
    if wrong := [leg for leg in legs if leg not in ALL_LEGS]:
        raise ConfigError(f"{wrong[0]}: no leg has this name; there are {' '.join(ALL_LEGS)}")
    if len({*legs}) < len(legs):
        raise ConfigError(f"{text}: names a leg twice")
    return legs


def _found_text(config: Config) -> str:
    """Return in a line where feet answer."""
    if config.serial is not None:
        return f"{config.serial.device}: a microcontroller sends {' '.join(config.legs)}"
    places = [f"{bus.device}, {_place(bus)}" for bus in config.buses]
    return f"{len(config.legs)} feet answer: {'; '.join(places)}"


def _place(bus: Bus) -> str:
    """Return where the feet of a bus are on it."""
    if bus.addresses:
        return f"addresses {' '.join(f'{address:#04x}' for address in bus.addresses.values())}"
    if bus.leg is not None:
        return "one foot without a multiplexer"
    return f"multiplexer {bus.mux.address:#04x}, channels {' '.join(map(str, bus.legs.values()))}"
