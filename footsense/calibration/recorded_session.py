"""Read a test-stand recording as one session: the calibration loads of one foot."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import msgspec

from footsense.calibration.detection import LoadDetector
from footsense.calibration.loads import CalibrationLoad, LoadSet, RejectedPress, Rejection, Span
from footsense.calibration.writer import file_sha256
from footsense.config.test_stand import StandConfig
from footsense.errors import CalibrationError, RecordingError
from footsense.recording.replay import Replay
from footsense.ring.records import LostCycles, leg_entries


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSession:
    """Calibration loads of one foot from one recording: one mounting on the test stand.

    Attributes:
        path: The recording.
        sha256: Its hash.
        name: Name of the session, by default that of the file.
        foot: The foot, such as `foot-0007`.
        foot_type: Its type.
        test_stand: Description of the reference in the recording; None if this version cannot read it.
        temperature_c: Mean temperature of the foot [degC]; None if not measured.
        loads: The accepted loads, in their order.
        dwells_ns: Start and end of the dwell of each [ns].
        rejected: Number of rejected presses by reason.
        n_lost_cycles: Cycles that the recorder lost.
        damage: Why the recording ends early; empty if it is whole.
    """

    path: Path
    sha256: str
    name: str
    foot: str
    foot_type: str
    test_stand: StandConfig | None
    temperature_c: float | None
    loads: LoadSet
    dwells_ns: tuple[Span, ...]
    rejected: Counter[Rejection]
    n_lost_cycles: int
    damage: str

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about missing parts of the recording, one line of text each."""
        warnings = []
        if self.rejected:
            n, why = self.rejected.total(), ", ".join(f"{n} {why}" for why, n in self.rejected.most_common())
            warnings.append(f"{self.path}: {n} of {n + len(self.loads)} presses are rejected: {why}")
        if self.test_stand is None:
            warnings.append(
                f"{self.path}: does not describe its test stand; units and axes cannot be checked"
            )
        if self.n_lost_cycles:
            warnings.append(f"{self.path}: {self.n_lost_cycles} cycles were lost when it was recorded")
        if self.damage:
            warnings.append(f"{self.damage}; the {len(self.loads)} loads before that are used")
        return tuple(warnings)


def read_sessions(
    paths: Sequence[Path], foot: str, on_bytes_read: Callable[[int], None] | None = None
) -> list[RecordedSession]:
    """Read several recordings; return the sessions of one foot.

    Args:
        paths: The recordings, at least one.
        foot: The foot that they have to be of.
        on_bytes_read: Receives the number of bytes read so far, of all recordings; None for nobody.

    Raises:
        RecordingError: One is no recording.
        CalibrationError: One is of another foot or foot type, has no reference, or is given twice.
    """
    sessions: list[RecordedSession] = []
    n_before = 0

    def report(n_read: int) -> None:
        if on_bytes_read is not None:
            on_bytes_read(n_before + n_read)

    for path in paths:
        session = read_session(path, foot, report)
        n_before += path.stat().st_size
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


def read_session(
    path: Path, foot: str, on_bytes_read: Callable[[int], None] | None = None
) -> RecordedSession:
    """Read one recording as a session; of a truncated recording, its intact part.

    Args:
        path: The recording.
        foot: The foot that it has to be of.
        on_bytes_read: Receives the number of bytes read so far; None for nobody.

    Raises:
        RecordingError: It is no recording.
        CalibrationError: It is of another foot, or has no reference.
    """
    recording = Replay(path, on_bytes_read)
    header = recording.header
    leg_of = leg_of_foot(header)
    if foot not in leg_of:
        raise CalibrationError(
            f"{path}: a recording of {', '.join(leg_of) or 'feet without names'}, not of {foot}; "
            "`footsense test-stand record --foot` names the one on the test stand"
        )
    row = recording.legs.index(leg_of[foot])
    detector, presses = LoadDetector(row), list[CalibrationLoad | RejectedPress | None]()
    n_samples = n_lost_cycles = 0
    now_c, temperatures_c, damage = math.nan, list[float](), ""
    try:
        for entry in recording.entries():
            if isinstance(entry, LostCycles):
                n_lost_cycles += entry.n_cycles
                continue
            if entry.cycle.reference is not None:
                n_samples += len(entry.cycle.reference.t_ns)
            if entry.cycle.temperature_c is not None:
                now_c = float(entry.cycle.temperature_c[row])
            if n_samples:
                presses.append(detector.process_cycle(entry.cycle))
                if math.isfinite(now_c):
                    temperatures_c.append(now_c)
    except RecordingError as error:
        damage = str(error)
    if not n_samples:
        raise CalibrationError(
            f"{path}: holds no sample of a reference sensor; record it with `footsense test-stand record`"
        )
    presses.append(detector.finish())
    loads = [press for press in presses if isinstance(press, CalibrationLoad)]
    return RecordedSession(
        path=path,
        sha256=file_sha256(path),
        name=header.get("session") or path.stem,
        foot=foot,
        foot_type=header.get("foot_type", ""),
        test_stand=_test_stand(header),
        temperature_c=fmean(temperatures_c) if temperatures_c else None,
        loads=LoadSet.from_loads(loads),
        dwells_ns=tuple(load.dwell_ns for load in loads),
        rejected=Counter(press.rejection for press in presses if isinstance(press, RejectedPress)),
        n_lost_cycles=n_lost_cycles,
        damage=damage,
    )


def leg_of_foot(header: dict[str, str]) -> dict[str, str]:
    """Return the leg on which each foot of a recording was mounted."""
    legs = header["legs"].split(",")
    if "foot" in header and header.get("leg") in legs:
        return {header["foot"]: header["leg"]}
    return {foot: leg for leg, foot in leg_entries(header, "feet").items() if leg in legs}


def _test_stand(header: dict[str, str]) -> StandConfig | None:
    """Return the test stand's configuration from a recording's header; None if it has none."""
    try:
        return msgspec.json.decode(header["reference"], type=StandConfig)
    except (KeyError, msgspec.DecodeError):
        return None
