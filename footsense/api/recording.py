"""Walks as arrays: `footsense.read` of a recording, `footsense.simulate` of a simulated robot."""

import warnings
from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import replace

from footsense.can.interface import Can
from footsense.client.events import FootEvent
from footsense.config import DEFAULT, load_config
from footsense.daemon.service import open_service
from footsense.daemon.walker_scene import scene_of
from footsense.errors import FootsenseError, RecordingError
from footsense.frames import IS_USABLE_STATE, Codes, Cycle, Flag, GaitEvent, Mask, State, Vector
from footsense.ports import Observer
from footsense.recording.replay import Replay
from footsense.ring.records import CYCLE_FIELDS

if TYPE_CHECKING:
    import pandas as pd

#: Arrays of a cycle that are kept, in the order in which `_CycleCollector` unpacks them.
_ARRAYS = {
    path: attrgetter(path)
    for path in (
        *("scan.t_ns", "scan.capacitance_pf"),
        *("forces.force_n", "forces.sigma_n", "forces.state", "forces.flags"),
        *("forces.contact_probability", "forces.holds"),
    )
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Recording:
    """A recorded or simulated walk: n cycles of all legs, as arrays.

    Arrays hold the legs in the order of `legs`: `walk.force_n[:, walk.legs.index("lf")]`.

    Attributes:
        legs: Name of each leg.
        t_s: Time of each cycle, which its forces are valid for [s], shape (n,), 0 at the first.
        force_n: Ground reaction on each foot in the foot's frame: x forward, y left, z along the leg towards the body
            [N], shape (n, legs, 3); NaN unless usable. Weigh it by `sigma_n`: where readings contradict one another, as
            in the cycle in which a line breaks, it may be far off.
        sigma_n: Standard deviation of each component [N], same shape; in the air larger than what is seen there, as a
            touch may have begun since the readings.
        state: Code of each leg's state, shape (n, legs), uint8 of `State`; `walk.state == footsense.State.VALID`.
        contact: Whether each foot is in contact with the ground, shape (n, legs); False unless usable.
        contact_probability: Probability that each foot is on the ground [1], shape (n, legs), NaN unless usable, and of
            older recordings.
        holds: Probability that each foot stands still on the ground [1], same.
        capacitance_pf: Latest reading of each element, stray included [pF], shape (n, legs, 9), NaN where there is
            none; element 3 * row + column, row 0 the most forward, column 0 the leftmost. A cycle is one conversion:
            of each leg one row is new, or one element where a foot has one converter.
        reading_t_s: Time of each of these readings, on the axis of `t_s` [s], same shape, NaN where there is none.
        events: Touchdowns, lift-offs and slips, in the order in which they were noticed.
        true_force_n: The force that each simulated foot felt at `t_s` [N], shape (n, legs, 3); None of a recording.
    """

    legs: tuple[str, ...]
    t_s: Vector
    force_n: Vector
    sigma_n: Vector
    state: Codes
    contact: Mask
    contact_probability: Vector
    holds: Vector
    capacitance_pf: Vector
    reading_t_s: Vector
    events: tuple[FootEvent, ...]
    true_force_n: Vector | None = None

    def __repr__(self) -> str:
        """Return what the walk is, without its arrays."""
        duration_s = float(self.t_s[-1]) if len(self.t_s) else 0.0
        return (
            f"<Recording of {', '.join(self.legs)}: {len(self.t_s)} cycles in {duration_s:.3g} s, "
            f"{len(self.events)} events>"
        )

    @property
    def usable(self) -> Mask:
        """Whether the force of each leg may be used: its state is VALID or DEGRADED, shape (n, legs)."""
        return np.asarray(IS_USABLE_STATE[self.state])

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a table of pandas with a row for each cycle and leg, units in the names of the columns.

        Columns: `t_s`, `leg`, `fx_n`, `fy_n`, `fz_n`, `sigma_x_n`, `sigma_y_n`, `sigma_z_n`, `state` by its name,
        `usable`, `contact`, `contact_probability`, `holds`, `capacitance_pf_` with the number of each element, and of a
        simulation `true_fx_n`, `true_fy_n` and `true_fz_n`.

        Raises:
            FootsenseError: pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise FootsenseError("to_dataframe() needs pandas: pip install pandas") from None
        n, n_legs = self.state.shape
        columns: dict[str, Any] = {
            "t_s": np.repeat(self.t_s, n_legs),
            "leg": pd.Categorical(np.tile(np.array(self.legs), n), self.legs),
        }

        def add(names: Iterable[str], values: Vector) -> None:
            columns.update(zip(names, values.reshape(n * n_legs, -1).T, strict=True))

        add(("fx_n", "fy_n", "fz_n"), self.force_n)
        add(("sigma_x_n", "sigma_y_n", "sigma_z_n"), self.sigma_n)
        columns["state"] = pd.Categorical.from_codes(self.state.ravel(), [state.name for state in State])
        columns["usable"], columns["contact"] = self.usable.ravel(), self.contact.ravel()
        columns["contact_probability"], columns["holds"] = (
            self.contact_probability.ravel(),
            self.holds.ravel(),
        )
        add((f"capacitance_pf_{element}" for element in range(9)), self.capacitance_pf)
        if self.true_force_n is not None:
            add(("true_fx_n", "true_fy_n", "true_fz_n"), self.true_force_n)
        return pd.DataFrame(columns)


def read(path: str | Path) -> Recording:
    """Read a recording made by `footsense run --record`, `footsense snapshot` or `footsense test-stand record`.

    A recording that is cut short is read as far as it is whole, with a warning that says how far.

    Args:
        path: The `.mcap` file; after a power cut or on a full disk the `.mcap.partial`. The recording of a service
            that was killed is whole: its writer is a process of its own.

    Raises:
        RecordingError: It is missing, not a recording of footsense, or has no whole cycle.
    """
    replay = Replay(Path(path))
    collected = _CycleCollector(replay.legs)
    try:
        for cycle in replay:
            collected.observe(cycle)
    except RecordingError as error:
        if not collected.n_cycles:
            raise
        warnings.warn(str(error), stacklevel=2)
    if not collected.n_cycles:
        raise RecordingError(f"{path}: has no cycle")
    return collected.recording()


def simulate(
    scene: str | Path = "tripod", *, duration_s: float = 5.0, config: str | Path | None = None
) -> Recording:
    """Simulate a walking robot: its feet, chips, buses and the service, in virtual time.

    In the first second of the scenes that come with footsense all feet hang in the air and are tared.

    Args:
        scene: Name of a scene, such as `tripod`, `measured_walk` or `faults`, path of a YAML file, or such as
            `walker:trot-fast` for the foot type's robot in MuJoCo (extra `walkers`).
        duration_s: Time of the robot [s]; it takes about as long on a slow computer, less on others.
        config: Configuration file of the robot, whose buses are then simulated; None for six legs with the feet
            `aoyagi-3x3`.

    Raises:
        ConfigError: Scene or configuration is missing or wrong.
        ValueError: The duration is not above 0.
    """
    if not duration_s > 0.0:
        raise ValueError(f"duration_s is above 0, got {duration_s:g}")
    robot = DEFAULT if config is None else load_config(Path(config))
    robot = replace(robot, can=Can(interface="virtual"), ring=None)
    with open_service(robot, scene_of(str(scene), robot, duration_s), real_time=False) as service:
        collected = _CycleCollector(service.legs, service.true_force_n_at)
        service.observers.append(collected)
        service.run(until_ns=service.clock.now_ns() + duration_s * 1e9)
    return collected.recording()


class _CycleCollector(Observer):
    """Observer that collects the arrays of cycles, without an object for each.

    Args:
        legs: Name of the leg in each row of the frames.
        true_force_n_at: True force on each foot at a time [ns -> N, shape (legs, 3)]; None if it is not known.

    Attributes:
        n_cycles: Cycles so far.
    """

    def __init__(self, legs: tuple[str, ...], true_force_n_at: Callable[[int], Vector] | None = None) -> None:
        self.n_cycles = 0
        self._legs = legs
        self._true_force_n_at = true_force_n_at
        self._sent_ns = array("q")
        self._bytes = {path: bytearray() for path in _ARRAYS}
        self._true_force_bytes = bytearray()
        self._events: list[GaitEvent] = []

    def observe(self, cycle: Cycle) -> None:
        """Add a cycle."""
        self.n_cycles += 1
        self._sent_ns.append(cycle.forces.t_sent_ns)
        for path, value_of in _ARRAYS.items():
            self._bytes[path] += value_of(cycle).astype(CYCLE_FIELDS[path].dtype, copy=False).tobytes()
        if self._true_force_n_at is not None:
            self._true_force_bytes += self._true_force_n_at(cycle.forces.t_sent_ns).tobytes()
        if cycle.forces.gait is not None:
            self._events += cycle.forces.gait.events

    def recording(self) -> Recording:
        """Return the collected cycles, at least one."""
        n, n_legs = self.n_cycles, len(self._legs)
        read_ns, capacitance_pf, force_n, sigma_n, state, flags, contact_probability, holds = (
            np.frombuffer(values, CYCLE_FIELDS[path].dtype).reshape(n, n_legs, *CYCLE_FIELDS[path].row_shape)
            for path, values in self._bytes.items()
        )
        true_force_n = np.frombuffer(self._true_force_bytes).reshape(-1, n_legs, 3)
        start_ns = self._sent_ns[0]
        return Recording(
            legs=self._legs,
            t_s=(np.array(self._sent_ns) - start_ns) * 1e-9,
            force_n=force_n,
            sigma_n=sigma_n,
            state=state,
            contact_probability=contact_probability,
            holds=holds,
            contact=(flags & Flag.CONTACT != 0) & IS_USABLE_STATE[state],
            capacitance_pf=capacitance_pf,
            reading_t_s=np.where(read_ns == 0, np.nan, (read_ns - start_ns) * 1e-9),
            events=tuple(
                FootEvent.of((event.t_ns - start_ns) * 1e-9, self._legs[event.leg], event.kind, event.sigma_s)
                for event in self._events
            ),
            true_force_n=true_force_n if len(true_force_n) else None,
        )
