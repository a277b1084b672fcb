"""A force sensor that sends its samples by itself: what all such have in common, whatever they come through."""

import logging
from typing import NamedTuple

import numpy as np

from footsense.errors import SensorError
from footsense.frames import Reference
from footsense.reference.mounting import Mounting
from footsense.reference.record_decoder import Rows
from footsense.reference.sample_times import SampleTimes

__all__ = ["ReferenceStream", "SensorStatistics"]

#: A sensor that says nothing for this long is said to be silent, and one that never spoke is not there [ns].
_SILENT_NS = 500_000_000
_NEVER_NS = 3_000_000_000
#: So many bytes without a single record in them are no misfortune but another format.
_SENSELESS_BYTES = 4096

_log = logging.getLogger(__name__)


class SensorStatistics(NamedTuple):
    """How it went with a sensor so far.

    Attributes:
        n_samples: Samples that came.
        n_missing: Samples that did not, as far as times and numbers tell.
        n_bad: Lines, records or packets that were none.
        n_saturated: Samples with an axis at its end.
        n_jumps: How often its clock has jumped.
        n_opened: How often its line was opened.
        residual_ms: What times may be wrong by [ms].
    """

    n_samples: int
    n_missing: int
    n_bad: int
    n_saturated: int
    n_jumps: int
    n_opened: int
    residual_ms: float


class ReferenceStream:
    """Makes references of a sensor's records, and says what is wrong with them while it is.

    Args:
        name: What the sensor is, for messages.
        mounting: How it sits.
        times: When its samples were taken.
    """

    def __init__(self, name: str, mounting: Mounting, times: SampleTimes) -> None:
        self._name = name
        self._mounting = mounting
        self._times = times
        self._n_samples = 0
        self._n_saturated = 0
        self._n_bytes = 0
        self._heard_ns: int | None = None
        self._silent = False
        self._n_jumps_told = 0
        self._n_missing_before = 0

    def restart(self) -> None:
        """Begin anew: the line was opened again."""
        self._times.restart()

    def take(self, rows: Rows, n_bytes: int, now_ns: int, example: bytes) -> Reference:
        """Return what has arrived as a reference; what waited in the line before the first look is left out.

        Args:
            rows: The records.
            n_bytes: Bytes that they were found in, and others.
            now_ns: The time now [ns].
            example: The last that was no record, for the message.

        Raises:
            SensorError: There was never a record in it, or never anything.
        """
        t_ns = self._times.stamp(rows, now_ns)
        force_n, saturated = self._mounting.apply(rows.raw)
        saturated = saturated | rows.saturated
        # Nor has a clock that began with the run a time for what was taken before.
        fresh = np.full(len(t_ns), self._heard_ns is not None) & (t_ns >= 0)
        self._watch(int(np.count_nonzero(fresh)), n_bytes, now_ns, example)
        self._n_saturated += int(np.count_nonzero(saturated[fresh]))
        return Reference(t_ns[fresh], force_n[fresh], saturated[fresh])

    def figures(self, n_bad: int, n_opened: int) -> SensorStatistics:
        """Return how it went so far."""
        times = self._times
        counts = (self._n_samples, times.n_missing, n_bad, self._n_saturated, times.n_jumps, n_opened)
        return SensorStatistics(*counts, residual_ms=times.residual_ns * 1e-6)

    def _watch(self, n: int, n_bytes: int, now_ns: int, example: bytes) -> None:
        if self._heard_ns is None:
            self._heard_ns = now_ns
        self._n_samples += n
        self._n_bytes += n_bytes
        if self._n_samples == 0:
            self._require_sense(now_ns - self._heard_ns, example)
        elif n:
            if self._silent:
                missing = self._times.n_missing - self._n_missing_before
                _log.warning("%s: speaks again; %d samples are missing", self._name, missing)
            self._heard_ns, self._silent = now_ns, False
            self._n_missing_before = self._times.n_missing
        elif now_ns - self._heard_ns > _SILENT_NS and not self._silent:
            self._silent = True
            _log.warning(
                "%s: no sample for %g s; the recording goes on without", self._name, _SILENT_NS * 1e-9
            )
        if self._times.n_jumps > self._n_jumps_told:
            self._n_jumps_told = self._times.n_jumps
            _log.warning("%s: its clock has jumped; it is followed anew", self._name)

    def _require_sense(self, waited_ns: int, example: bytes) -> None:
        """Check that a sensor that has not spoken yet still may.

        Raises:
            SensorError: It sends what is no record, or nothing.
        """
        if self._n_bytes > _SENSELESS_BYTES or (self._n_bytes and waited_ns > _NEVER_NS):
            raise SensorError(
                f"{self._name}: no record in {self._n_bytes} bytes, such as {example!r}; "
                "baud, framing and columns have to be the sensor's"
            )
        if waited_ns > _NEVER_NS:
            raise SensorError(
                f"{self._name}: nothing arrives for {_NEVER_NS * 1e-9:g} s; is it switched on, does it have to be "
                "asked (`start`), is the baud rate its own?"
            )
