"""The last three readings of every element, with their times: what the network sees of a foot."""

from typing import NamedTuple

import numpy as np

from footsense.frames import ELEMENTS, Mask, Stamps, Vector

#: Readings of an element in a window.
READINGS = 3
#: Longest time between two readings of an element, over the time of a scan [1]: after a stall, older readings are not
#: mixed with newer ones.
LONGEST_REL = 1.75


class Readings(NamedTuple):
    """The readings of all legs, newest first.

    Attributes:
        distance_rel: Plate distances over the gap [1], shape (legs, 3, 9), NaN where there is none.
        t_ns: Middle of each conversion [ns], same shape; 0 where there is none.
        whole: Elements whose three readings follow on one another, shape (legs, 9).
        newest_ns: Time of each leg's newest reading [ns], shape (legs,).
        oldest_ns: Time of the oldest of each leg's newest readings [ns], shape (legs,); 0 without one.
        motion_rel: Second largest change of an element over its last two readings [1], shape (legs,).
    """

    distance_rel: Vector
    t_ns: Stamps
    whole: Mask
    newest_ns: Stamps
    oldest_ns: Stamps
    motion_rel: Vector


class ReadingWindow:
    """Keeps the last three readings of every element.

    Args:
        n_legs: Legs of a frame.
        scan_ns: Time of a scan [ns].
    """

    def __init__(self, n_legs: int, scan_ns: int) -> None:
        self._distance_rel = np.full((n_legs, READINGS, ELEMENTS), np.nan)
        self._t_ns = np.zeros((n_legs, READINGS, ELEMENTS), np.int64)
        self._longest_ns = np.array(round(LONGEST_REL * scan_ns))

    def add(self, distance_rel: Vector, t_ns: Stamps) -> Readings:
        """Add the readings of a frame that are new, and return all of them.

        Args:
            distance_rel: Plate distances over the gap [1], shape (legs, 9), NaN where there is none.
            t_ns: Middle of each element's conversion [ns], same shape.
        """
        kept_rel, kept_ns = self._distance_rel, self._t_ns
        new = t_ns != kept_ns[:, 0]
        for kept, now in ((kept_rel, distance_rel), (kept_ns, t_ns)):
            np.copyto(kept[:, 2], kept[:, 1], where=new)
            np.copyto(kept[:, 1], kept[:, 0], where=new)
            np.copyto(kept[:, 0], now)
        between_ns = kept_ns[:, :2] - kept_ns[:, 1:]
        steps_rel = kept_rel[:, :2] - kept_rel[:, 1:]
        # A NaN makes the sum one.
        in_order = (between_ns > 0) & (between_ns <= self._longest_ns) & np.isfinite(steps_rel)
        whole: Mask = in_order[:, 0] & in_order[:, 1]
        moved_rel = np.abs(steps_rel).max(axis=1)
        moved_rel[~whole] = 0.0
        moved_rel.partition(ELEMENTS - 2, axis=1)
        return Readings(
            kept_rel,
            kept_ns,
            whole,
            kept_ns[:, 0].max(axis=1),
            kept_ns[:, 0].min(axis=1),
            moved_rel[:, ELEMENTS - 2],
        )
