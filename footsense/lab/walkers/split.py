"""The runs of walking robots that train, select and judge networks and thresholds: split once, never crossed.

Robots, grounds and seeds of the three parts differ. Whoever tunes anything looks at `TRAINING` and `SELECTION` alone.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from footsense.errors import ConfigError
from footsense.lab.walkers.robots import GroundModel
from footsense.lab.walkers.simulate import WalkerLog, simulate_walker


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
    def name(self) -> str:
        """Robot, gait and ground, with blanks between."""
        return f"{self.robot} {self.gait} {self.ground}"

    def log(self) -> WalkerLog:
        """Return the log of the run, simulated.

        Raises:
            ConfigError: The robot falls.
        """
        return simulate_walker(self.robot, self.gait, GROUNDS[self.ground], self.seed, self.duration_s)


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

_OF_KIND = {
    "quadruped": ("walk", "trot-slow", "trot-fast", "turn", "sideways", "stand", "hop", "landing"),
    "hexapod": ("walk", "tripod", "tripod-fast", "turn", "sideways", "stand", "hop", "landing"),
}


def _runs(
    robots: tuple[str, ...], grounds: tuple[str, ...], duration_s: float, first_seed: int
) -> tuple[WalkerRun, ...]:
    return tuple(
        WalkerRun(robot, gait, ground, first_seed + 100 * a + b, duration_s)
        for a, robot in enumerate(robots)
        for b, (ground, gait) in enumerate(
            (ground, gait) for ground in grounds for gait in _OF_KIND[robot.partition("-")[0]]
        )
    )


#: What networks are trained on.
TRAINING = _runs(
    ("quadruped-300g", "hexapod-12kg"), ("floor", "carpet", "wet", "icy", "ramp", "stones"), 5.0, 1000
)
#: What recipes and thresholds are chosen by.
SELECTION = _runs(("quadruped-2kg", "hexapod-300g"), ("tiles", "ascent"), 6.0, 5000)


def _judging(robot: str, first_seed: int) -> tuple[WalkerRun, ...]:
    walk, slow, fast, turn, _, stand, hop, landing = _OF_KIND[robot.partition("-")[0]]
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


#: What everything is judged by: robots of the two larger released feet.
JUDGEMENT = _judging("hexapod-2kg", 9000) + _judging("quadruped-12kg", 9100)


def saved_logs(runs: tuple[WalkerRun, ...], folder: Path) -> Iterator[tuple[WalkerRun, WalkerLog]]:
    """Yield the runs with their logs, from a folder where they are kept once simulated; falls are left out.

    Args:
        runs: The runs.
        folder: Where the logs are kept; made if missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for run in runs:
        path = folder / f"{run.name.replace(' ', '_')}_{run.seed}.npz"
        if not path.exists():
            try:
                run.log().save(path)
            except ConfigError:
                continue
        yield run, WalkerLog.load(path)
