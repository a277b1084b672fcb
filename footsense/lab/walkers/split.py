"""The runs of walking robots that train, select and judge networks and thresholds: split once, never crossed.

Robots, grounds and seeds of the three parts differ. So do gaits, but for those of `KNOWN_JUDGEMENT`: each of selection
and of judgement has another order of footfalls than all of training and of the other, or a duty that differs by more
than 0.1, or it starts, stops and turns. Whoever tunes anything looks at `TRAINING` and `SELECTION` alone;
`footsense lab selection` prints what the latter says.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from footsense.errors import ConfigError
from footsense.lab.walkers.robots import GroundModel
from footsense.lab.walkers.simulate import FallError, WalkerLog, simulate_walker
from footsense.progress import progress_bar


class WalkerRun(NamedTuple):
    """One run: robot, gait, ground, seed and duration [s].

    Attributes:
        robot: Name of a robot.
        gait: Name of a gait.
        ground: Name of a ground in `GROUNDS`.
        seed: Seed of the run.
        duration_s: Duration [s].
    """

    robot: str
    gait: str
    ground: str
    seed: int
    duration_s: float

    @property
    def kind(self) -> str:
        """Kind of the robot."""
        return self.robot.partition("-")[0]

    @property
    def name(self) -> str:
        """Robot, gait and ground, with blanks between."""
        return f"{self.robot} {self.gait} {self.ground}"

    def log(self) -> WalkerLog:
        """Return the log of the run, simulated.

        Raises:
            ConfigError: There is no such robot, gait or ground.
            FallError: The robot falls.
        """
        if self.ground not in GROUNDS:
            raise ConfigError(f"no ground {self.ground!r}: there are {', '.join(GROUNDS)}")
        return simulate_walker(self.robot, self.gait, GROUNDS[self.ground], self.seed, self.duration_s)

    def kept_log(self) -> WalkerLog:
        """Return the log of the run, simulated once on a computer, then read from `cache_folder`.

        Raises:
            ConfigError: As of `saved`.
        """
        return WalkerLog.load(self.saved(cache_folder()))

    def saved(self, folder: Path) -> Path:
        """Return the file of the run's log in a folder, simulated unless it is there.

        Raises:
            ConfigError: As of `log`, or the file cannot be written.
        """
        path = folder / f"{self.name.replace(' ', '_')}_{self.seed}_{self.duration_s:g}s.npz"
        if not path.exists():
            log = self.log()
            try:
                folder.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryDirectory(dir=folder) as unfinished:
                    log.save(Path(unfinished) / path.name)
                    (Path(unfinished) / path.name).replace(path)
            except OSError as error:
                raise ConfigError(f"{folder}: cannot keep a log: {error.strerror}") from error
        return path


class LoggedRun(NamedTuple):
    """A walk of another robot, whose log comes with footsense; `logs/README.md` says from where.

    Attributes:
        kind: Kind of the robot.
        gait: Name of the log.
        seed: Seed of the readings' noise.
    """

    kind: str
    gait: str
    seed: int

    @property
    def name(self) -> str:
        """Name of the log."""
        return self.gait

    @property
    def file(self) -> Path:
        """File of the log."""
        return Path(__file__).parent / "logs" / f"{self.gait}.npz"

    def kept_log(self) -> WalkerLog:
        """Return the log."""
        log = WalkerLog.load(self.file)
        return log._replace(normal=log.normal / np.linalg.norm(log.normal, axis=2, keepdims=True))


#: Grounds by name. Those of training and selection are not those of judgement.
GROUNDS: dict[str, GroundModel] = {
    # Judgement.
    "flat": GroundModel(friction=0.8, time_constant_s=0.008),
    "slope-10": GroundModel(friction=0.6, time_constant_s=0.008, slope_deg=(10.0, 30.0)),
    "rough": GroundModel(friction=0.6, time_constant_s=0.008, rough_rel=0.08),
    "friction-0.3": GroundModel(friction=0.3, time_constant_s=0.008),
    "friction-0.2": GroundModel(friction=0.2, time_constant_s=0.008),
    "soft": GroundModel(friction=0.7, time_constant_s=0.025),
    # Training and selection.
    "floor": GroundModel(friction=0.7, time_constant_s=0.006),
    "carpet": GroundModel(friction=0.9, time_constant_s=0.016),
    "wet": GroundModel(friction=0.4, time_constant_s=0.007),
    "icy": GroundModel(friction=0.25, time_constant_s=0.01),
    "ramp": GroundModel(friction=0.65, time_constant_s=0.01, slope_deg=(7.0, 120.0)),
    "stones": GroundModel(friction=0.55, time_constant_s=0.007, rough_rel=0.06),
    "tiles": GroundModel(friction=0.5, time_constant_s=0.01),
    "ascent": GroundModel(friction=0.75, time_constant_s=0.007, slope_deg=(5.0, 0.0)),
}

#: Gaits that train networks and judge them as well.
_KNOWN = {
    "quadruped": ("walk", "trot-slow", "trot-fast", "turn", "stand", "hop", "landing"),
    "hexapod": ("walk", "tripod", "tripod-fast", "turn", "stand", "hop", "landing"),
}
_TRAINED = {
    "quadruped": (*_KNOWN["quadruped"], "sideways", "trot-stops", "trot-drag"),
    "hexapod": (*_KNOWN["hexapod"], "sideways", "tripod-stops", "tripod-drag"),
}
_SELECTED = {
    "quadruped": ("pace", "gallop", "crawl", "gallop-stops", "pace-drag"),
    "hexapod": ("ripple", "tripod-long", "crawl", "ripple-stops", "ripple-drag"),
}
_JUDGED = {
    "quadruped": ("bound", "amble", "diagonal-walk", "rotary-gallop", "diagonal-stops", "diagonal-drag"),
    "hexapod": ("tetrapod", "front-wave", "pairs", "amble", "tetrapod-stops", "tetrapod-drag"),
}
#: Gaits whose feet drag over the ground.
DRAGGED = ("pace-drag", "ripple-drag", "diagonal-drag", "tetrapod-drag")
#: Runs that are left out: an open-loop gait does not balance, and on the ramp the light quadruped with its long legs
#: tips over in these; in the walk at 4 deg as well.
_FALLS = {("quadruped-300g", "walk", "ramp"), ("quadruped-300g", "turn", "ramp")}


def _runs(
    gaits: Mapping[str, Sequence[str]],
    robots: tuple[str, ...],
    grounds: tuple[str, ...],
    duration_s: float,
    first_seed: int,
) -> tuple[WalkerRun, ...]:
    return tuple(
        WalkerRun(robot, gait, ground, first_seed + 100 * a + b, duration_s)
        for a, robot in enumerate(robots)
        for b, (ground, gait) in enumerate(
            (ground, gait) for ground in grounds for gait in gaits[robot.partition("-")[0]]
        )
        if (robot, gait, ground) not in _FALLS
    )


#: What networks are trained on.
TRAINING = _runs(
    _TRAINED,
    ("quadruped-300g", "hexapod-12kg"),
    ("floor", "carpet", "wet", "icy", "ramp", "stones"),
    5.0,
    1000,
)
#: What recipes and thresholds are chosen by.
SELECTION = _runs(_SELECTED, ("quadruped-2kg", "hexapod-300g"), ("tiles", "ascent"), 4.0, 5000)
#: The same on slippery grounds, which slips are chosen by as well.
SLIPPERY_SELECTION = _runs(_SELECTED, ("quadruped-2kg", "hexapod-300g"), ("icy", "wet"), 4.0, 5400)


def _judging(robot: str, first_seed: int) -> tuple[WalkerRun, ...]:
    walk, slow, fast, turn, stand, hop, landing = _KNOWN[robot.partition("-")[0]]
    pairs = [(gait, "flat") for gait in (walk, slow, fast, turn, stand, hop, landing)]
    pairs += [
        (slow, "slope-10"),
        (walk, "rough"),
        (slow, "friction-0.3"),
        (walk, "friction-0.2"),
        (fast, "soft"),
    ]
    return tuple(
        WalkerRun(robot, gait, ground, first_seed + n, 12.0) for n, (gait, ground) in enumerate(pairs)
    )


#: What everything is judged by: robots of the two larger released feet, in gaits of training.
KNOWN_JUDGEMENT = _judging("hexapod-2kg", 9000) + _judging("quadruped-12kg", 9100)
#: The same robots, in gaits that nothing was trained or chosen on.
NEW_JUDGEMENT = _runs(_JUDGED, ("hexapod-2kg", "quadruped-12kg"), ("flat", "friction-0.3"), 11.0, 9200)
JUDGEMENT = KNOWN_JUDGEMENT + NEW_JUDGEMENT
#: Walks of robots of another make, which judge as well.
RECORDED_JUDGEMENT = (LoggedRun("quadruped", "aliengo-policy", 9800),)


#: Runs of a quick build, two seconds of each.
_QUICK = tuple(run._replace(duration_s=2.0) for run in TRAINING[2::25])


def cache_folder() -> Path:
    """Return the folder of the logs of these robots by this MuJoCo: its name changes with what simulates them."""
    place = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    key = hashlib.sha256(mujoco.__version__.encode())
    folder = Path(__file__).parent
    for source in (*sorted(folder.glob("*.py")), folder / "gaits.yaml"):
        key.update(source.read_bytes())
    return Path(place).expanduser() / "footsense" / "walkers" / key.hexdigest()[:16]


def _saved_or_fall(run: WalkerRun, folder: Path) -> Path | FallError:
    try:
        return run.saved(folder)
    except FallError as error:
        return error


def training_logs(report: Callable[[str], None], *, quick: bool = False, jobs: int = 2) -> list[WalkerLog]:
    """Return the logs of `TRAINING`, simulated once on a computer, then read from `cache_folder`.

    Args:
        report: Receives a line about a run that is missing: on another processor a robot may fall where it did not.
        quick: Four runs of two seconds, and nothing kept.
        jobs: Processes.

    Raises:
        ConfigError: A log cannot be kept.
    """
    from joblib import Parallel, delayed  # of the extra `lab`; a scene needs `walkers` alone

    if quick:
        return [run.log() for run in _QUICK]
    saving = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(_saved_or_fall)(run, cache_folder()) for run in TRAINING
    )
    logs = []
    with progress_bar("robots", len(TRAINING)) as runs_done:
        for n_done, (run, saved) in enumerate(zip(TRAINING, saving, strict=True), 1):
            if isinstance(saved, FallError):
                report(f"left out {run.name}: {saved}")
            else:
                logs.append(WalkerLog.load(saved))
            runs_done(n_done)
    return logs
