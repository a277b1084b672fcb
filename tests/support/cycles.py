"""Cycles of random bits, and recordings of them."""

import functools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from footsense.errors import RecordingError
from footsense.frames import (
    BaselineDrift,
    CanStatistics,
    CapFrame,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Cycle,
    CycleField,
    GaitEvent,
    GaitEventKind,
    GaitFrame,
    LegMotion,
    ReferenceSamples,
    State,
)
from footsense.recording.mcap_writer import McapFile
from footsense.recording.replay import Replay
from footsense.ring.records import NumberedCycle, ServiceStatus
from tests.support.frames import contact_frame

LEGS = ("lf", "lm", "lr", "rf", "rm", "rr")
HEADER = {"legs": ",".join(LEGS), "scene": "test"}
PERIOD_NS = 25_000_000
TARE = Command(CommandKind.TARE, 2)
AWKWARD = np.array([np.nan, np.inf, -np.inf, -0.0, 5e-324, 0.1, 1.7976931348623157e308, 1 / 3])


def cycle(
    number: int,
    seed: int = 0,
    *,
    outcomes: tuple[CommandResult, ...] = (),
    n_legs: int = 6,
    n_samples: int | None = None,
    warm: bool = False,
) -> Cycle:
    """Return a cycle of random bits, awkward floats among them."""
    rng = np.random.default_rng([seed, number])
    t_ns = 1_000 + number * PERIOD_NS
    kinds = rng.choice([int(kind) for kind in GaitEventKind], number % 3).tolist()
    gait = GaitFrame(
        t_ns=t_ns,
        **_arrays(GaitFrame, rng, n_legs),
        friction=float(rng.choice([np.nan, 0.1, 1 / 3])),
        all_in_air=bool(number % 2),
        events=tuple(GaitEvent(GaitEventKind(kind), 0, -number, 1 / 3) for kind in kinds),
    )
    forces = ContactFrame(
        number,
        t_ns,
        **_arrays(ContactFrame, rng, n_legs),
        baseline=BaselineDrift(**_arrays(BaselineDrift, rng, n_legs)),
        gait=gait if number % 10 == 1 else None,
    )
    scan = CapFrame(number, **_arrays(CapFrame, rng, n_legs))
    commands = (TARE,) if number % 7 == 3 else ()
    reference = (
        None
        if n_samples is None
        else ReferenceSamples(
            rng.integers(0, 2**63, n_samples),
            _floats(rng, n_samples, 3),
            rng.integers(0, 2, n_samples).astype(np.bool_),
        )
    )
    temperature_c = rng.choice([np.nan, -40.0, 0.1, 1 / 3, 125.0], n_legs) if warm else None
    motion = LegMotion(**_arrays(LegMotion, rng, n_legs)) if number % 5 == 2 else None
    return Cycle(scan, commands, forces, outcomes, reference, temperature_c, motion)


@functools.cache
def _templates() -> list[Cycle]:
    return [cycle(number) for number in range(50)]


def quick_cycle(number: int) -> Cycle:
    """Return a cycle of random bits at its own time, made faster than by `cycle`."""
    template = _templates()[number % 50]
    return template._replace(forces=template.forces._replace(t_sent_ns=1_000 + number * PERIOD_NS))


def plain_cycle(sent_ns: int, states: Sequence[State], **forces: Any) -> Cycle:
    """Return a cycle of legs without forces in some states; `forces` replaces fields of its forces."""
    n = len(states)
    return cycle(0, n_legs=n)._replace(forces=contact_frame(sent_ns, n, state=np.array(states), **forces))


def _floats(rng: np.random.Generator, *shape: int) -> NDArray[np.float64]:
    values = rng.integers(0, 2**64, shape, dtype=np.uint64).view(np.float64)
    return np.where(rng.random(shape) < 0.2, rng.choice(AWKWARD, shape), values)


@functools.cache
def _fields(frame: type) -> dict[str, CycleField]:
    hints = get_type_hints(frame, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items() if hasattr(hint, "__metadata__")}


def _arrays(frame: type, rng: np.random.Generator, n_legs: int) -> dict[str, Any]:
    """Return random bits for each array of a kind of frame, codes and masks up to the largest with a meaning."""

    def drawn(field: CycleField) -> NDArray[Any]:
        shape = (n_legs, *field.row_shape)
        if field.max_code is not None:
            codes = rng.integers(0, field.max_code + 1, shape)
            return codes.astype(bool if field.max_code == 1 else field.dtype)
        return rng.integers(0, 2**63, shape) if field.dtype == "<i8" else _floats(rng, *shape)

    return {name: drawn(field) for name, field in _fields(frame).items()}


def same(a: Any, b: Any) -> bool:
    """Return whether two cycles, or parts of them, are equal bit for bit, NaN equal to NaN."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray | float):
        a, b = np.asarray(a), np.asarray(b)
        if a.dtype.kind == "f" and b.dtype.kind == "f" and a.shape == b.shape:
            signs = np.signbit(a) == np.signbit(b)
            return bool((((a == b) & signs) | (np.isnan(a) & np.isnan(b))).all())
        return np.array_equal(a, b)
    return bool(a == b)


def status() -> ServiceStatus:
    """Return the status of a service of six legs that knows no baselines."""
    return ServiceStatus(CanStatistics(), np.full(54, np.nan).tobytes())


def write(path: Path, cycles: Iterable[Cycle], every: int = 10, header: dict[str, str] = HEADER) -> Path:
    """Write a finished recording in this process, a chunk for every so many cycles."""
    with path.open("wb") as file:
        recording = McapFile(file.fileno(), header)
        for number, one in enumerate(cycles):
            recording.add_entry(NumberedCycle(number, one))
            if number % every == every - 1:
                recording.flush()
        recording.finish()
    return path


def without_temperatures(recording: Path, path: Path, **header: str) -> Path:
    """Write a recording again as of feet that told no temperature."""
    replay = Replay(recording)
    cycles = (one._replace(temperature_c=None) for one in replay)
    return write(path, cycles, header={**replay.header, **header})


def read_until_damage(path: Path) -> tuple[list[Cycle], RecordingError | None]:
    cycles: list[Cycle] = []
    try:
        cycles.extend(Replay(path))
    except RecordingError as error:
        return cycles, error
    return cycles, None
