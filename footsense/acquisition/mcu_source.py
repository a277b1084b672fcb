"""Frame source of board `mcu`: capacitance frames from the records that a microcontroller streams.

The controller sets the pace, and may say when it begins to send; else a record counts as sent at once after its last
conversion. A frame is complete, and returned at once, when every leg that sends has sent its record.
A leg whose record is missing in a frame reads DELAYED; after a silence longer than any line holds records back, it
reads NO_ANSWER. Without any record, frames without a reading are returned.
"""

import logging
from collections import Counter, deque
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.conversion_order import CONVERSION_ORDERS
from firmware_interface.serial_decoder import SerialDecoder
from firmware_interface.serial_frames import (
    IDENTIFY,
    N_NO_VALUE_CODES,
    NO_VALUE_BASE,
    RECORD_BITS,
    SENDING_BITS,
    VERSION,
    NoValue,
    Record,
    RecordFlag,
    Sending,
    began_at,
    pack_values,
)
from footsense.clock_map import ClockMap
from footsense.frames import ALL_LEGS, ELEMENTS, LEGS, CapFrame, Codes, Leg, Reading, Stamps, Vector
from footsense.leg_words import words_of_reading
from footsense.ports import Clock, SerialPort

_NS_PER_US = 1000
_PF_PER_AF = 1e-6
_NO_VALUE_ENDS = NO_VALUE_BASE + N_NO_VALUE_CODES
_READING_OF_CODE = np.full(N_NO_VALUE_CODES, Reading.CORRUPT, np.uint8)
_READING_OF_CODE[list(NoValue)] = list(NoValue)

#: Position of each element in the scan, by the flags of a record, shape (256, 9).
_SCAN_POSITION_OF_ELEMENT = np.array(
    [
        (np.argsort(CONVERSION_ORDERS["lo_shu" if flags & RecordFlag.LO_SHU else "raster"]) - began_at(flags))
        % ELEMENTS
        for flags in range(256)
    ]
)
_OUT_OF_RANGE = Reading.OVER_RANGE, Reading.UNDER_RANGE
_NS_PER_S = 1_000_000_000

#: Silence after which a leg counts as absent: three scans, and longer than an FTDI adapter holds bytes back.
_SILENT_SCANS, _MIN_SILENT_NS = 3, 25_000_000
#: Time in which the buffers between port and reader are emptied after the start.
_BUFFER_DRAIN_TIME_NS = 50_000_000
#: A record whose conversions last for more scans than this is corrupt: the next scan would have begun.
_MAX_RECORD_DURATION_SCANS = 1.5
#: Shortest time between two log lines about losses, and between two looks for them.
_LOG_NS, _LOOK_NS = 10 * _NS_PER_S, _NS_PER_S

_CORRUPT_VALUES = pack_values([NO_VALUE_BASE + Reading.CORRUPT] * ELEMENTS)

_log = logging.getLogger(__name__)


