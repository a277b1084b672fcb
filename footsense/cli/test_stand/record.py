"""Command `footsense test-stand record`: guided recording of calibration loads on a test stand."""

import math
from collections import deque
from contextlib import ExitStack, closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import click
import msgspec
import numpy as np
from msgspec.structs import replace
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from footsense.calibration.guide import NextLoad, SessionGuide, azimuth_and_elevation_deg
from footsense.cli import options
from footsense.cli.live import LiveView
from footsense.cli.tables import echo_figures
from footsense.cli.test_stand.compass import Compass, legend
from footsense.config import SMALL_BOARD, Config, load_config
from footsense.config.contradictions import first_contradiction
from footsense.config.test_stand import SimulatedSensor, load_test_stand
from footsense.daemon.can_output import others_hear
from footsense.daemon.service import open_service
from footsense.daemon.simulation import is_simulated
from footsense.daemon.test_stand import StandSession, practice_scene, session_guide
from footsense.errors import CalibrationError, ConfigError
from footsense.foot.calibration_files import FootId
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import ALL_LEGS, USABLE, Cycle, State, Vector
from footsense.leg_words import word_of
from footsense.ports import ReferenceSensor
from footsense.sim.loads.press_sequence import PressSequence
from footsense.sim.scene import Scene, load_scene

_NS_PER_S = 1_000_000_000
#: Time that a simulated test stand runs on after its last press, for the offset of the reference [s].
_TIME_AFTER_LAST_PRESS_S = 0.5

#: Messages that the picture shows.
_N_SHOWN_MESSAGES = 4


@click.command()
@click.argument("out", type=options.FILE)
@click.option(
    "--reference",
    "test_stand_file",
    required=True,
    type=options.FILE,
    help="YAML file of the test stand's force sensor.",
)
@options.foot_option
@click.option(
    "--leg", type=click.Choice(ALL_LEGS), default="lf", show_default=True, help="Leg it is wired as."
)
@click.option("--session", help="Name of this mounting of the foot. Default: the name of the file.")
@options.config_option("a simulated foot")
@click.option("--scene", "scene_name", help="Scene of a simulated test stand: a name, or a YAML file.")
@click.option(
    "--loads",
    "wanted",
    type=click.IntRange(min=5, max=10_000),
    default=100,
    show_default=True,
    help="Calibration loads of a complete set.",
)
@options.duration_option("Stop after this time at the latest.")
@options.pace_option
def record(
    out: Path,
    test_stand_file: Path,
    foot: str,
    leg: str,
    session: str | None,
    config_file: Path | None,
    scene_name: str | None,
    wanted: int,
    duration_s: float,
    *,
    realtime: bool | None,
) -> None:
    """Record calibration loads of a foot beside a force sensor to the new file OUT.

    Press the foot, hold it still for a second, release it; the picture shows what is covered and what to press next.
    The set is complete when there are enough loads, and for two of 0.5, 1.0 and 1.5 N 95 % of the
    directions from 40 deg of elevation up are within reach of one. Ctrl-C ends the session before; the recording is
    whole then, too. Without --config, a simulated foot is pressed.
    """  # noqa: DOC501 - click shows this text
    test_stand = load_test_stand(test_stand_file)
    config = _with_foot_on_leg(
        load_config(config_file) if config_file else _one_leg_simulation(leg), leg, foot
    )
    row = config.legs.index(leg)
    session = session or out.stem
    scene = None
    if scene_name is not None:
        scene = load_scene(scene_name)
    elif is_simulated(config):
        scene = practice_scene(foot, row, session)
    console = Console()
    live = console.is_terminal
    if scene is not None and not isinstance(test_stand.sensor, SimulatedSensor):
        if realtime is False:
            raise ConfigError(
                "--fast: the force sensor runs in real time; only a simulated one can run faster"
            )
        realtime = True
    followed = live or others_hear(config, scene)
    paced = options.is_paced(simulated=scene is not None, realtime=realtime, followed=followed)
    run = StandSession(test_stand=test_stand, leg=leg, foot=foot, session=session)
    stop = options.StopRequest()
    with ExitStack() as stack:
        service = stack.enter_context(
            open_service(config, scene, record=out, real_time=paced or scene is None, test_stand=run)
        )
        messages: deque[str] = deque(maxlen=_N_SHOWN_MESSAGES)
        report = messages.append if live else click.echo
        guide = session_guide(test_stand, row, len(service.legs), wanted, service.network, report)
        service.observers.append(guide)
        if live:
            title = f"{foot} on {leg}, session {run.session}"
            picture = partial(_picture, guide, Compass(guide.coverage), messages, row, title)
            service.observers.append(stack.enter_context(closing(LiveView(console, picture))))
        longest_s = min(duration_s, _session_end_s(scene))
        service.run(
            lambda: stop.requested or guide.coverage.is_complete,
            service.clock.now_ns() + longest_s * _NS_PER_S,
        )
        guide.report = click.echo  # the picture is not drawn again
        guide.close()
    _print_session_summary(out, guide, service.reference)
    if guide.findings:
        raise CalibrationError(f"{out} is kept, but do not calibrate with it: {'; '.join(guide.findings)}")


