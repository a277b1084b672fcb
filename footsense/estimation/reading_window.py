"""Window of each element's last three readings, the input of the network."""

from typing import NamedTuple

import numpy as np

from footsense.frames import ELEMENTS, Mask, Stamps, Vector

#: Readings of an element in a window.
READINGS = 3
#: Longest time between two readings of an element, over the time of a scan [1]: after a stall, older readings are not
#: mixed with newer ones.
MAX_READING_INTERVAL_SCANS = 1.75

#: Smallest spike that is taken for a wrong reading [1], and change over it of the readings beside it [1].
_SPIKE_THRESHOLD_REL, _NEIGHBOUR_TOLERANCE_REL = 0.1, 0.25


class Readings(NamedTuple):
    """Last three readings of every element of all legs, newest first.

    Attributes:
        plate_distance_rel: Plate distances over the gap [1], shape (legs, 3, 9), NaN where there is none.
        t_ns: Middle of each conversion [ns], same shape; 0 where there is none.
        is_consecutive: Elements whose newest two readings follow on one another, shape (legs, elements).
        newest_ns: Time of each leg's newest reading [ns], shape (legs,); 0 without one.
        oldest_of_newest_ns: Time of the oldest of the newest readings of each leg's whole elements [ns], shape (legs,).
        second_largest_motion_rel: Second largest change of an element from one reading to the next [1], shape (legs,).
    """

    plate_distance_rel: Vector
    t_ns: Stamps
    is_consecutive: Mask
    newest_ns: Stamps
    oldest_of_newest_ns: Stamps
    second_largest_motion_rel: Vector


class ReadingWindow:
    """Buffer of the last three readings of every element.

    Args:
        n_legs: Legs of a frame.
        scan_ns: Time of a scan [ns].
    """

    def __init__(self, n_legs: int, scan_ns: int) -> None:
        self._distance_rel = np.full((n_legs, READINGS, ELEMENTS), np.nan)
        self._t_ns = np.zeros((n_legs, READINGS, ELEMENTS), np.int64)
        self._longest_ns = np.array(round(MAX_READING_INTERVAL_SCANS * scan_ns))

    def add(self, plate_distance_rel: Vector, t_ns: Stamps) -> Readings:
        """Add the new readings of a frame; return the last three readings of every element.

        If only the newest two readings of an element follow on one another, the second stands for the third as well:
        over random gaits no error exceeds 7 sigma then, and a third on a line with the two gives up to 370 sigma.

        Args:
            plate_distance_rel: Plate distances over the gap [1], shape (legs, elements), NaN where there is none.
            t_ns: Middle of each element's conversion [ns], same shape.
        """
        kept_rel, kept_ns = self._distance_rel, self._t_ns
        new = t_ns != kept_ns[:, 0]
        for kept, now in ((kept_rel, plate_distance_rel), (kept_ns, t_ns)):
            np.copyto(kept[:, 2], kept[:, 1], where=new)
            np.copyto(kept[:, 1], kept[:, 0], where=new)
            np.copyto(kept[:, 0], now)
        steps_ns = kept_ns[:, :2] - kept_ns[:, 1:]
        steps_rel = kept_rel[:, :2] - kept_rel[:, 1:]
        # A NaN makes the difference one.
        in_order = (steps_ns > 0) & (steps_ns <= self._longest_ns) & np.isfinite(steps_rel)
        all_in_order = np.count_nonzero(in_order) == in_order.size
        moved_rel = np.abs(steps_rel)
        if not all_in_order:
            moved_rel[~in_order] = 0.0
        moved_rel = moved_rel.max(axis=1)
        moved_rel.partition(ELEMENTS - 2, axis=1)
        # One element that moved far alone: a load moves several.
        if (moved_rel[:, -1] > _SPIKE_THRESHOLD_REL + 3.0 * moved_rel[:, -2]).any():
            _replace_spikes(kept_rel)
        of_whole_ns = kept_ns[:, 0]
        newest_ns = of_whole_ns.max(axis=1)
        if not all_in_order:
            kept_rel, kept_ns, alone = kept_rel.copy(), kept_ns.copy(), ~in_order[:, 1]
            np.copyto(kept_rel[:, 2], kept_rel[:, 1], where=alone)
            np.copyto(kept_ns[:, 2], kept_ns[:, 1] - steps_ns[:, 0], where=alone)
            of_whole_ns = np.where(in_order[:, 0], kept_ns[:, 0], newest_ns[:, None])
        return Readings(
            kept_rel,
            kept_ns,
            in_order[:, 0],
            newest_ns,
            of_whole_ns.min(axis=1),
            moved_rel[:, ELEMENTS - 2],
        )

    def discard_newest(self, elements: Mask) -> None:
        """Discard the newest reading of each element in a mask, shape (legs, elements)."""
        self._distance_rel[:, 0][elements] = np.nan


def _replace_spikes(plate_distance_rel: Vector) -> None:
    """Replace, in place, a middle reading that is far from its two agreeing neighbours by their mean.

    Args:
        plate_distance_rel: The readings of each element, newest first [1], shape (legs, 3, 9).
    """
    newest, middle, oldest = plate_distance_rel.transpose(1, 0, 2)
    mean_rel = (newest + oldest) / 2.0
    spike_rel = np.abs(middle - mean_rel)
    wrong = (spike_rel > _SPIKE_THRESHOLD_REL) & (
        np.abs(newest - oldest) < _NEIGHBOUR_TOLERANCE_REL * spike_rel
    )
    np.copyto(middle, mean_rel, where=wrong)
