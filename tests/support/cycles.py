"""Cycles of random bits, and recordings of them."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footsense.errors import RecordingError
from footsense.frames import (
    ELEMENTS,
    BaselineDrift,
    BaselineStatus,
    CanStatistics,
    CapFrame,
    Cause,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Cycle,
    Flag,
    GaitEvent,
    GaitEventKind,
    GaitFrame,
    Reading,
    ReferenceSamples,
    Slip,
    State,
)
from footsense.recording.mcap_writer import McapFile
from footsense.recording.replay import Replay
from footsense.ring.records import NumberedCycle, ServiceStatus
from tests.support.frames import contact_frame

LEGS = ("lf", "lm", "lr", "rf", "rm", "rr")
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

    def floats(*shape: int) -> NDArray[np.float64]:
        values = rng.integers(0, 2**64, shape, dtype=np.uint64).view(np.float64)
        return np.where(rng.random(shape) < 0.2, rng.choice(AWKWARD, shape), values)

    scan = CapFrame(
        number,
        rng.integers(0, 2**63, (n_legs, ELEMENTS)),
        floats(n_legs, ELEMENTS),
        rng.choice([int(r) for r in Reading], (n_legs, ELEMENTS)).astype(np.uint8),
    )
    forces = ContactFrame(
        number,
        1_000 + number * PERIOD_NS,
        rng.integers(0, 2**63, n_legs),
        floats(n_legs, 3),
        floats(n_legs, 3),
        rng.choice([int(s) for s in State], n_legs).astype(np.uint8),
        rng.integers(0, 1 << ELEMENTS, n_legs).astype(np.uint16),
        rng.choice([int(f) for f in Flag], n_legs).astype(np.uint8),
        rng.choice([int(c) for c in Cause], n_legs).astype(np.uint8),
        BaselineDrift(
            rng.choice([int(z) for z in BaselineStatus], n_legs).astype(np.uint8),
            floats(n_legs),
            floats(n_legs),
            rng.integers(0, 2**63, n_legs),
        ),
        _gait(rng, floats, number, n_legs) if number % 10 == 1 else None,
    )
    commands = (TARE,) if number % 7 == 3 else ()
    reference = (
        None
        if n_samples is None
        else ReferenceSamples(
            rng.integers(0, 2**63, n_samples),
            floats(n_samples, 3),
            rng.integers(0, 2, n_samples).astype(np.bool_),
        )
    )
    temperature_c = rng.choice([np.nan, -40.0, 0.1, 1 / 3, 125.0], n_legs) if warm else None
    return Cycle(scan, commands, forces, outcomes, reference, temperature_c)


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


def _gait(
    rng: np.random.Generator, floats: Callable[..., NDArray[np.float64]], number: int, n_legs: int
) -> GaitFrame:
    """Return a gait of random bits, with up to two events."""

    def flags() -> NDArray[np.bool_]:
        return rng.random(n_legs) < 0.5

    kinds = rng.choice([int(kind) for kind in GaitEventKind], number % 3)
    return GaitFrame(
        t_ns=1_000 + number * PERIOD_NS,
        contact=flags(),
        contact_raw=flags(),
        probability=floats(n_legs),
        touchdown_ns=rng.integers(0, 2**63, n_legs),
        touchdown_sigma_s=floats(n_legs),
        lift_off_ns=rng.integers(0, 2**63, n_legs),
        lift_off_sigma_s=floats(n_legs),
        load_share=floats(n_legs),
        normal=floats(n_legs, 3),
        normal_sigma_rad=floats(n_legs),
        tangential_over_normal=floats(n_legs),
        tangential_over_normal_sigma=floats(n_legs),
        slip=rng.choice([int(slip) for slip in Slip], n_legs).astype(np.uint8),
        friction=float(rng.choice([np.nan, 0.1, 1 / 3])),
        all_in_air=bool(number % 2),
        events=tuple(GaitEvent(GaitEventKind(kind), 0, -number, 1 / 3) for kind in kinds.tolist()),
    )


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


def write(path: Path, cycles: list[Cycle], every: int = 10) -> Path:
    """Write a finished recording in this process, a chunk for every so many cycles."""
    with path.open("wb") as file:
        recording = McapFile(file.fileno(), {"legs": ",".join(LEGS), "scene": "test"})
        for number, one in enumerate(cycles):
            recording.add_entry(NumberedCycle(number, one))
            if number % every == every - 1:
                recording.flush()
        recording.finish()
    return path


def read_until_damage(path: Path) -> tuple[list[Cycle], RecordingError | None]:
    cycles: list[Cycle] = []
    try:
        cycles.extend(Replay(path))
    except RecordingError as error:
        return cycles, error
    return cycles, None
