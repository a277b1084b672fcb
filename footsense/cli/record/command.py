"""`footsense record`: a session on the test_stand, guided."""

import math
from contextlib import ExitStack
from pathlib import Path

import click
import msgspec
from rich.console import Console

from footsense import daemon
from footsense.calibration.session.guide import Guide
from footsense.cli.options import StopRequest, config_option, duration_option, pace_option
from footsense.cli.record.table import RecordTable
from footsense.config import DEFAULT, Config, load_config
from footsense.config.test_stand import StandConfig, load_test_stand
from footsense.daemon.session_guide import guide_of, practice_scene
from footsense.daemon.test_stand import StandSensor, StandSession, is_live
from footsense.errors import CalibrationError, ConfigError
from footsense.frames import LEGS, Cycle
from footsense.sim.scene import Scene, load_scene
from footsense.sim.test_stand.calibration_loads import PressSequence

_NS_PER_S = 1_000_000_000
#: What stays of a simulated bench after its last press, so that its zero is known [s].
_AFTER_S = 0.5
#: How far the elements of a free foot that is not calibrated may be from the designed ones [1].
_AS_MADE_REL = 0.5


@click.command()
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--reference",
    "test_stand_file",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="The bench's force sensor, as a YAML file.",
)
@click.option(
    "--foot", required=True, metavar="FOOT", help="Which foot is on the test_stand, such as foot-0007."
)
@click.option(
    "--leg", type=click.Choice(LEGS), default="lf", show_default=True, help="Leg that it is wired as."
)
@click.option("--session", help="Name of this mounting of the foot. Default: the name of the file.")
@config_option("a simulated foot")
@click.option(
    "--scene", "scene_name", help="What a simulated bench does: a name, or the path of a YAML file."
)
@click.option(
    "--loads",
    "wanted",
    type=click.IntRange(min=5, max=10_000),
    default=100,
    show_default=True,
    help="How many make a set.",
)
@duration_option("Stop after this time at the latest.")
@pace_option
def record(
    out: Path,
    test_stand_file: Path,
    foot: str,
    leg: str,
    session: str | None,
    config_file: Path | None,
    scene_name: str | None,
    wanted: int,
    duration_s: float | None,
    *,
    realtime: bool | None,
) -> None:
    """Record presses of a foot beside a force sensor to the new file OUT.

    Press the foot, hold it still for a second, let it go; the picture shows what is covered and what to press next. A
    set is enough when so many loads as wanted lie so that in two of the bands of 50, 100 and 150 gf 95 % of the
    directions from 40 deg of elevation up are within their reach. Ctrl-C ends it before; the recording is whole
    then, too. Without --config, a simulated foot is pressed.
    """
    test_stand = load_test_stand(test_stand_file)
    config = _mounted(load_config(config_file) if config_file else _simulated(leg), leg, foot)
    row = config.legs.index(leg)
    session = session or out.stem
    scene = _scene(config, scene_name, foot, row, session)
    console = Console()
    live = console.is_terminal
    paced = _paced(test_stand, scene, realtime, live=live)
    run = StandSession(test_stand=test_stand, leg=leg, foot=foot, session=session)
    stop = StopRequest()
    with ExitStack() as stack:
        service = stack.enter_context(
            daemon.service(config, scene, record=out, real_time=paced or scene is None, test_stand=run)
        )
        guide = guide_of(test_stand, row, wanted, service.network)
        service.observers.append(guide)
        if live:
            table = RecordTable(console, guide, row, f"{foot} on {leg}, session {run.session}")
            stack.callback(table.close)
            service.observers.append(table)
        else:
            service.observers.append(_News(guide))
        clock = service.scanning.clock
        end_ns = clock.now_ns() + min(_seconds(duration_s), _seconds(_ends_s(scene))) * _NS_PER_S
        service.run(lambda: stop.requested or guide.coverage.enough or clock.now_ns() >= end_ns)
        guide.close()
    _report(out, guide, service.reference)
    _draw(out, guide, f"{foot}, session {run.session}")
    _require_belief(out, guide)


class _News:
    """Prints what happens, where nobody sees a picture."""

    def __init__(self, guide: Guide) -> None:
        self._guide = guide

    def observe(self, cycle: Cycle) -> None:
        """Print what is new."""
        del cycle
        self.close()

    def close(self) -> None:
        """Print what is new."""
        for line in self._guide.news():
            click.echo(line)


def _simulated(leg: str) -> Config:
    """Return the built-in simulation with one leg alone."""
    built_in = msgspec.to_builtins(DEFAULT)
    bus = built_in["buses"][0]
    return msgspec.convert(built_in | {"buses": [bus | {"legs": {leg: bus["legs"][leg]}}]}, Config)


