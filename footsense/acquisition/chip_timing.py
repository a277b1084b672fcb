"""Actual conversion time of a leg's converter, measured when the leg is found and again from time to time.

The clock of a converter is inaccurate: the plan waits 2 % longer than the nominal time. A chip that needs more gets it,
and so do the legs that convert at the same time; else the lines of the next element would be switched before it has
finished, which nothing would show. A conversion is started while the result of the one before is still to
be asked for: whether a chip then still says that it was done is in no data sheet. Of a chip that does not, the question
comes first (`leg_group.py`).
"""

from typing import NamedTuple

from footsense.acquisition.boards.board import MAX_WAIT_FACTOR
from footsense.acquisition.scan_plan import ScanPlan
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus

#: Halvings of the range of a slow chip: to a hundredth.
_N_BISECTIONS = 5
#: What the clock of a slow chip may drift until it is measured again [1].
_TIMING_DRIFT_REL = 0.01


class ChipTiming(NamedTuple):
    """Measured conversion time of one leg's converter, over the wait of the scan plan.

    Attributes:
        wait_factor: Time after which it has finished, over the wait of the plan, at least 1 [1].
        keeps_done_bit: Whether it says that a conversion is done after the next one was started.
    """

    wait_factor: float = 1.0
    keeps_done_bit: bool = True


def measure_chip_timing(bus: I2cBus, clock: Clock, plan: ScanPlan) -> ChipTiming | None:
    """Measure and return the conversion time of the only connected leg's converter; None if it does not finish.

    All rates of a chip come from one clock, so that the fastest is measured. Its last conversion is left running.

    Args:
        bus: The leg's bus.
        clock: The time that it lives in.
        plan: The scan.

    Returns:
        Its timing; None if it does not finish.

    Raises:
        I2cError: A transaction failed.
    """
    board = plan.board
    rate_sps = max(board.conversion_ns)
    step, following = (board.step(each.element, rate_sps) for each in plan.steps[:2])

    def finishes_in_time(wait_factor: float, *, next_started: bool) -> bool:
        for transaction in board.make_ready:
            bus.transfer(transaction)
        before_ns = clock.now_ns()
        bus.transfer(step.trigger)
        # The next trigger, which takes as long as this one, ends the conversion when the time is over.
        clock.sleep_until_ns(before_ns + round(wait_factor * board.conversion_wait_ns(rate_sps)))
        if next_started:
            bus.transfer(following.trigger)
        if step.done is not None:
            return step.done.decode(bus.transfer(step.done.read)) is Reading.OK
        return board.decode_result(list(map(bus.transfer, step.read)))[0] is not Reading.NOT_READY

    if finishes_in_time(1.0, next_started=True):
        return ChipTiming()
    if not finishes_in_time(MAX_WAIT_FACTOR, next_started=False):
        return None
    keeps_done_bit = finishes_in_time(MAX_WAIT_FACTOR, next_started=True)
    if not keeps_done_bit and finishes_in_time(1.0, next_started=False):
        return ChipTiming(keeps_done_bit=False)
    low, high = 1.0, MAX_WAIT_FACTOR
    for _ in range(_N_BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if finishes_in_time(middle, next_started=keeps_done_bit) else (middle, high)
    return ChipTiming(high * (1 + _TIMING_DRIFT_REL), keeps_done_bit)