class Serial(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Section `serial` of a configuration: serial port of the microcontroller of board `mcu`, which scans the feet.

    Attributes:
        device: Port under /dev/serial/by-id, a name that survives unplugging; or `sim`.
        baud: Bits per second of a UART or adapter; without effect if the microcontroller is a USB device itself.
        rate_hz: Scans per second of the microcontroller, to detect missing ones; does not set its rate.
        legs: Legs that it scans.
    """

    device: Annotated[
        str,
        Meta(pattern=r"^(/dev/[^\s]+|sim)$", description="such as /dev/serial/by-id/usb-..., or sim"),
    ]
    baud: Annotated[int, Meta(ge=9600, le=12_000_000)] = 921_600
    rate_hz: Annotated[float, Meta(ge=1.0, le=1000.0)] = 200.0
    legs: Annotated[tuple[Leg, ...], Meta(min_length=1, max_length=len(ALL_LEGS))] = LEGS  # type: ignore[assignment]


class McuScan(NamedTuple):
    """Records of one scan of the microcontroller that have arrived so far.

    Attributes:
        t_us: Its time in the controller's clock [us], not unwrapped.
        t_ns: The same in this machine's clock [ns].
        records: Record of each leg by its row.
    """

    t_us: int
    t_ns: int
    records: dict[int, Record]


def wrapped_difference_us(t_us: int, other_us: int) -> int:
    """Return t_us - other_us of a wrapping 32-bit counter [us], -2^31 to 2^31 - 1."""
    return (t_us - other_us + (1 << 31)) % (1 << 32) - (1 << 31)


def readings(scan: McuScan, now_ns: int) -> tuple[Stamps, Vector, Codes]:
    """Return times [ns], capacitances [pF] and readings of a scan's records, shape (records, 9) each.

    A record whose last conversion would be in the future is corrupt: its times are wrong.
    """
    records = scan.records.values()
    values_af = np.frombuffer(b"".join(record.values for record in records), "<i4").reshape(-1, ELEMENTS)
    after_us, step_us, flags = np.array(
        [(wrapped_difference_us(record.t_us, scan.t_us), record.step_us, record.flags) for record in records]
    ).T
    ahead = scan.t_ns + _NS_PER_US * (ELEMENTS - 1) * step_us > now_ns
    t_ns = scan.t_ns + _NS_PER_US * (after_us[:, None] + step_us[:, None] * _SCAN_POSITION_OF_ELEMENT[flags])
    capacitance_pf = values_af * _PF_PER_AF
    reading = np.zeros(values_af.shape, np.uint8)
    without = values_af < _NO_VALUE_ENDS
    if without.any() or ahead.any():
        reading[without] = _READING_OF_CODE[values_af[without] - NO_VALUE_BASE]
        reading[ahead] = Reading.CORRUPT
        without |= ahead[:, None]
        capacitance_pf[without] = np.nan
        t_ns[without & ~np.isin(reading, _OUT_OF_RANGE)] = 0
    return t_ns, capacitance_pf, reading


class McuSource:
    """Frame source of a robot whose feet a microcontroller scans and streams over a serial port.

    Args:
        port: The line.
        clock: This machine's clock, of arrivals and of stamps.
        serial: Rate of its scans and of its line, and its legs, in the order of a frame's rows.

    Attributes:
        n_late_discards: Frames that were returned without the record of a leg that had sent before.
        n_unused: Records that fit into no frame: of legs that the robot does not have, of a scan that was returned
            already, or between two scans, which happens if the controller scans at twice the rate or more.
    """

    def __init__(self, port: SerialPort, clock: Clock, serial: Serial) -> None:
        rate_hz = serial.rate_hz
        self.n_late_discards = 0
        self.n_unused = 0
        self._port = port
        self._clock = clock
        self._rows = {NODE_IDS[leg]: row for row, leg in enumerate(serial.legs)}
        self._half_scan_us = round(0.5e6 / rate_hz)
        self._same_ns = round(0.25 * _NS_PER_S / rate_hz)
        self._t_ns = np.zeros((len(serial.legs), ELEMENTS), np.int64)  # of the last scan
        self._longest_step_us = _MAX_RECORD_DURATION_SCANS * 1e6 / rate_hz / (ELEMENTS - 1)
        self._silent_ns = max(round(_SILENT_SCANS * _NS_PER_S / rate_hz), _MIN_SILENT_NS)
        self._legs = serial.legs
        self._wire_ns, self._sending_wire_ns = (
            round(bits * _NS_PER_S / serial.baud) for bits in (RECORD_BITS, SENDING_BITS)
        )
        self._sending: tuple[int, int] | None = None  # its time there [us] and here [ns]
        self._text = ""
        # Of the records of the last scan: rows and readings; and why a leg gave nothing, as last looked at.
        self._sent_readings: tuple[list[int], Codes] = [], np.zeros((0, ELEMENTS), np.uint8)
        self._reasons: dict[int, Reading] = {}
        self._decoder = SerialDecoder()
        self._map = ClockMap()
        self._opened = port.n_opened
        self._unwrapped_us = 0
        self._scan: McuScan | None = None
        self._frames: deque[CapFrame] = deque()
        self._sequence = 0
        self._last_t_us: int | None = None  # of the scan that was returned last
        self._heard_ns: dict[int, int] = {}
        self._expected: frozenset[int] = frozenset(self._rows.values())
        self._listens = False
        self._deadline_ns = 0
        self._logged = Counter[str]()
        self._log_at_ns = 0

    def read(self) -> CapFrame:
        """Wait for the next scan, and return it as a frame; after a silence, a frame without readings."""
        if not self._listens:
            self._drop_buffered_bytes()
        while not self._frames:
            self._port.wait_for_bytes_until_ns(self._deadline_ns)
            data = self._port.read()
            now_ns = self._clock.now_ns()
            if self._port.n_opened != self._opened:
                self._opened = self._port.n_opened
                self._decoder.reset()
                self._port.write(IDENTIFY)
            if data:
                self._assign_records_to_scans(data, now_ns)
            if not self._frames and now_ns >= self._deadline_ns:
                self._emit_frame(now_ns)
                self._deadline_ns = now_ns + self._silent_ns
            if now_ns >= self._log_at_ns:
                self._log_losses(now_ns)
        return self._frames.popleft()

    def _drop_buffered_bytes(self) -> None:
        """Discard the bytes buffered before the port was opened, whose age is unknown."""
        until_ns = self._clock.now_ns() + _BUFFER_DRAIN_TIME_NS
        while self._clock.now_ns() < until_ns:
            self._port.wait_for_bytes_until_ns(until_ns)
            self._port.read()
        self._deadline_ns = until_ns + self._silent_ns
        self._listens = True
        self._port.write(IDENTIFY)

    def close(self) -> None:
        """Close the serial port."""
        self._port.close()

    @property
    def losses(self) -> dict[str, int]:
        """Number of losses since the start, by kind: decoding errors, unused records, clock jumps."""
        return {**self._decoder.losses, "unused": self.n_unused, "clock jumps": self._map.restarts}

    def _assign_records_to_scans(self, data: bytes, now_ns: int) -> None:
        """Decode bytes, and assign their records to scans."""
        for sent in self._decoder.feed(data):
            if isinstance(sent, Sending):
                self._take_sending(sent, now_ns)
                continue
            record = sent
            row = self._rows.get(record.leg)
            if row is None:
                self.n_unused += 1
                continue
            self._heard_ns[row] = now_ns
            if row not in self._expected:
                self._expected |= {row}
            self._deadline_ns = now_ns + self._silent_ns
            if record.step_us > self._longest_step_us:
                record = sent._replace(step_us=0, values=_CORRUPT_VALUES)
            scan = self._scan
            if scan is not None and (row in scan.records or not self._is_near(record.t_us, scan.t_us)):
                self._emit_frame(now_ns)
                scan = None
            if scan is None:
                if self._last_t_us is not None and self._is_near(record.t_us, self._last_t_us):
                    self.n_unused += 1  # its scan was returned
                    continue
                scan = self._scan = McuScan(record.t_us, self._record_time_ns(record, now_ns), {})
            scan.records[row] = record
            if scan.records.keys() >= self._expected:
                self._emit_frame(now_ns)

    def _is_near(self, t_us: int, other_us: int) -> bool:
        """Return whether two times of the microcontroller [us] belong to the same scan."""
        return abs(wrapped_difference_us(t_us, other_us)) < self._half_scan_us

    def _take_sending(self, sending: Sending, now_ns: int) -> None:
        """Compare the controller's clock with this machine's."""
        self._sending = sending.t_us, self._here_ns(sending.t_us, 0, now_ns - self._sending_wire_ns)
        if sending.text and sending.text != self._text:
            self._text = sending.text
            _log.info("microcontroller: %s", self._text)

    def _here_ns(self, t_us: int, after_ns: int, arrival_ns: int) -> int:
        """Return a time after a controller's time, with the arrival of the message of that time [ns]."""
        self._unwrapped_us += wrapped_difference_us(t_us, self._unwrapped_us)
        return self._map.map(self._unwrapped_us * _NS_PER_US + after_ns, arrival_ns)

    def _record_time_ns(self, record: Record, now_ns: int) -> int:
        """Return the time of a record's first conversion in this machine's clock [ns].

        Of a controller that does not say when it sends, the arrival is compared with the last conversion.
        """
        if self._sending is not None:
            t_us, t_ns = self._sending
            return t_ns + wrapped_difference_us(record.t_us, t_us) * _NS_PER_US
        lasts_ns = (ELEMENTS - 1) * record.step_us * _NS_PER_US
        return self._here_ns(record.t_us, lasts_ns, now_ns - self._wire_ns) - lasts_ns

    def _emit_frame(self, now_ns: int) -> None:
        """Queue a frame of the records that have arrived; a leg without one reads DELAYED, a silent one NO_ANSWER."""
        n_legs = len(self._rows)
        sending = frozenset(
            row for row, heard_ns in self._heard_ns.items() if now_ns - heard_ns < self._silent_ns
        )
        t_ns = np.zeros((n_legs, ELEMENTS), np.int64)
        capacitance_pf = np.full((n_legs, ELEMENTS), np.nan)
        reading = np.full((n_legs, ELEMENTS), Reading.NO_ANSWER, np.uint8)
        reading[list(sending)] = Reading.DELAYED
        if self._scan is not None:
            rows = list(self._scan.records)
            t_ns[rows], capacitance_pf[rows], reading[rows] = readings(self._scan, now_ns)
            # A conversion that a record before had, too: of a converter that runs freely.
            repeated = np.abs(t_ns - self._t_ns) < self._same_ns
            t_ns[repeated] = self._t_ns[repeated]
            self._t_ns = t_ns
            self._last_t_us, self._scan = self._scan.t_us, None
            self._sent_readings = rows, reading[rows]
            if not sending <= set(rows):
                self.n_late_discards += 1
        self._expected = sending or frozenset(self._rows.values())
        self._frames.append(CapFrame(self._sequence, t_ns, capacitance_pf, reading))
        self._sequence += 1

    def _log_losses(self, now_ns: int) -> None:
        """Log the losses since the last message."""
        losses = Counter(self.losses)
        if new := losses - self._logged:
            counts = ", ".join(f"{kind} {n}" for kind, n in new.items())
            _log.warning("serial line of the microcontroller: %s", counts)
            if "version" in new and "version" not in self._logged:
                _log.error(
                    "the microcontroller sends records of version %d, or with fields that version has not; this "
                    "footsense reads version %d: flash the firmware of this footsense (firmware_interface/mcu)",
                    self._decoder.other_version,
                    VERSION,
                )
            self._logged = losses
        self._log_reasons()
        self._log_at_ns = now_ns + (_LOG_NS if new else _LOOK_NS)

    def _log_reasons(self) -> None:
        """Log the legs that the controller has no values of, each reason once."""
        rows, readings = self._sent_readings
        for row, reading in zip(rows, readings, strict=True):
            reason = Reading(int(reading[0])) if (reading == reading[0]).all() else Reading.OK
            if reason not in (Reading.OK, self._reasons.get(row)):
                meaning, remedy, _ = words_of_reading(reason)
                _log.warning("leg %s, by its microcontroller: %s; check %s", self._legs[row], meaning, remedy)
            self._reasons[row] = reason