def _one_leg_simulation(leg: str) -> Config:
    bus = SMALL_BOARD.buses[0]
    return replace(
        SMALL_BOARD, buses=(replace(bus, legs={name: at for name, at in bus.legs.items() if name == leg}),)
    )


def _with_foot_on_leg(config: Config, leg: str, foot: str) -> Config:
    """Return the configuration with the foot on its leg, without a calibration, and with a wide limit of the tare.

    Raises:
        ConfigError: There is no such leg, it has another foot, or the foot is on another leg.
    """
    if leg not in config.legs:
        raise ConfigError(f"--leg {leg}: is no leg of this configuration; it has {', '.join(config.legs)}")
    feet: dict[Any, str] = {**config.feet}
    if (other := feet.get(leg, foot)) != foot:
        raise ConfigError(
            f"--foot {foot}: the configuration says that {other} is on {leg}; correct one of them"
        )
    try:
        feet[leg] = msgspec.convert(foot, FootId)
    except msgspec.ValidationError:
        raise ConfigError(f"--foot {foot}: is no identity of a foot, such as foot-0007") from None
    # A foot that is not calibrated may read far from its design; its tare is accepted.
    config = replace(config, feet=feet, calibrations=None, tare=config.tare.for_uncalibrated_foot())
    if problem := first_contradiction(config):
        raise ConfigError(f"--foot {foot}: {problem}")
    return config


def _session_end_s(scene: Scene | None) -> float:
    """Return the time at which a simulated test stand's presses are over [s]; infinity on a real one."""
    load = None if scene is None else scene.load.build(round(scene.lead_in_s * _NS_PER_S))
    return load.end_ns / _NS_PER_S + _TIME_AFTER_LAST_PRESS_S if isinstance(load, PressSequence) else math.inf


def _picture(
    guide: SessionGuide,
    compass: Compass,
    messages: deque[str],
    row: int,
    title: str,
    cycle: Cycle,
    elapsed_s: float,
) -> Group:
    """Return forces, compass, next load, coverage and messages for a terminal of 80 columns and 24 lines."""
    state = State(int(cycle.forces.state[row]))
    foot_n = cycle.forces.force_n[row] if state in USABLE else np.full(3, np.nan)
    pressed_n = guide.reference_n if guide.is_pressed else np.full(3, np.nan)
    side_by_side = Table.grid(padding=(0, 3))
    side_by_side.add_row(
        compass.draw(pressed_n),
        Group(
            Text("next: ", "bold").append(_load_text(guide.coverage.next_load), "yellow"),
            Text("hold it still for a second, release\n"),
            legend(),
            Text("\nso far: ", "bold").append(guide.coverage.progress_text(), ""),
        ),
    )
    return Group(
        Text.assemble(("footsense test-stand record  ", "bold"), f"{title}, {elapsed_s:.1f} s"),
        Text("             fx [N]  fy [N]  fz [N]", "dim"),
        Text.assemble(
            ("reference  ", "bold"),
            _force_text(guide.reference_n),
            ("   pressed" if guide.is_pressed else "   free", "dim"),
        ),
        Text.assemble(("foot       ", "bold"), _force_text(foot_n), (f"   {word_of(state)}", "dim")),
        Text(),
        side_by_side,
        *(Text(f"  {line}", "dim" if line.startswith("press") else "bold red") for line in messages),
    )


def _load_text(load: NextLoad) -> str:
    return (
        f"{load.magnitude_gf * GRAM_FORCE_N:.1f} N towards azimuth {5 * round(load.azimuth_deg / 5) % 360}, "
        f"elevation {5 * round(load.elevation_deg / 5):.0f} deg"
    )


def _force_text(force_n: Vector) -> str:
    """Return a force as text: components, magnitude, azimuth and elevation; a dash for NaN.

    Example:
        >>> _force_text(np.array([0.0, 0.5, 0.5]))
        ' +0.000  +0.500  +0.500  of  0.71 N  az  90  el 45'
    """
    if not np.isfinite(force_n).all():
        return "      -       -       -"
    components = " ".join(f"{value + 0.0:+7.3f}" for value in force_n.round(3))
    azimuth_deg, elevation_deg = azimuth_and_elevation_deg(force_n)
    size_n = np.linalg.norm(force_n)
    return f"{components}  of {size_n:5.2f} N  az {round(azimuth_deg) % 360:3d}  el {elevation_deg:2.0f}"


def _print_session_summary(out: Path, guide: SessionGuide, sensor: ReferenceSensor | None) -> None:
    click.echo(f"{out}: {guide.coverage.progress_text()}")
    following = f"{_load_text(guide.coverage.next_load)}, in another session"
    figures = {
        "rejected": dict(guide.rejected.most_common()),
        "not complete; next would be": None if guide.coverage.is_complete else following,
        "reference": sensor and asdict(sensor.statistics),
    }
    echo_figures(figures, as_json=False)
