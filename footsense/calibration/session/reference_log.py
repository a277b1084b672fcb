"""The last samples of a bench's force sensor, as far back as somebody may still ask for them."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from footsense.frames import Reference

__all__ = ["ReferenceLog"]


class ReferenceLog:
    """Keeps samples in the pieces in which they came."""

    def __init__(self) -> None:
        self._pieces: deque[Reference] = deque()

    def add(self, reference: Reference | None) -> None:
        """Keep what was said in a cycle."""
        if reference is not None and len(reference.t_ns):
            self._pieces.append(reference)

    def forget_until(self, t_ns: int) -> None:
        """Drop the pieces that end before a time [ns]."""
        while self._pieces and int(self._pieces[0].t_ns[-1]) < t_ns:
            self._pieces.popleft()

    def sum_within(self, span_ns: tuple[int, int]) -> tuple[NDArray[np.float64], int]:
        """Return the sum of the forces in a time [N], shape (3,), and how many these are; none at an axis' end is."""
        total_n, n = np.zeros(3), 0
        for piece in self._pieces:
            if int(piece.t_ns[-1]) >= span_ns[0] and int(piece.t_ns[0]) <= span_ns[1]:
                inside = (piece.t_ns >= span_ns[0]) & (piece.t_ns <= span_ns[1]) & ~piece.saturated
                total_n += piece.force_n[inside].sum(axis=0)
                n += int(inside.sum())
        return total_n, n

    def all(self) -> Reference:
        """Return all in the order of their times: a clock's map that was put right may have turned two round."""
        t_ns = np.concatenate([np.zeros(0, np.int64), *(piece.t_ns for piece in self._pieces)])
        force_n = np.concatenate([np.zeros((0, 3)), *(piece.force_n for piece in self._pieces)])
        saturated = np.concatenate([np.zeros(0, np.bool_), *(piece.saturated for piece in self._pieces)])
        order = np.argsort(t_ns, kind="stable")
        return Reference(t_ns[order], force_n[order], saturated[order])
