"""Loads at rest in the recording of a robot that stands in several postures: mean and unloaded readings of each foot.

A foot stands as long as none of its readings moves by more than creep, for half a second. A second load that closes the
elements alike adds nothing and is left out. The unloaded readings are those of the times at which the service
itself said that the foot carries nothing; between them they drift in straight lines.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import NamedTuple, Self

import numpy as np

from footsense.calibration.loads import LoadedFoot
from footsense.calibration.recorded_session import leg_of_foot
from footsense.calibration.writer import file_sha256
from footsense.errors import CalibrationError, RecordingError
from footsense.frames import ELEMENTS, Mask, Reading, Stamps, Vector
from footsense.recording.replay import Replay
from footsense.ring.records import LostCycles

#: Shortest time that counts as standing, and as hanging [ns]; the first of both is left out: the load may still settle,
#: and rubber recovers.
_MIN_STANDING_NS, _MIN_HANGING_NS, _SETTLING_NS = 500_000_000, 300_000_000, 100_000_000
#: Largest change of a reading of a foot that stands: of the largest change by the load [1], as rubber creeps by 2 % a
#: second, and by noise [pF].
_STILL_TOLERANCE_REL, _STILL_TOLERANCE_PF = 0.05, 0.004
#: Mean change of the readings from which a foot carries a load [1]: as of a press on a test stand.
_MIN_LOAD_REL = 0.005
#: Force below which a foot hangs, over the largest of its type [1].
_HANGING_FORCE_REL = 0.01
#: Difference of two loads' readings below which they are alike, over the largest change by the load [1].
_ALIKE_REL = 0.08


class RestingSpan(NamedTuple):
    """A time in which a foot stands still, or hangs free.

    Attributes:
        begin_ns: Its begin [ns].
        end_ns: Its end [ns].
        change_pf: Mean readings less the unloaded ones [pF], shape (9,); zero where it hangs.
    """

    begin_ns: int
    end_ns: int
    change_pf: Vector


@dataclass(frozen=True, slots=True, eq=False)
class StandingLoads(LoadedFoot):
    """Different loads at rest of one foot.

    Attributes:
        n_alike: Loads that were left out, like one of these.
        standing_s: Time in which it stood [s].
        loaded_s: Time in which it carried a load [s].
        spans: All times in which it stood still or hung free, those of loads that are alike included.
    """

    n_alike: int = 0
    standing_s: float = 0.0
    loaded_s: float = 0.0
    spans: tuple[RestingSpan, ...] = ()

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the loads of several recordings as one set."""
        return cls(
            np.concatenate([part.capacitance_pf for part in parts]),
            np.concatenate([part.baseline_pf for part in parts]),
            sum(part.n_alike for part in parts),
            sum(part.standing_s for part in parts),
            sum(part.loaded_s for part in parts),
        )


class StandingRecording(NamedTuple):
    """Loads at rest of the named feet of a recorded robot.

    Attributes:
        path: The recording.
        sha256: Its hash.
        n_legs: Legs of the robot.
        feet: Loads by foot.
        temperature_c: Mean temperature of each foot [degC] by foot; None where it was not measured.
    """

    path: Path
    sha256: str
    n_legs: int
    feet: dict[str, StandingLoads]
    temperature_c: dict[str, float | None]


#: Whole scans of one leg: time [ns], readings [pF], NaN unless OK, and the size of the published force [N].
_Scans = tuple[Stamps, Vector, Vector]


def read_standing(
    path: Path,
    max_force_n: float,
    foot: str | None = None,
    on_bytes_read: Callable[[int], None] | None = None,
) -> StandingRecording:
    """Read the loads at rest of a recording.

    Args:
        path: The recording, of which all is used up to its first damage.
        max_force_n: Largest force of the foot type [N].
        foot: The one foot that is wanted; None for all that have a name.
        on_bytes_read: Receives the number of bytes read so far; None for nobody.

    Raises:
        RecordingError: It is no recording.
        CalibrationError: It has no named feet, or not this one, or one never hangs free.
    """
    recording = Replay(path, on_bytes_read)
    leg_of = leg_of_foot(recording.header)
    if not leg_of or foot not in {None, *leg_of}:
        raise CalibrationError(
            f"{path}: a recording of {', '.join(leg_of) or 'feet without names'}"
            f"{f', not of {foot}' if foot else ''}; name the robot's feet under `feet` of its file, and record again"
        )
    feet = list(leg_of) if foot is None else [foot]
    rows = {name: recording.legs.index(leg_of[name]) for name in feet}
    scans, temperature_c = _read_scans(recording, rows)
    loads = {}
    for name in feet:
        try:
            loads[name] = standing_loads(*scans[name], _HANGING_FORCE_REL * max_force_n)
        except CalibrationError as error:
            raise CalibrationError(f"{path}: {name} on {leg_of[name]}: {error}") from None
    return StandingRecording(path, file_sha256(path), len(recording.legs), loads, temperature_c)