def _mounted(config: Config, leg: str, foot: str) -> Config:
    """Return the configuration with the foot on its leg, as the recording is to say of it.

    Raises:
        ConfigError: The leg is not there, another foot is said to be on it, or the foot on another leg.
    """
    if leg not in config.legs:
        raise ConfigError(f"--leg {leg}: is no leg of this configuration; it has {', '.join(config.legs)}")
    feet: dict[str, str] = dict(config.feet.items())
    if feet.get(leg, foot) != foot:
        raise ConfigError(
            f"--foot {foot}: the configuration says that {feet[leg]} is on {leg}; correct one of them"
        )
    feet[leg] = foot
    if list(feet.values()).count(foot) > 1:
        raise ConfigError(f"--foot {foot}: the configuration says that it is on another leg than {leg}")
    # A foot that is not calibrated yet has no calibration, and may be far from the designed one, which is no reason to refuse
    # its tare.
    plain = msgspec.to_builtins(config)
    changed = {
        "feet": feet,
        "calibrations": None,
        "tare": plain["tare"] | {"unloaded_limit_rel": _AS_MADE_REL},
    }
    try:
        return msgspec.convert(plain | changed, Config)
    except msgspec.ValidationError:
        raise ConfigError(f"--foot {foot}: is no identity of a foot, such as foot-0007") from None


def _scene(config: Config, name: str | None, foot: str, row: int, session: str) -> Scene | None:
    if name is not None:
        return load_scene(name)
    return practice_scene(foot, row, session) if daemon.is_simulated(config) else None


def _paced(test_stand: StandConfig, scene: Scene | None, realtime: bool | None, *, live: bool) -> bool:  # noqa: FBT001
    """Tell whether a simulation keeps the pace of the clock on the wall: it has to beside a sensor that does.

    Raises:
        ConfigError: It is asked not to, or no simulation is.
    """
    if scene is None:
        if realtime is not None:
            raise ConfigError(
                "--realtime and --fast are for simulations; this configuration names real buses"
            )
        return False
    if is_live(test_stand):
        if realtime is False:
            raise ConfigError(
                "--fast: the force sensor lives in real time; only a simulated one or a file can hurry"
            )
        return True
    return live if realtime is None else realtime


def _ends_s(scene: Scene | None) -> float | None:
    """Return when a simulated bench has no more presses [s], None if that is never."""
    if scene is None:
        return None
    load = scene.load.build(round(scene.lead_in_s * _NS_PER_S))
    return load.ends_ns / _NS_PER_S + _AFTER_S if isinstance(load, PressSequence) else None


def _seconds(value_s: float | None) -> float:
    return math.inf if value_s is None else value_s


def _report(out: Path, guide: Guide, sensor: StandSensor | None) -> None:
    """Say what came of it, and what did not come."""
    for line in guide.news():
        click.echo(line)
    click.echo(f"{out}: {guide.coverage.words()}")
    if guide.refused:
        reasons = ", ".join(f"{n} {why}" for why, n in guide.refused.most_common())
        click.echo(f"not counted: {reasons}")
    if not guide.coverage.enough:
        wish = guide.coverage.next
        click.echo(
            f"not enough yet; next would be {wish.magnitude_gf:.0f} gf from azimuth {wish.azimuth_deg:.0f}, "
            f"elevation {wish.elevation_deg:.0f} deg, in another session"
        )
    if sensor is not None:
        said = sensor.figures()
        click.echo(
            f"reference: {said.n_samples} samples, {said.n_missing} missing, {said.n_bad} unreadable, "
            f"{said.n_saturated} saturated, clock jumped {said.n_jumps} times, opened {said.n_opened} times, "
            f"times to {said.residual_ms:.1f} ms"
        )


def _require_belief(out: Path, guide: Guide) -> None:
    """Check that the reference does not contradict the foot.

    Raises:
        CalibrationError: It does.
    """
    if guide.doubts:
        raise CalibrationError(f"{out} is kept, but do not calibrate by it: {'; '.join(guide.doubts)}")


def _draw(out: Path, guide: Guide, title: str) -> None:
    try:
        from footsense.cli.record.coverage_figure import draw_coverage
    except ImportError:
        click.echo("no picture of the coverage: matplotlib is not installed; pip install 'footsense[lab]'")
        return
    picture = out.with_suffix(".png")
    if picture.exists():
        click.echo(f"{picture}: exists and is not overwritten; what is covered is not drawn")
        return
    draw_coverage(picture, guide.coverage, guide.directions_n, title)
    click.echo(f"{picture}: what is covered")
