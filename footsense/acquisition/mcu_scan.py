"""Conversion of one scan's records from a microcontroller to the values of a capacitance frame."""

from typing import NamedTuple

import numpy as np

from firmware_interface.conversion_order import CONVERSION_ORDERS
from firmware_interface.serial_frames import N_NO_VALUE_CODES, NO_VALUE_BASE, NoValue, Record, RecordFlag
from footsense.frames import ELEMENTS, Codes, Reading, Stamps, Vector

_NS_PER_US = 1000
_PF_PER_AF = 1e-6
_LO_SHU = int(RecordFlag.LO_SHU)  # a plain number: an enumeration's arithmetic costs a microsecond

_NO_VALUE_ENDS = NO_VALUE_BASE + N_NO_VALUE_CODES
_READING_OF_CODE = np.full(N_NO_VALUE_CODES, Reading.CORRUPT, np.uint8)
_READING_OF_CODE[list(NoValue)] = list(NoValue)

#: Position of each element in the scan, by order flag, shape (2, 9).
_SCAN_POSITION_OF_ELEMENT = np.array([np.argsort(CONVERSION_ORDERS[order]) for order in ("raster", "lo_shu")])


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
    after_us, step_us, order = np.array(
        [
            (wrapped_difference_us(record.t_us, scan.t_us), record.step_us, record.flags & _LO_SHU)
            for record in records
        ]
    ).T
    ahead = scan.t_ns + _NS_PER_US * (ELEMENTS - 1) * step_us > now_ns
    t_ns = scan.t_ns + _NS_PER_US * (after_us[:, None] + step_us[:, None] * _SCAN_POSITION_OF_ELEMENT[order])
    capacitance_pf = values_af * _PF_PER_AF
    reading = np.zeros(values_af.shape, np.uint8)
    without = values_af < _NO_VALUE_ENDS
    if without.any() or ahead.any():
        reading[without] = _READING_OF_CODE[values_af[without] - NO_VALUE_BASE]
        reading[ahead] = Reading.CORRUPT
        without |= ahead[:, None]
        capacitance_pf[without] = np.nan
        t_ns[without & (reading != Reading.OVER_RANGE)] = 0
    return t_ns, capacitance_pf, reading
