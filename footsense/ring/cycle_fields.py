"""Table of the arrays of a cycle, by which the ring and the recording store them."""

from collections.abc import Mapping
from enum import IntEnum
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.frames import (
    ELEMENTS,
    BaselineDrift,
    BaselineStatus,
    CapFrame,
    Cause,
    ContactFrame,
    GaitEvent,
    GaitFrame,
    Reading,
    Slip,
    State,
)

#: A counter or time: not negative, 63 bits.
NonNegativeInt64 = Annotated[int, msgspec.Meta(ge=0, le=(1 << 63) - 1)]


class CycleField(NamedTuple):
    """One array of a cycle's frames, with one row per leg: type, shape, keys in JSON.

    Attributes:
        dtype: Type of its entries, as numpy calls it.
        row_shape: Shape of a leg's row.
        json_keys: Keys of a leg's row in JSON: one, or one for each component.
        max_code: Largest code or mask with a meaning; None for numbers.
        code_enum: Enumeration by whose names JSON calls the codes; None for numbers.
    """

    dtype: str
    row_shape: tuple[int, ...]
    json_keys: tuple[str, ...]
    max_code: int | None = None
    code_enum: type[IntEnum] | None = None


#: The arrays of a cycle by their path, such as `forces.force_n`; wide entries first, so that a record has all aligned.
CYCLE_FIELDS = {
    "scan.t_ns": CycleField("<i8", (ELEMENTS,), ("t_ns",)),
    "scan.capacitance_pf": CycleField("<f8", (ELEMENTS,), ("capacitance_pf",)),
    "forces.t_ns": CycleField("<i8", (), ("t_ns",)),
    "forces.force_n": CycleField("<f8", (3,), ("fx_n", "fy_n", "fz_n")),
    "forces.sigma_n": CycleField("<f8", (3,), ("sigma_x_n", "sigma_y_n", "sigma_z_n")),
    "forces.baseline.mean_pf": CycleField("<f8", (), ("baseline_mean_pf",)),
    "forces.baseline.worst_pf": CycleField("<f8", (), ("baseline_worst_pf",)),
    "forces.baseline.moved_ns": CycleField("<i8", (), ("baseline_moved_ns",)),
    "forces.fault_mask": CycleField("<u2", (), ("fault_mask",), (1 << ELEMENTS) - 1),
    "scan.reading": CycleField("u1", (ELEMENTS,), ("reading",), max(Reading)),
    "forces.state": CycleField("u1", (), ("state",), max(State), State),
    "forces.cause": CycleField("u1", (), ("cause",), max(Cause), Cause),
    "forces.flags": CycleField("u1", (), ("flags",), 255),
    "forces.baseline.status": CycleField("u1", (), ("baseline_status",), max(BaselineStatus), BaselineStatus),
}

#: The arrays of a gait, which few cycles have.
GAIT_FIELDS = {
    "gait.probability": CycleField("<f8", (), ("probability",)),
    "gait.touchdown_ns": CycleField("<i8", (), ("touchdown_ns",)),
    "gait.touchdown_sigma_s": CycleField("<f8", (), ("touchdown_sigma_s",)),
    "gait.lift_off_ns": CycleField("<i8", (), ("lift_off_ns",)),
    "gait.lift_off_sigma_s": CycleField("<f8", (), ("lift_off_sigma_s",)),
    "gait.load_share": CycleField("<f8", (), ("load_share",)),
    "gait.normal": CycleField("<f8", (3,), ("normal_x", "normal_y", "normal_z")),
    "gait.normal_sigma_rad": CycleField("<f8", (), ("normal_sigma_rad",)),
    "gait.tangential_over_normal": CycleField("<f8", (), ("tangential_over_normal",)),
    "gait.tangential_over_normal_sigma": CycleField("<f8", (), ("tangential_over_normal_sigma",)),
    "gait.contact": CycleField("u1", (), ("contact",), 1),
    "gait.contact_raw": CycleField("u1", (), ("contact_raw",), 1),
    "gait.slip": CycleField("u1", (), ("slip",), max(Slip), Slip),
}


def _names_under(place: str) -> dict[str, str]:
    """Return the names of the arrays of a frame with their paths."""
    split = ((path, *path.rpartition(".")) for path in CYCLE_FIELDS)
    return {name: path for path, parent, _, name in split if parent == place}


_SCAN_NAMES, _FORCES_NAMES, _BASELINE_NAMES = map(_names_under, ("scan", "forces", "forces.baseline"))


def scan_from_arrays(sequence: int, arrays: Mapping[str, NDArray[Any]]) -> CapFrame:
    """Return the capacitance frame made of arrays by their paths in `CYCLE_FIELDS`."""
    return CapFrame(sequence, **{name: arrays[path] for name, path in _SCAN_NAMES.items()})


def forces_from_arrays(sequence: int, t_sent_ns: int, arrays: Mapping[str, NDArray[Any]]) -> ContactFrame:
    """Return the force frame made of arrays by their paths in `CYCLE_FIELDS`."""
    baseline = BaselineDrift(**{name: arrays[path] for name, path in _BASELINE_NAMES.items()})
    forces: Any = {name: arrays[path] for name, path in _FORCES_NAMES.items()}
    return ContactFrame(sequence, t_sent_ns, **forces, baseline=baseline)


def gait_from_arrays(
    t_ns: int,
    friction: float,
    all_in_air: bool,  # noqa: FBT001 - a value of the frame
    events: tuple[GaitEvent, ...],
    arrays: Mapping[str, NDArray[Any]],
) -> GaitFrame:
    """Return the gait frame made of arrays by their paths in `GAIT_FIELDS`."""
    values = {path.partition(".")[2]: arrays[path] for path in GAIT_FIELDS}
    for name in ("contact", "contact_raw"):
        values[name] = values[name].astype(np.bool_)
    return GaitFrame(t_ns=t_ns, friction=friction, all_in_air=all_in_air, events=events, **values)
