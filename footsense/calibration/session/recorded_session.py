"""A recording from the test_stand, read as what it is for: one session of loads of one foot."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import msgspec

from footsense.calibration.loads.detection import CalibrationLoad, LoadDetector, Rejection
from footsense.calibration.session.reference_lag import lag_words
from footsense.calibration.writer import file_sha256
from footsense.config.test_stand import StandConfig
from footsense.errors import CalibrationError, RecordingError
from footsense.frames import Cycle
from footsense.recording.pipe_format import Loss
from footsense.recording.replay import Replay

__all__ = ["RecordedSession", "read_session", "read_sessions"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSession:
    """One mounting of a foot on the test_stand, as recorded.

    Attributes:
        path: The recording.
        sha256: Its hash.
        name: The session's name; the file's where it was given none.
        foot: The foot, such as `foot-0007`.
        foot_type: Its type.
        test_stand: What the recording says of its reference; None if nothing that this version reads.
        temperature_c: Mean temperature of the foot's converter [degC]; None if it has no sensor.
        loads: Those that count, in their order.
        refused: How many do not count, by reason.
        n_lost: Cycles that the recorder could not keep.
        damage: Why the recording ends early; empty if it is whole.
    """

    path: Path
    sha256: str
    name: str
    foot: str
    foot_type: str
    test_stand: StandConfig | None
    temperature_c: float | None
    loads: tuple[CalibrationLoad, ...]
    refused: Counter[Rejection]
    n_lost: int
    damage: str

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is missing of it, one line each."""
        found = []
        if self.refused:
            n, why = self.refused.total(), ", ".join(f"{n} {why}" for why, n in self.refused.most_common())
            found.append(f"{self.path}: {n} of {n + len(self.loads)} loads do not count: {why}")
        if lag := lag_words([load.lag_s for load in self.loads]):
            found.append(f"{self.path}: {lag}")
        if self.test_stand is None:
            found.append(f"{self.path}: does not describe its bench; nobody can tell its units and axes")
        if self.n_lost:
            found.append(f"{self.path}: {self.n_lost} cycles were lost when it was recorded")
        if self.damage:
            found.append(f"{self.damage}; the {len(self.loads)} loads before that are used")
        return tuple(found)


def read_sessions(paths: Sequence[Path], foot: str) -> list[RecordedSession]:
    """Return the sessions in recordings of one foot.

    Args:
        paths: The recordings, at least one.
        foot: Which foot they have to be of.

    Raises:
        RecordingError: One is no recording.
        CalibrationError: One is of another foot or foot type, has no reference, or is there twice.
    """
    sessions: list[RecordedSession] = []
    for path in paths:
        session = read_session(path, foot)
        for other in sessions:
            if session.sha256 == other.sha256:
                raise CalibrationError(f"{path}: the same recording as {other.path}; name each one once")
            if path.name == other.path.name:
                raise CalibrationError(
                    f"{path}: has the name of {other.path}, by which the calibration lists it; rename one"
                )
            if session.foot_type != other.foot_type:
                raise CalibrationError(
                    f"{path}: of foot type {session.foot_type!r}, {other.path} is of {other.foot_type!r}; "
                    "a foot has one type"
                )
        sessions.append(session)
    return sessions


def read_session(path: Path, foot: str) -> RecordedSession:
    """Return the session in a recording; of one that was cut short, what is whole.

    Args:
        path: The recording.
        foot: Which foot it has to be of.

    Raises:
        RecordingError: It is no recording.
        CalibrationError: It is of another foot, or has no reference.
    """
    recording = Replay(path)
    leg_of = _mounted(recording.header)
    if foot not in leg_of:
        raise CalibrationError(
            f"{path}: a recording of {', '.join(leg_of) or 'feet without names'}, not of {foot}; "
            "`footsense record --foot` names the one on the bench"
        )
    row = recording.legs.index(leg_of[foot])
    cycles = _Cycles(recording, row)
    finder = LoadDetector(row)
    found = [finder.take(cycle) for cycle in cycles]
    loads = [load for load in (*found, finder.finish()) if load is not None]
    if not cycles.n_samples:
        raise CalibrationError(
            f"{path}: holds no sample of a reference sensor; record it with `footsense record --reference`"
        )
    return RecordedSession(
        path=path,
        sha256=file_sha256(path),
        name=recording.header.get("session") or path.stem,
        foot=foot,
        foot_type=recording.header.get("foot_type", ""),
        test_stand=_bench(recording.header),
        temperature_c=cycles.temperature_c,
        loads=tuple(load for load in loads if load.rejection is None),
        refused=Counter(load.rejection for load in loads if load.rejection is not None),
        n_lost=cycles.n_lost,
        damage=cycles.damage,
    )


def _mounted(header: dict[str, str]) -> dict[str, str]:
    """Return the leg of each foot that a recording names: the one on the test_stand, or those of a robot."""
    if "foot" in header and header.get("leg") in header["legs"].split(","):
        return {header["foot"]: header["leg"]}
    pairs = [entry.partition("=") for entry in header.get("feet", "").split(",") if entry]
    return {foot: leg for leg, _, foot in pairs if leg in header["legs"].split(",")}


def _bench(header: dict[str, str]) -> StandConfig | None:
    try:
        return msgspec.json.decode(header["reference"], type=StandConfig)
    except (KeyError, msgspec.DecodeError):
        return None


class _Cycles:
    """The cycles of a recording from its first sample of a reference up to its end or damage, counted.

    Args:
        recording: Which.
        row: Row of the leg whose temperature is of interest.
    """

    def __init__(self, recording: Replay, row: int) -> None:
        self._recording = recording
        self._row = row
        self._temperatures_c: list[float] = []
        self.n_samples = 0
        self.n_lost = 0
        self.damage = ""

    @property
    def temperature_c(self) -> float | None:
        """Mean of what the leg's converter told [degC]; None if that was nothing."""
        return fmean(self._temperatures_c) if self._temperatures_c else None

    def __iter__(self) -> Iterator[Cycle]:
        now_c = math.nan
        try:
            for entry in self._recording.entries():
                if isinstance(entry, Loss):
                    self.n_lost += entry.n_cycles
                    continue
                if entry.cycle.reference is not None:
                    self.n_samples += len(entry.cycle.reference.t_ns)
                if entry.cycle.temperature_c is not None:
                    now_c = float(entry.cycle.temperature_c[self._row])
                if self.n_samples:
                    if math.isfinite(now_c):
                        self._temperatures_c.append(now_c)
                    yield entry.cycle
        except RecordingError as error:
            self.damage = str(error)
