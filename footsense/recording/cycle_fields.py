"""The arrays of a cycle, by which the pipe and the recording store them: one table for both."""

from collections.abc import Mapping
from enum import IntEnum
from typing import Annotated, Any, NamedTuple

import msgspec
from numpy.typing import NDArray

from footsense.frames import (
    ELEMENTS,
    BaselineDrift,
    BaselineStatus,
    CapFrame,
    Cause,
    ContactFrame,
    Reading,
    State,
)

#: A counter or time: not negative, 63 bits.
Count = Annotated[int, msgspec.Meta(ge=0, le=(1 << 63) - 1)]

#: Stands for the cause in recordings from before causes were recorded; no `Cause` has this code.
NOT_RECORDED = 255


class CycleField(NamedTuple):
    """One array of a cycle's frames, with a row for each leg.

    Attributes:
        kind: Type of its entries, as numpy calls it.
        shape: Shape of a leg's row.
        keys: Keys of a leg's row in JSON: one, or one for each component.
        most: Largest code or mask with a meaning; None for numbers.
        names: Enumeration by whose names JSON calls the codes; None for numbers.
    """

    kind: str
    shape: tuple[int, ...]
    keys: tuple[str, ...]
    most: int | None = None
    names: type[IntEnum] | None = None


_NINE = (ELEMENTS,)

#: The arrays by their place in a cycle.
FIELDS = {
    "scan.t_ns": CycleField("<i8", _NINE, ("t_ns",)),
    "scan.capacitance_pf": CycleField("<f8", _NINE, ("capacitance_pf",)),
    "scan.reading": CycleField("u1", _NINE, ("reading",), max(Reading)),
    "forces.force_n": CycleField("<f8", (3,), ("fx_n", "fy_n", "fz_n")),
    "forces.sigma_n": CycleField("<f8", (3,), ("sigma_x_n", "sigma_y_n", "sigma_z_n")),
    "forces.state": CycleField("u1", (), ("state",), max(State), State),
    "forces.fault_mask": CycleField("<u2", (), ("fault_mask",), (1 << ELEMENTS) - 1),
    "forces.flags": CycleField("u1", (), ("flags",), 255),
    "forces.t_ns": CycleField("<i8", (), ("t_ns",)),
    "forces.cause": CycleField("u1", (), ("cause",), max(Cause), Cause),
    "forces.baseline.status": CycleField("u1", (), ("baseline_status",), max(BaselineStatus), BaselineStatus),
    "forces.baseline.mean_pf": CycleField("<f8", (), ("baseline_mean_pf",)),
    "forces.baseline.worst_pf": CycleField("<f8", (), ("baseline_worst_pf",)),
    "forces.baseline.moved_ns": CycleField("<i8", (), ("baseline_moved_ns",)),
}


def scan_of(sequence: int, arrays: Mapping[str, NDArray[Any]]) -> CapFrame:
    """Return the scan with these arrays, by their places in `FIELDS`."""
    return CapFrame(sequence, **_below("scan", arrays))


def forces_of(sequence: int, t_sent_ns: int, arrays: Mapping[str, NDArray[Any]]) -> ContactFrame:
    """Return the forces with these arrays, by their places in `FIELDS`."""
    baseline = BaselineDrift(**_below("forces.baseline", arrays))
    return ContactFrame(sequence, t_sent_ns, **_below("forces", arrays), baseline=baseline)


def _below(place: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    split = (path.rpartition(".") for path in FIELDS)
    return {name: arrays[f"{parent}.{name}"] for parent, _, name in split if parent == place}
