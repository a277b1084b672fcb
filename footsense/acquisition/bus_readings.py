"""The latest readings of one bus, which its scanner writes over element by element."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Reading

_NAN = float("nan")

#: A row, or all; an element, or all.
_Where = tuple[int | slice, int | slice]


class BusScan(NamedTuple):
    """The latest readings of one bus; arrays as in `CapFrame`, rows in the order of the bus's legs."""

    t_ns: NDArray[np.int64]
    capacitance_pf: NDArray[np.float64]
    reading: NDArray[np.uint8]

    @classmethod
    def unread(cls, n_legs: int) -> "BusScan":
        """Return that of legs of which nothing was heard yet."""
        shape = (n_legs, ELEMENTS)
        return cls(
            np.zeros(shape, np.int64), np.full(shape, _NAN), np.full(shape, Reading.NO_ANSWER, np.uint8)
        )

    def void(self, where: _Where, reading: Reading) -> None:
        """Take readings back, for a reason."""
        self.t_ns[where], self.capacitance_pf[where], self.reading[where] = 0, _NAN, reading

    def copied(self) -> "BusScan":
        """Return a copy, which whoever receives it may keep."""
        return BusScan(self.t_ns.copy(), self.capacitance_pf.copy(), self.reading.copy())