def _read_scans(recording: Replay, rows: dict[str, int]) -> tuple[dict[str, _Scans], dict[str, float | None]]:
    newest_ns = dict.fromkeys(rows, 0)
    found: dict[str, list[tuple[int, Vector, float]]] = {name: [] for name in rows}
    temperatures_c: dict[str, list[float]] = {name: [] for name in rows}
    try:
        for entry in recording.entries():
            if isinstance(entry, LostCycles):
                continue
            scan, cycle = entry.cycle.scan, entry.cycle
            for name, row in rows.items():
                if cycle.temperature_c is not None and math.isfinite(cycle.temperature_c[row]):
                    temperatures_c[name].append(float(cycle.temperature_c[row]))
                stamps = scan.t_ns[row]
                if stamps.min() <= newest_ns[name]:
                    continue  # not all elements were read anew
                newest_ns[name] = int(stamps.max())
                readings = np.where(scan.reading[row] == Reading.OK, scan.capacitance_pf[row], np.nan)
                size_n = float(np.linalg.norm(cycle.forces.force_n[row]))
                found[name].append((int(stamps.mean()), readings, size_n))
    except RecordingError:
        pass  # what is before the damage is whole
    scans = {
        name: (
            np.array([scan[0] for scan in of_foot], np.int64),
            np.array([scan[1] for scan in of_foot]).reshape(-1, ELEMENTS),
            np.array([scan[2] for scan in of_foot]),
        )
        for name, of_foot in found.items()
    }
    means_c = {name: fmean(values) if values else None for name, values in temperatures_c.items()}
    return scans, means_c


def standing_loads(t_ns: Stamps, capacitance_pf: Vector, force_n: Vector, hanging_n: float) -> StandingLoads:
    """Return the different loads at rest of one foot.

    Args:
        t_ns: Time of each scan [ns], shape (scans,), rising.
        capacitance_pf: Its readings [pF], shape (scans, 9), NaN where there is none.
        force_n: Size of the force that the service published then [N], shape (scans,), NaN without one.
        hanging_n: Force below which the foot hangs free [N].

    Raises:
        CalibrationError: It never hangs free.
    """
    hangs = [
        span
        for span in _spans(t_ns, force_n < hanging_n, _MIN_HANGING_NS)
        if np.isfinite(capacitance_pf[span]).all()
    ]
    if not hangs:
        raise CalibrationError(
            "there is no time of 0.3 s in which it hangs free and has a force; let the recording begin before the "
            "tare, with the feet in the air, and end with them in the air"
        )
    times_ns = np.array([t_ns[span].mean() for span in hangs])
    unloaded_pf = np.array([capacitance_pf[span].mean(axis=0) for span in hangs])
    baseline_pf = np.stack([np.interp(t_ns, times_ns, one_pf) for one_pf in unloaded_pf.T], axis=1)
    change_pf = capacitance_pf - baseline_pf
    loaded = (change_pf / baseline_pf).mean(axis=1) > _MIN_LOAD_REL  # False with a NaN
    still = list(_still_spans(t_ns, change_pf, loaded))
    found_pf = np.array([one[span].mean(axis=0) for span in still for one in (capacitance_pf, baseline_pf)])
    readings_pf, unloaded_pf = found_pf.reshape(-1, 2, ELEMENTS).transpose(1, 0, 2)
    moved_pf = readings_pf - unloaded_pf
    different = list[int]()
    for row, one_pf in enumerate(moved_pf):
        off_pf = np.abs(moved_pf[different] - one_pf).max(axis=1)
        if not (off_pf <= _ALIKE_REL * np.abs(one_pf).max()).any():
            different.append(row)
    none_pf = np.zeros((len(hangs), ELEMENTS))
    spans = [
        RestingSpan(int(t_ns[span.start]), int(t_ns[span.stop - 1]), change_pf)
        for span, change_pf in zip([*hangs, *still], [*none_pf, *moved_pf], strict=True)
    ]
    return StandingLoads(
        readings_pf[different],
        unloaded_pf[different],
        len(still) - len(different),
        1e-9 * sum(span.end_ns - span.begin_ns for span in spans[len(hangs) :]),
        float(loaded[1:] @ np.diff(t_ns)) * 1e-9,
        tuple(spans),
    )


def _spans(t_ns: Stamps, holds: Mask, shortest_ns: int) -> Iterator[slice]:
    """Yield the spans of scans in which something holds for long enough, less a tenth of a second at both ends."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(int), [0]])))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        begin, until = np.searchsorted(
            t_ns, [t_ns[first] + _SETTLING_NS, t_ns[end - 1] - _SETTLING_NS + 1]
        ).tolist()
        if until > begin and t_ns[until - 1] - t_ns[begin] >= shortest_ns:
            yield slice(begin, until)


def _still_spans(t_ns: Stamps, change_pf: Vector, loaded: Mask) -> Iterator[slice]:
    """Yield the spans of scans in which the foot carries a load and none of its readings moves."""
    first = 0
    n = len(t_ns)
    while first < n:
        if not loaded[first]:
            first += 1
            continue
        tolerance_pf = max(_STILL_TOLERANCE_PF, _STILL_TOLERANCE_REL * np.abs(change_pf[first]).max())
        end = first + 1
        while end < n and loaded[end] and np.abs(change_pf[end] - change_pf[first]).max() <= tolerance_pf:
            end += 1
        settled = int(np.searchsorted(t_ns, t_ns[first] + _SETTLING_NS))
        if settled < end and t_ns[end - 1] - t_ns[first] >= _MIN_STANDING_NS:
            yield slice(settled, end)
        first = end
