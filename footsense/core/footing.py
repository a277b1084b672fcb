"""How every foot stands: where its baseline comes from, whether that may follow, and whether it is on the ground.

A tare (`core/tare.py`) gives a baseline, at start by itself and later on command. Between tares it follows the foot
that is surely in the air (`core/zero.py`), and which foot that is `core/contact.py` says.
"""

import numpy as np
from numpy.typing import NDArray

from footsense.core.contact import ContactLimits, Contacts, middle_mean
from footsense.core.design import CapacitorDesign
from footsense.core.sensitivity import Sensitivity
from footsense.core.tare import TareLimits, TareWindow, Verdict
from footsense.core.zero import FARTHEST_PF, ZeroLimits, ZeroTracking
from footsense.frames import Command, CommandKind, Flag, Outcome, Reading, Result, State, Zero

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A leg that was silent for so long may come back with another foot: its baseline is forgotten. Nobody is faster.
_SILENT_NS = 250_000_000


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

    Attributes:
        baseline_pf: Unloaded capacitance without stray [pF], shape (legs, 9), NaN where there is none yet.
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
    ) -> None:
        n_legs = len(unloaded_pf)
        self._unloaded_pf = unloaded_pf
        self._design = design
        self._tare = tare
        self._sensitivity = sensitivity
        self._contacts = Contacts(n_legs, contact)
        self._zeros = ZeroTracking(
            unloaded_pf,
            ZeroLimits(
                track=track, noise_limit_ff=tare.noise_limit_ff, unloaded_limit_rel=tare.unloaded_limit_rel
            ),
        )
        # Near the rest, which is where the error of a zero matters.
        self._closure_per_pf = float(design.plate_distance_um(unloaded_pf).mean()) / (
            design.gap_um * float(unloaded_pf.mean())
        )
        self._windows = {leg: self._window(leg) for leg in range(n_legs)}
        self._commanded: set[int] = set()
        self._refusal: dict[int, Result] = {}
        self._refused_flag = np.zeros(n_legs, np.uint8)
        self._untared = np.ones(n_legs, bool)
        self._heard_ns = np.zeros(n_legs, np.int64)

    @property
    def baseline_pf(self) -> Vector:
        """See the class."""
        return self._zeros.zero_pf

    @property
    def flags(self) -> NDArray[np.uint8]:
        """See the class."""
        return self._refused_flag | self._contacts.touching * np.uint8(Flag.CONTACT)

    @property
    def zero(self) -> Zero:
        """See the class."""
        return self._zeros.summary

    @property
    def sigma_n(self) -> Vector:
        """What the baseline leaves open of each leg's force, one sigma [N], shape (legs, 3), NaN without one."""
        return (self._zeros.sigma_pf * self._closure_per_pf)[:, None] * self._sensitivity.zero_n

    @property
    def moved_pf(self) -> Vector:
        """How far each element's baseline has moved since its tare [pF], shape (legs, 9)."""
        return self._zeros.moved_pf

    @property
    def without(self) -> Mask:
        """Elements that were missing when their leg was tared, and have not been seen in the air since, (legs, 9)."""
        without: Mask = np.isnan(self._zeros.zero_pf) & ~self._untared[:, None]
        return without

    def begin(self, leg: int) -> Outcome | None:
        """Tare a leg because it was asked for; a tare that is being taken already serves.

        Returns:
            None: it will end in a later frame; or the refusal, if the foot is on the ground.
        """
        reason = self.refusal(CommandKind.TARE, leg)
        if reason is not None:
            if not self._untared[leg]:
                self._refused_flag = self._refused_flag.copy()
                self._refused_flag[leg] = Flag.TARE_REFUSED
            return Outcome(Command(CommandKind.TARE, leg), Result.LOADED, reason)
        self._windows.setdefault(leg, self._window(leg))
        self._commanded.add(leg)
        return None

    def refusal(self, kind: CommandKind, leg: int) -> str | None:
        """Return why a command may not be obeyed now, or None if it may."""
        return self._contacts.refusal(kind, leg)

    def observe(
        self,
        capacitance_pf: Vector,
        reading: NDArray[np.uint8],
        t_ns: NDArray[np.int64],
        missing: Mask,
        now_ns: int,
    ) -> tuple[Outcome, ...]:
        """Take a frame of all legs and return the tares that ended with it.

        Args:
            capacitance_pf: Readings without stray [pF], shape (legs, 9), NaN where there is none to be used.
            reading: How each element answered, same shape.
            t_ns: Stamp of each [ns], same shape.
            missing: Elements that the leg has to do without, same shape.
            now_ns: The time now [ns].
        """
        self._forget_silent(reading, now_ns)
        outcomes = self._tares(capacitance_pf, reading, t_ns, missing) if self._windows else ()
        used_pf = np.where(missing, np.nan, capacitance_pf)
        closure_um = self._design.closure_um(used_pf, self._zeros.zero_pf)
        load_n = middle_mean(closure_um) * (self._sensitivity.load_n / self._design.gap_um)
        doubt_pf = np.fmin(3.0 * self._zeros.sigma_pf, FARTHEST_PF)
        contacts = self._contacts
        contacts.observe(
            load_n,
            doubt_pf * (self._closure_per_pf * self._sensitivity.load_n),
            t_ns.max(axis=1),
            now_ns,
        )
        self._zeros.observe(used_pf, t_ns, contacts.confirmed(), contacts.explained())
        return outcomes

    def mark_untared(self, state: NDArray[np.uint8]) -> None:
        """Write TARING or NO_BASELINE over the state of every leg without a baseline."""
        for leg in np.flatnonzero(self._untared).tolist():
            state[leg] = State.NO_BASELINE if leg in self._refusal else State.TARING

    def _window(self, leg: int) -> TareWindow:
        return TareWindow(self._tare, self._unloaded_pf[leg])

    def _forget_silent(self, reading: NDArray[np.uint8], now_ns: int) -> None:
        if not reading.any():
            self._heard_ns[:] = now_ns
            return
        silent = (reading == Reading.NO_ANSWER).all(axis=1)
        self._heard_ns[~silent] = now_ns
        gone = ~self._untared & (now_ns - self._heard_ns >= _SILENT_NS)
        for leg in np.flatnonzero(gone).tolist():
            self._zeros.forget(leg)
            self._contacts.begin_anew(leg, now_ns)
            self._untared[leg] = True
            self._refusal.pop(leg, None)
            self._windows.setdefault(leg, self._window(leg))

    def _tares(
        self, capacitance_pf: Vector, reading: NDArray[np.uint8], t_ns: NDArray[np.int64], missing: Mask
    ) -> tuple[Outcome, ...]:
        outcomes = []
        for leg, window in list(self._windows.items()):
            verdict = window.add(capacitance_pf[leg], reading[leg], t_ns[leg], missing[leg])
            outcome = None if verdict is None else self._conclude(leg, verdict, int(t_ns[leg].max()))
            if outcome is not None:
                outcomes.append(outcome)
        return tuple(outcomes)

    def _conclude(self, leg: int, verdict: Verdict, t_ns: int) -> Outcome | None:
        """Take or refuse a baseline; a tare that nobody asked for says the same refusal only once."""
        del self._windows[leg]
        commanded = leg in self._commanded
        self._commanded.discard(leg)
        repeated = self._refusal.get(leg) is verdict.result
        refused_flag = self._refused_flag.copy()
        if verdict.zero_pf is not None:
            self._zeros.take(leg, verdict.zero_pf, t_ns)
            self._contacts.begin_anew(leg, t_ns)
            self._untared[leg] = False
            refused_flag[leg] = 0
            self._refusal.pop(leg, None)
        elif self._untared[leg]:
            self._windows[leg] = self._window(leg)
            if verdict.result is Result.ABSENT and not commanded:
                return None  # nothing was judged: the tare waits for the leg
            self._refusal[leg] = verdict.result
        else:
            refused_flag[leg] = Flag.TARE_REFUSED
        self._refused_flag = refused_flag
        if repeated and not commanded:
            return None
        return Outcome(Command(CommandKind.TARE, leg), verdict.result, verdict.reason)
