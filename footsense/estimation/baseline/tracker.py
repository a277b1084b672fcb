"""Per-leg baseline: tare, drift tracking, and contact detection.

A tare (`tare.py`) gives a baseline: at start without a command, later on command. Between tares the baseline follows
the drift of a foot in swing (`drift.py`); `contact.py` tells swing from stance.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.baseline.contact import Contact, ContactLimits, middle_mean
from footsense.estimation.baseline.drift import FARTHEST_PF, LegZero, ZeroLimits
from footsense.estimation.baseline.tare import TareLimits, TareWindow, Verdict
from footsense.estimation.faults.leg_status import SILENT
from footsense.estimation.sensitivity import Sensitivity
from footsense.foot.capacitor import CapacitorDesign
from footsense.frames import (
    BaselineDrift,
    BaselineStatus,
    Command,
    CommandKind,
    CommandResult,
    Flag,
    Reading,
    Result,
    State,
)

Vector = NDArray[np.float64]
Stamps = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: A leg that was silent for so long may come back with another foot: its baseline is forgotten. Nobody is faster.
_SILENT_NS = 250_000_000
#: The same while a line of its bus is held low, which says nothing of its own foot: a robot that stands would lose all
#: its forces until each foot's next swing.
_HELD_NS = 3_000_000_000

#: In how many frames every leg gets its turn to follow: two of six legs in one frame, and those of opposite tripods.
_TURNS = 3

#: How often it is reckoned how far the zeros may be off [ns]; in a tenth of a second they drift by a fifth of a fF.
_DOUBT_NS = 100_000_000

# Plain numbers: an enumeration's arithmetic costs a microsecond each time.
_CONTACT, _TARE_REFUSED = int(Flag.CONTACT), int(Flag.TARE_REFUSED)


class Footing:
    """The baselines of all legs, the tares that are being taken, and who is on the ground.

    Every leg is tared at start, again and again until that succeeds.

    Args:
        unloaded_pf: What each element of the free foot is expected to read [pF], shape (legs, 9).
        design: The capacitors.
        tare: When a tare is granted.
        contact: When a foot is on the ground.
        sensitivity: What closures are worth in newtons.
        track: Whether baselines follow the foot in the air.
        feet: Name of the foot on each leg whose fingerprint `unloaded_pf` is; empty where it is any foot's.

    Attributes:
        baseline_pf: Unloaded capacitance without stray [pF], shape (legs, 9), NaN where there is none; replaced, never
            changed.
        sigma_n: What the baseline leaves open of each leg's force, one sigma [N], shape (legs, 3), NaN without one.
        flags: CONTACT, and TARE_REFUSED where an older baseline is in use, shape (legs,).
        zero: What is published of the baselines.
    """

    def __init__(
        self,
        unloaded_pf: Vector,
        design: CapacitorDesign,
        tare: TareLimits,
        contact: ContactLimits,
        sensitivity: Sensitivity,
        *,
        track: bool,
        feet: Sequence[str] = (),
    ) -> None:
        n_legs = len(unloaded_pf)
        self._feet = feet or ("",) * n_legs
        self._legs = range(n_legs)
        self._unloaded_pf = unloaded_pf
        self._tare = tare
        self._sensitivity = sensitivity
        self._track = track
        follow = ZeroLimits(noise_limit_ff=tare.noise_limit_ff, unloaded_limit_rel=tare.unloaded_limit_rel)
        self._zeros = [LegZero(unloaded_pf[leg], follow) for leg in self._legs]
        self._contacts = [Contact(contact) for _ in self._legs]
        # Near the rest, which is where the error of a zero matters.
        self._closure_per_pf = float(design.plate_distance_um(unloaded_pf).mean()) / (
            design.gap_um * float(unloaded_pf.mean())
        )
        self._turn = 0
        self._windows = {leg: self._window(leg) for leg in self._legs}
        self._commanded: set[int] = set()
        self._refusal: dict[int, Result] = {}
        self._refused: set[int] = set()
        self._heard_ns = np.zeros(n_legs, np.int64)
        self._untared = set(self._legs)
        self.sigma_n = np.full((n_legs, 3), np.nan)
        self.flags = np.zeros(n_legs, np.uint8)
        self._flags: list[int] = []
        self._nothing_foreseen = [math.nan] * n_legs
        self._doubts_n: list[float] = []
        self._aloft: tuple[int, ...] = ()
        self._gather()

    def begin(self, leg: int) -> CommandResult | None:
        """Tare a leg because it was asked for; a tare that is being taken already serves.

        Returns:
            None: it will end in a later frame; or the refusal, if the foot is on the ground.
        """
        reason = self.refusal(CommandKind.TARE, leg)
        if reason is not None:
            self._refused.add(leg)
            return CommandResult(Command(CommandKind.TARE, leg), Result.LOADED, reason)
        self._windows.setdefault(leg, self._window(leg))
        self._commanded.add(leg)
        return None

    def refusal(self, kind: CommandKind, leg: int) -> str | None:
        """Return why a command may not be obeyed now, or None if it may."""
        return self._contacts[leg].refusal(kind)

    def tare(
        self, capacitance_pf: Vector, reading: NDArray[np.uint8], t_ns: Stamps, missing: Mask, now_ns: int
    ) -> tuple[CommandResult, ...]:
        """Let the tares that are being taken see a frame of all legs, and return those that ended with it.

        Args:
            capacitance_pf: Readings without stray [pF], shape (legs, 9), NaN where there is none to be used.
            reading: How each element answered, same shape.
            t_ns: Stamp of each [ns], same shape.
            missing: Elements that a tare has to do without, same shape.
            now_ns: The time now [ns].
        """
        self._forget_silent(reading, now_ns)
        if not self._windows:
            return ()
        outcomes = []
        for leg, window in list(self._windows.items()):
            verdict = window.add(capacitance_pf[leg], reading[leg], t_ns[leg], missing[leg])
            outcome = None if verdict is None else self._conclude(leg, verdict, int(t_ns[leg].max()))
            if outcome is not None:
                outcomes.append(outcome)
        return tuple(outcomes)

    def observe(
        self,
        closure_rel: Vector,
        foreseen_rel: Vector | None,
        capacitance_pf: Vector,
        t_ns: Stamps,
        missing: Mask,
        now_ns: int,
    ) -> None:
        """Judge who is on the ground, and follow those that are not and whose turn it is.

        Args:
            closure_rel: Closures over the gap as measured [1], shape (legs, 9), NaN where there is none.
            foreseen_rel: The same as predicted from the newest of them; None where nothing is predicted.
            capacitance_pf: Readings without stray that they come from [pF], same shape.
            t_ns: Stamp of each [ns], same shape.
            missing: Elements that are not to be believed, same shape.
            now_ns: The time now [ns].
        """
        if np.count_nonzero(missing):
            closure_rel = np.where(missing, np.nan, closure_rel)
            foreseen_rel = None if foreseen_rel is None else np.where(missing, np.nan, foreseen_rel)
        means_rel = middle_mean(closure_rel)
        foreseen_rels = self._nothing_foreseen if foreseen_rel is None else middle_mean(foreseen_rel)
        newest_ns = np.maximum.reduce(t_ns, axis=1).tolist()
        if now_ns >= self._doubt_due_ns:
            self._doubt(now_ns)
        aloft, flags = [], []
        n_per_rel = self._sensitivity.load_n
        loads = zip(means_rel, self._doubts_n, newest_ns, foreseen_rels, strict=True)
        for leg, (mean_rel, doubt_n, newest, ahead_rel) in enumerate(loads):
            zero, contact = self._zeros[leg], self._contacts[leg]
            contact.observe(mean_rel * n_per_rel, doubt_n, newest, now_ns, ahead_rel * n_per_rel)
            touching = contact.touching
            refused = _TARE_REFUSED if leg in self._refused else 0
            flags.append(_CONTACT | refused if touching else refused)
            if leg in self._untared:
                continue
            if touching or not (self._track and contact.aloft):
                zero.hold()
            elif not contact.explained:
                zero.hold(BaselineStatus.TOO_FAST)
            else:
                aloft.append(leg)
        self._aloft = tuple(aloft)
        self._follow(capacitance_pf, t_ns, missing)
        if flags != self._flags:
            self._flags, self.flags = flags, np.array(flags, np.uint8)

    def _follow(self, capacitance_pf: Vector, t_ns: Stamps, missing: Mask) -> None:
        """Let the zeros of those follow that are in the air and whose turn it is; arguments as of `observe`."""
        self._turn = (self._turn + 1) % _TURNS
        moved = False
        for leg in self._aloft:
            if leg % _TURNS == self._turn:
                zero = self._zeros[leg]
                # What is missing only because it has no zero gets one.
                disbelieved = missing[leg] & np.isfinite(zero.zero_pf)
                moved |= zero.follow(np.where(disbelieved, np.nan, capacitance_pf[leg]), t_ns[leg])
        if moved:
            self._gather()
        elif [zero.status for zero in self._zeros] != self._statuses:
            self._tell_statuses()

    def mark_untared(self, state: NDArray[np.uint8]) -> None:
        """Write TARING or NO_BASELINE over the state of every leg without a baseline."""
        for leg in self._untared:
            state[leg] = State.NO_BASELINE if leg in self._refusal else State.TARING

    def _doubt(self, now_ns: int) -> None:
        """Say how far the zeros may be off until it is said anew: they drift slowly, so now and then is enough.

        For times that are the same for all legs, whatever happens to one of them.
        """
        self._doubt_due_ns = (now_ns // _DOUBT_NS + 1) * _DOUBT_NS
        sigmas_pf = [zero.sigma_pf(self._doubt_due_ns) for zero in self._zeros]
        n_per_pf = self._closure_per_pf * self._sensitivity.load_n
        self._doubts_n = [n_per_pf * min(3.0 * sigma_pf, FARTHEST_PF) for sigma_pf in sigmas_pf]
        self.sigma_n = (np.array(sigmas_pf) * self._closure_per_pf)[:, None] * self._sensitivity.zero_n

    def _gather(self) -> None:
        """Put together what the legs' zeros are now."""
        self._doubt_due_ns = 0
        self.baseline_pf = np.array([zero.zero_pf for zero in self._zeros])
        offset_pf = np.array([zero.offset_pf for zero in self._zeros])
        self._moved = (
            *(offset_pf[:, 0].copy(), offset_pf[:, 1].copy()),
            np.array([zero.moved_ns for zero in self._zeros], np.int64),
        )
        self._tell_statuses()

    def _tell_statuses(self) -> None:
        """Tell what the legs' zeros do now; where they are has been gathered."""
        self._statuses = [zero.status for zero in self._zeros]
        self.zero = BaselineDrift(np.array(self._statuses, np.uint8), *self._moved)

    def _window(self, leg: int) -> TareWindow:
        return TareWindow(self._tare, self._unloaded_pf[leg], self._feet[leg])

    def _forget_silent(self, reading: NDArray[np.uint8], now_ns: int) -> None:
        if not np.count_nonzero(reading):
            self._heard_ns.fill(now_ns)
            return
        silent = np.isin(reading, SILENT).all(axis=1)
        self._heard_ns[~silent] = now_ns
        allowed_ns = np.where((reading == Reading.BUS_STUCK).any(axis=1), _HELD_NS, _SILENT_NS)
        for leg in np.flatnonzero(now_ns - self._heard_ns >= allowed_ns).tolist():
            if leg in self._untared:
                continue
            self._untared.add(leg)
            self._zeros[leg].forget()
            self._contacts[leg] = Contact(self._contacts[leg].limits)
            self._refusal.pop(leg, None)
            self._windows.setdefault(leg, self._window(leg))
            self._gather()

    def _conclude(self, leg: int, verdict: Verdict, t_ns: int) -> CommandResult | None:
        """Take or refuse a baseline; a tare that nobody asked for says the same refusal only once."""
        del self._windows[leg]
        commanded = leg in self._commanded
        self._commanded.discard(leg)
        repeated = self._refusal.get(leg) is verdict.result
        if verdict.zero_pf is not None:
            self._zeros[leg].take(verdict.zero_pf, t_ns)
            self._contacts[leg].begin_anew(t_ns)
            self._untared.discard(leg)
            self._refused.discard(leg)
            self._refusal.pop(leg, None)
            self._gather()
        elif leg in self._untared:
            self._windows[leg] = self._window(leg)
            if verdict.result is Result.ABSENT and not commanded:
                return None  # nothing was judged: the tare waits for the leg
            self._refusal[leg] = verdict.result
        else:
            self._refused.add(leg)
        if repeated and not commanded:
            return None
        return CommandResult(Command(CommandKind.TARE, leg), verdict.result, verdict.reason)
