"""Loads of a log: what the feet of a robot felt over time, from a file of numpy arrays, repeated at its end.

`footsense lab walk` writes such files; any program may, with the arrays of `LOG_ARRAYS`. `RowsBetween` interpolates
between the times of a log.
"""

import io
import math
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from footsense.errors import ConfigError
from footsense.frames import Stamps, Vector
from footsense.regular_file import read_regular
from footsense.sim.loads.ground_load import IN_THE_AIR, MIN_ELEVATION_DEG, GroundContact

#: Arrays of a log: names of the legs, times [s], ground reactions [N] and inward unit normals, both (n, legs, 3) in the
#: foot's frame.
LOG_ARRAYS = ("legs", "t_s", "force_n", "normal")
#: Largest file that is read, and most that its arrays unpack to [bytes]: seven minutes of six legs.
MAX_LOG_BYTES = 1 << 27
#: Deviation of a normal's length from 1 that rounding explains [1].
_LENGTH_TOLERANCE = 1e-3
#: Time in which the first loads of a log rise: the robot is set down [s].
_RISE_S = 0.1
_NS_PER_S = 1_000_000_000


class RowsBetween(NamedTuple):
    """Rows of a log beside n times, to interpolate its arrays linearly.

    Attributes:
        before: Row before each time, shape (n,).
        share: Share of the way to the next row [1], shape (n,).
    """

    before: NDArray[np.intp]
    share: Vector

    @classmethod
    def of(cls, log_t_s: Vector, t_s: Vector) -> Self:
        """Return the rows beside times [s], those outside the log brought to its ends.

        Args:
            log_t_s: Times of the log's rows, rising [s].
            t_s: The times [s], shape (n,).
        """
        before = np.clip(np.searchsorted(log_t_s, t_s, "right") - 1, 0, len(log_t_s) - 2)
        share = (t_s - log_t_s[before]) / (log_t_s[before + 1] - log_t_s[before])
        return cls(before, np.clip(share, 0.0, 1.0))

    def values(self, rows: Vector) -> Vector:
        """Return an array of the log at the times, shape (n, ...)."""
        share = self.share.reshape(-1, *[1] * (rows.ndim - 1))
        between: Vector = (1.0 - share) * rows[self.before] + share * rows[self.before + 1]
        return between

    def normals(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the contact normals at the times, unit vectors; that of a row in the air says nothing of a touch.

        Args:
            normal: Normals of the log, shape (..., 3).
            force_n: Its forces [N], same shape; zero in the air.
        """
        first, second = (force_n[rows].any(axis=-1, keepdims=True) for rows in (self.before, self.before + 1))
        one = np.where(first, normal[self.before], normal[self.before + 1])
        mixed = np.where(first & second, self.values(normal), one)
        unit: Vector = mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)
        return unit


def peak_n(force_n: Vector) -> float:
    """Return the force that one in a thousand loaded samples of a log exceeds [N]; 0 without a load."""
    size_n = np.linalg.norm(force_n, axis=-1)
    loaded_n = size_n[size_n > 0.0]
    return float(np.percentile(loaded_n, 99.9)) if loaded_n.size else 0.0


def _unpack(content: bytes, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Return arrays of the bytes of a file.

    Raises:
        ValueError: It unpacks to too much, or does not have one of them.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(info.file_size for info in archive.infolist()) > MAX_LOG_BYTES:
            raise ValueError(f"it unpacks to more than {MAX_LOG_BYTES} bytes")
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        if missing := [name for name in names if name not in stored]:
            raise ValueError(f"it has no array {missing[0]}, of {', '.join(names)}")
        return {name: np.asarray(stored[name]) for name in names}


def read_log_arrays(path: Path, names: Sequence[str] = LOG_ARRAYS) -> dict[str, NDArray[Any]]:
    """Return arrays of a log's file.

    Raises:
        ConfigError: It is missing, too large, no such file, or one of the arrays is not in it.
    """
    try:
        return _unpack(read_regular(path, MAX_LOG_BYTES), names)
    except OSError as error:
        raise ConfigError(f"cannot read the log {path}: {error.strerror or error}") from error
    except Exception as error:  # zipfile and numpy raise a dozen types without a common base
        raise ConfigError(f"{path} is no log of loads, a file of numpy arrays (.npz): {error}") from error


def _faults_of_shape(arrays: dict[str, NDArray[Any]]) -> Iterator[str]:
    """Yield which arrays of a log do not fit together, or are not numbers."""
    legs, t_s = arrays["legs"], arrays["t_s"]
    if legs.ndim != 1 or legs.dtype.kind != "U" or not 0 < len(set(legs.tolist())) == len(legs):
        yield "legs are different names, such as lf, lr, rf, rr"
    if t_s.ndim != 1 or len(t_s) < 2:
        yield f"t_s has two times at least, got the shape {t_s.shape}"
    wanted = {"t_s": t_s.shape, **dict.fromkeys(("force_n", "normal"), (len(t_s), len(legs), 3))}
    for name, shape in wanted.items():
        if arrays[name].shape != shape:
            yield f"{name} has the shape {shape}, by legs and t_s, got {arrays[name].shape}"
        if arrays[name].dtype.kind not in "fiu" or not np.isfinite(arrays[name]).all():
            yield f"{name} has something that is no finite number"


def _faults(arrays: dict[str, NDArray[Any]]) -> Iterator[str]:
    """Yield what is wrong with the arrays of a log, the gravest first."""
    yield from _faults_of_shape(arrays)
    t_s, force_n, normal = (arrays[name] for name in LOG_ARRAYS[1:])
    if not (np.diff(t_s) > 0.0).all():
        yield "t_s does not rise from each time to the next"
    length = np.linalg.norm(normal, axis=2)
    if np.abs(length - 1.0).max() > _LENGTH_TOLERANCE:
        yield f"normal has unit vectors, got lengths from {length.min():.3g} to {length.max():.3g}"
    loaded = force_n.any(axis=2)
    if not loaded.any():
        yield "force_n is zero everywhere"
    lowest = float((normal[:, :, 2] / length).min(initial=1.0, where=loaded))
    if lowest < math.sin(math.radians(MIN_ELEVATION_DEG)):
        yield (
            f"normal leans to an elevation of {math.degrees(math.asin(lowest)):.0f} deg under load; "
            f"the foot's response is known from {MIN_ELEVATION_DEG} deg up"
        )
    if ((force_n * normal).sum(axis=2) < 0.0).any():
        yield "force_n pulls at a foot; it is the ground's force on the foot, which presses along normal"


class RepeatedLog:
    """Contact source of a log: the robot is set down within 0.1 s, and walks the log again and again.

    Args:
        path: The file.
        from_ns: Start [ns]; before it, all feet are in the air.
        peak_force_n: Force to which the log is scaled, as of `peak_n` [N]; None for its own forces.

    Raises:
        ConfigError: The file is no log.

    Attributes:
        from_ns: Start [ns].
        t_ns: Times of the log's rows since its start [ns], shape (n,).
    """

    def __init__(self, path: Path, from_ns: int, peak_force_n: float | None = None) -> None:
        arrays = read_log_arrays(path)
        for fault in _faults(arrays):
            raise ConfigError(f"{path}: {fault}")
        t_s, force_n, self._normal = (arrays[name].astype(np.float64) for name in LOG_ARRAYS[1:])
        scale = 1.0 if peak_force_n is None else peak_force_n / peak_n(force_n)
        self._path, self.from_ns = path, from_ns
        self._row = {leg: row for row, leg in enumerate(arrays["legs"].tolist())}
        self._t_s, self._force_n = t_s - t_s[0], scale * force_n
        self.t_ns: Stamps = np.round(self._t_s * _NS_PER_S).astype(np.int64)
        self._last: tuple[int, Vector, Vector] | None = None  # all legs are asked for at one time

    def require_legs(self, legs: Sequence[str]) -> None:
        """Raise an error for a leg that the log does not have: it would look like a foot that feels nothing.

        Raises:
            ConfigError: There is one.
        """
        if missing := [leg for leg in legs if leg not in self._row]:
            raise ConfigError(
                f"{self._path}: has no leg {missing[0]}: it has {', '.join(self._row)}, this robot {', '.join(legs)}"
            )

    def contact(self, leg: str, t_ns: int) -> GroundContact:
        """Return the true ground contact of a leg at a time [ns]."""
        if t_ns < self.from_ns:
            return IN_THE_AIR
        if self._last is None or self._last[0] != t_ns:
            self._last = t_ns, *self._loads(t_ns)
        _, force_n, normal = self._last
        row = self._row[leg]
        return GroundContact(normal[row], force_n[row])

    def contacts(self, leg: str, *, first: bool) -> tuple[Vector, Vector]:
        """Return normals and forces [N] of a leg at all rows, shape (n, 3); in the first round it is set down."""
        column, risen = self._row[leg], np.minimum(self._t_s / _RISE_S, 1.0) if first else np.ones(1)
        return self._normal[:, column], risen[:, None] * self._force_n[:, column]

    def _loads(self, t_ns: int) -> tuple[Vector, Vector]:
        """Return the forces [N] and normals of all legs of the log at a time, shape (legs, 3)."""
        since_s = (t_ns - self.from_ns) / _NS_PER_S
        rows = RowsBetween.of(self._t_s, np.array([since_s % self._t_s[-1]]))
        risen = min(since_s / _RISE_S, 1.0)
        return risen * rows.values(self._force_n)[0], rows.normals(self._normal, self._force_n)[0]
