"""How the service reads six legs with each board, in numbers that were measured of it."""

from typing import Literal, NamedTuple

from firmware_interface.chips import ad7147, fdc1004
from footsense.sim.scene import Ad7147Effects


class SixLegScan(NamedTuple):
    """How the service reads six legs with a board, with 40 us of host for each transaction; times as measured of it.

    Attributes:
        step_ns: From one conversion to the next [ns].
        conversions_per_force: Conversions of each published force.
        send_delay_ns: From the middle of a force's last conversion to its sending, on average [ns].
        noise_pf: Noise of a conversion [pF rms].
        range_end_pf: Largest capacitance that is read [pF].
        absent_ns: How long a foot is absent whose cable breaks for 20 ms [ns].
        stale_ns: How long its force is then still missing: its readings are too old [ns].
    """

    step_ns: int
    conversions_per_force: int
    send_delay_ns: int
    noise_pf: float
    range_end_pf: float
    absent_ns: int
    stale_ns: int


Board = Literal["ad7147", "fdc1004"]
#: By board: on two buses, and on one at 400 conversions a second. A published force of the service with board `ad7147`
#: has 17.6 conversions of 0.768 ms; here they are 18, two scans, in the same time.
SCANS = {
    "ad7147": SixLegScan(
        step_ns=round(13.517e6 / 18),
        conversions_per_force=18,
        send_delay_ns=2_680_000,
        noise_pf=Ad7147Effects().noise_ff * 1e-3,
        range_end_pf=ad7147.RANGE_END_PF,
        absent_ns=23_500_000,
        stale_ns=4_800_000,
    ),
    "fdc1004": SixLegScan(
        step_ns=2_747_600,
        conversions_per_force=4,
        send_delay_ns=3_170_000,
        noise_pf=fdc1004.RATES[400].noise_ff * 1e-3,
        range_end_pf=fdc1004.capacitance_pf(fdc1004.CODE_MAX),
        absent_ns=57_000_000,
        stale_ns=21_000_000,
    ),
}
