"""Conversion time of a converter, and what makes it forget that a conversion is done, measured on the chip.

The clock of a converter is inaccurate, and no data sheet says when a FDC1004 clears its DONE bits: whether the trigger
of the next measurement does, and whether reading the upper register of a result suffices or the lower one has to be
read too. A driver that assumes too much of the latter takes old results for new ones. So each chip is asked, and what
is not known for certain counts as the slower way.
"""

from dataclasses import dataclass
from typing import NamedTuple

from firmware_interface.chips.fdc1004 import RATES
from footsense.acquisition.boards import fdc1004
from footsense.acquisition.boards.board import MAX_WAIT_FACTOR, ConversionStep, conversion_wait_ns
from footsense.acquisition.leg_bus import reading_of_poll
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus

#: Halvings of the range of a slow chip: to a hundredth.
_N_BISECTIONS = 5
#: What the clock of a slow chip may drift until it is measured again [1].
_TIMING_DRIFT_REL = 0.01
#: Answers that have to agree before the lower register is left out: a flipped bit must not decide it.
_N_AGREEING_ANSWERS = 3


class ChipTiming(NamedTuple):
    """Measured conversion time of a converter, over the wait of the scan plan, and how it forgets.

    Attributes:
        wait_factor: Time after which it has finished, over the wait of the plan, at least 1 [1].
        keeps_done_bit: Whether it says that a conversion is done after the next one was started.
        reads_whole_result: Whether all registers of a result have to be read before it forgets that the conversion is
            done; so as long as the contrary was not measured.
    """

    wait_factor: float = 1.0
    keeps_done_bit: bool = True
    reads_whole_result: bool = True


@dataclass(frozen=True)
class _Trial:
    """Trials of a converter of the only connected leg: two conversions that follow each other in a scan.

    Attributes:
        bus: The bus.
        wait_ns: Time after which a chip within its tolerance has finished [ns].
        first: The first conversion.
        following: The second one.
        clock: The time that the bus lives in.
    """

    bus: I2cBus
    wait_ns: int
    first: ConversionStep
    following: ConversionStep
    clock: Clock

    def finishes_in_time(self, wait_factor: float, *, next_started: bool) -> bool:
        """Convert; return whether that is done after a wait, with the next conversion started or not."""
        for transaction in fdc1004.MAKE_READY:
            self.bus.transfer(transaction)
        before_ns = self.clock.now_ns()
        self.bus.transfer(self.first.trigger)
        # The next trigger, which takes as long as this one, ends the conversion when the time is over.
        self.clock.sleep_until_ns(before_ns + round(wait_factor * self.wait_ns))
        if next_started:
            self.bus.transfer(self.following.trigger)
        return self._done_answers(1) == {Reading.OK}

    def reads_whole_result(self) -> bool:
        """Read the value of the conversion that has just finished; return whether its DONE bit may still be set."""
        before = self._done_answers(_N_AGREEING_ANSWERS)
        for transaction in self.first.read_value:
            self.bus.transfer(transaction)
        return before != {Reading.OK} or self._done_answers(_N_AGREEING_ANSWERS) != {Reading.NOT_READY}

    def _done_answers(self, n: int) -> set[Reading]:
        done = self.first.done
        return {reading_of_poll(done, self.bus.transfer(done.read)) for _ in range(n)}


def measure_chip_timing(bus: I2cBus, clock: Clock) -> ChipTiming | None:
    """Return the timing of the converter of the only connected leg; None if its conversions do not finish.

    All rates of a chip come from one clock, so that the fastest is measured. Its last conversion is left running.

    Args:
        bus: The bus.
        clock: The time that the bus lives in.

    Raises:
        I2cError: A transaction failed.
    """
    rate = RATES[max(RATES)]
    first, following = (fdc1004.step(element, rate) for element in fdc1004.ORDER[:2])
    trial = _Trial(bus, conversion_wait_ns(rate), first, following, clock)
    if trial.finishes_in_time(1.0, next_started=True):
        return ChipTiming(reads_whole_result=trial.reads_whole_result())
    if not trial.finishes_in_time(MAX_WAIT_FACTOR, next_started=False):
        return None
    whole = trial.reads_whole_result()
    keeps_done_bit = trial.finishes_in_time(MAX_WAIT_FACTOR, next_started=True)
    if not keeps_done_bit and trial.finishes_in_time(1.0, next_started=False):
        return ChipTiming(keeps_done_bit=False, reads_whole_result=whole)
    low, high = 1.0, MAX_WAIT_FACTOR
    for _ in range(_N_BISECTIONS):
        middle = (low + high) / 2
        in_time = trial.finishes_in_time(middle, next_started=keeps_done_bit)
        low, high = (low, middle) if in_time else (middle, high)
    return ChipTiming(high * (1 + _TIMING_DRIFT_REL), keeps_done_bit, whole)
