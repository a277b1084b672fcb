"""What candump in the machine prints, as a consumer of the forces reads it.

Times are the machine's own, as candump stamps the frames.
"""

import math
import re
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from firmware_interface.can.codes import NODE_IDS, Cause, State
from firmware_interface.can.crc8 import kind_and_node
from firmware_interface.can.force import FORCE, FORCE_ID, Force
from firmware_interface.can.reports import FAULT, FAULT_ID
from footsense.frames import LEGS as HEXAPOD
from tests.kernel.ports import GuestError, LinePort

_DATA_FRAME = re.compile(rb"[0-9A-F]{3}#([0-9A-F]{2})*")

#: The robot's legs by their nodes.
LEGS = {NODE_IDS[leg]: leg for leg in HEXAPOD}

#: Longest wait for anything on CAN: of the machine's time, and of the host's, which may be busy [s].
BOUND_S, _HOST_BOUND_S = 30.0, 900.0


class Frame(NamedTuple):
    """A frame on can0.

    Attributes:
        t_s: Its time stamp by the machine [s].
        can_id: Its id.
        data: Its bytes.
    """

    t_s: float
    can_id: int
    data: bytes

    @property
    def leg(self) -> str:
        """Leg that it is about; empty for none."""
        return LEGS.get(kind_and_node(self.can_id)[1], "")

    @property
    def force(self) -> Force | None:
        """Its content as a force; None for another frame."""
        return FORCE.decode(self.can_id, self.data) if self.can_id - FORCE_ID in LEGS else None


class CanStream:
    """All frames on can0 since the machine was started. A mark is the number of frames until a moment.

    Args:
        path: Socket of the port `can`.
        clock: Returns the machine's time [s].
    """

    def __init__(self, path: Path, clock: Callable[[], float]) -> None:
        self._frames: list[Frame] = []
        self._clock = clock
        self.port = LinePort(path, self._take)

    def _take(self, line: bytes) -> None:
        words = line.split()
        if len(words) != 3 or words[1] != b"can0" or not _DATA_FRAME.fullmatch(words[2]):
            return  # another interface, an error frame of the kernel, or the rest of a line from before a restart
        can_id, _, data = words[2].partition(b"#")
        self._frames.append(Frame(float(words[0][1:-1]), int(can_id, 16), bytes.fromhex(data.decode())))

    @property
    def mark(self) -> int:
        """The present moment."""
        return len(self._frames)

    def since(self, mark: int) -> list[Frame]:
        """Return the frames since a mark."""
        return self._frames[mark:]

    def forces(self, mark: int) -> dict[str, Force]:
        """Return the last force of each leg since a mark."""
        return {frame.leg: force for frame in self.since(mark) if (force := frame.force)}

    def force_n(self, leg: str, mark: int) -> tuple[float, float, float]:
        """Return the last force of a leg since a mark [N]; NaN for none."""
        last = self.forces(mark).get(leg)
        return last.force_n if last else (math.nan, math.nan, math.nan)

    def states(self, mark: int) -> dict[str, State]:
        """Return the last state of each leg that sent a force since a mark."""
        return {leg: force.state for leg, force in self.forces(mark).items()}

    def all_states(self, mark: int, legs: Collection[str] = HEXAPOD) -> set[State]:
        """Return every state that any of some legs has had since a mark."""
        return {force.state for frame in self.since(mark) if frame.leg in legs and (force := frame.force)}

    def causes(self, mark: int) -> dict[str, set[Cause]]:
        """Return all causes that fault reports have named for each leg since a mark."""
        found: dict[str, set[Cause]] = {}
        for frame in self.since(mark):
            if frame.can_id - FAULT_ID in LEGS:
                cause = FAULT.decode(frame.can_id, frame.data).cause
                if cause is not Cause.NONE:  # a report comes once a second, whether there is a cause or not
                    found.setdefault(frame.leg, set()).add(cause)
        return found

    def wait(self, what: str, condition: Callable[[], bool], bound_s: float = BOUND_S) -> None:
        """Return as soon as a condition is true.

        Args:
            what: The condition in words.
            condition: The condition.
            bound_s: Longest wait, of the machine's time [s].

        Raises:
            GuestError: It is not true within the bound.
        """
        mark, start_s, host_start_s = self.mark, self._clock(), time.monotonic()
        while not condition():
            if self._clock() - start_s > bound_s or time.monotonic() - host_start_s > _HOST_BOUND_S:
                raise GuestError(f"not within {bound_s:.0f} s: {what}; CAN: {self.shown(mark)}")
            time.sleep(0.2)

    def wait_for(self, state: State, legs: Iterable[str] = HEXAPOD, bound_s: float = BOUND_S) -> float:
        """Wait until legs have a state at once, in forces from now on.

        Returns:
            Time stamp of the frame that completed it [s].

        Raises:
            GuestError: They did not have it within the bound.
        """
        wanted, mark = dict.fromkeys(legs, state), self.mark
        what = f"{' '.join(wanted)} {state.name.lower()}"
        self.wait(what, lambda: self._first_time_s(wanted, mark) is not None, bound_s)
        first_s = self._first_time_s(wanted, mark)
        assert first_s is not None
        return first_s

    def _first_time_s(self, wanted: Mapping[str, State], mark: int) -> float | None:
        """Return when legs had their wanted states at once for the first time since a mark [s]; None for never."""
        states: dict[str, State] = {}
        for frame in self.since(mark):
            if force := frame.force:
                states[frame.leg] = force.state
                if wanted.items() <= states.items():
                    return frame.t_s
        return None

    def silence_s(self, mark: int) -> float:
        """Return the longest time between two frames with forces since a mark [s]."""
        times = [frame.t_s for frame in self._frames[max(mark - 50, 0) :] if frame.force]
        return max((later - earlier for earlier, later in pairwise(times)), default=0.0)

    def shown(self, mark: int) -> str:
        """Return in words what a consumer has seen since a mark: the states of the legs in turn, and a silence."""
        turns: dict[str, list[str]] = {}
        for frame in self.since(mark):
            if force := frame.force:
                states = turns.setdefault(frame.leg, [])
                if not states or states[-1] != force.state.name.lower():
                    states.append(force.state.name.lower())
        legs_of: dict[str, list[str]] = {}
        for leg, states in turns.items():
            legs_of.setdefault(", ".join(states), []).append(leg)
        parts = [
            f"{'all' if len(legs) == len(LEGS) else ' '.join(legs)} {states}"
            for states, legs in sorted(legs_of.items(), key=lambda item: len(item[1]))
        ]
        silence_s = self.silence_s(mark)
        if silence_s > 0.2:
            parts.append(f"no force for {silence_s:.1f} s")
        return "; ".join(parts) or "nothing"
