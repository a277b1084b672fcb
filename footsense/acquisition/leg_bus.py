"""I2C adapter with the legs on it: one class that all transactions of a scan go through.

The legs are behind a mux that footsense switches; or one leg is directly on the adapter, as on a channel of a mux that
the kernel drives, which is an adapter of its own. A *selection* is a bit mask of mux channels, bit n for channel n, as
in the control byte of a TCA9548A; a leg without a mux has bit 0.
"""

import contextlib
import logging

from footsense.acquisition.boards.board import ConversionStep, DonePoll, ReadBackCheck
from footsense.acquisition.boards.fdc1004 import decode_results
from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.frames import Reading
from footsense.ports import I2cBus, MuxResetLine, Transaction

_log = logging.getLogger(__name__)

_NAN = float("nan")
#: Attempts of a transaction before it counts as failed, and of a conversion on a bus with stuck lines.
MAX_ATTEMPTS = 2

#: Nine clocks with SDA released: address 0x7F and the bit to read are eight ones, and no chip may acknowledge them.
#: Source: UM10204, section 3.1.16 (bus clear) and table 4 (reserved addresses).
NINE_CLOCKS = Transaction(0x7F, b"", 1)


def release_sda(bus: I2cBus) -> None:
    """Clock out the byte in which a chip was interrupted; until then it holds SDA low.

    An adapter that compares SDA with what it sends times out instead; its driver clears the bus, or nothing does. One
    that does not, as that of a Raspberry Pi 0 to 4, reads a line that stays low as an acknowledge of any address.

    Raises:
        I2cTimeoutError: SDA stays low.
        I2cError: The transaction failed otherwise.
    """
    for _ in range(2):
        try:
            bus.transfer(NINE_CLOCKS)
        except NackError:
            return
    raise I2cTimeoutError("SDA is held low: an address that no chip has is acknowledged")


def reading_of_poll(poll: DonePoll, answer: bytes) -> Reading:
    """Return OK if a conversion is done, NOT_READY if it is not, CORRUPT if the answer is none of such a chip."""
    word = int.from_bytes(answer, "big")
    if word & poll.never_set:
        return Reading.CORRUPT
    return Reading.OK if word & poll.done else Reading.NOT_READY


class LegBus:
    """I2C adapter with its legs behind a TCA9548A, or one leg without; an unchanged selection is not written again.

    Args:
        adapter: The adapter.
        mux_address: Address of the mux; None for a leg directly on the adapter.
        reset_line: The mux's RESET pin; None if nothing drives it. Without it, a leg that holds a line low stops all
            legs of its bus for as long as it does.

    Attributes:
        adapter: As given.
        mux_address: As given.
    """

    def __init__(
        self, adapter: I2cBus, mux_address: int | None, reset_line: MuxResetLine | None = None
    ) -> None:
        self.adapter = adapter
        self.mux_address = mux_address
        self._reset_line = reset_line
        self._selection: int | None = None
        self._writes: list[Transaction] = []
        if mux_address is not None:
            self._writes = [Transaction(mux_address, bytes((selection,))) for selection in range(256)]

    def connect(self, selection: int) -> I2cBus:
        """Connect exactly these mux channels; return the bus on which their chips answer.

        Raises:
            I2cError: The mux did not take it; which channels are connected is then unknown.
        """
        if selection != self._selection:
            self._selection = None
            if self._writes:
                self.adapter.transfer(self._writes[selection])
            self._selection = selection
        return self.adapter

    def exchange(self, selection: int, transactions: tuple[Transaction, ...]) -> list[bytes] | None:
        """Connect mux channels, do transactions, and return their answers; None if one failed.

        After a failure the selection is written again: a mux that has lost it connects no leg.

        Raises:
            I2cTimeoutError: A line is held low.
        """
        try:
            if selection != self._selection:  # as `connect`, without a call for each transaction
                self._selection = None
                if self._writes:
                    self.adapter.transfer(self._writes[selection])
                self._selection = selection
            return list(map(self.adapter.transfer, transactions))
        except I2cTimeoutError:
            raise
        except I2cError:
            self.forget_selection()
            return None

    def poll(self, selection: int, poll: DonePoll) -> Reading:
        """Ask some legs whether a conversion is done, as of `reading_of_poll`; NO_ANSWER if that fails.

        Raises:
            I2cTimeoutError: A line is held low.
        """
        answers = self.exchange(selection, (poll.read,))
        return Reading.NO_ANSWER if answers is None else reading_of_poll(poll, answers[0])

    def read_result(
        self, selection: int, step: ConversionStep, *, whole: bool, is_done: bool
    ) -> tuple[Reading, float]:
        """Read the result of a converter, and try again once if that fails.

        Args:
            selection: The leg.
            step: The conversion.
            whole: Whether to read all its registers.
            is_done: Whether it is known to be done; else it is asked first.

        Returns:
            The reading, and the capacitance [pF], NaN unless it is OK; NOT_READY if it is not done, NO_ANSWER if the
            converter does not answer.

        Raises:
            I2cTimeoutError: A line is held low.
        """
        reading = Reading.NO_ANSWER
        for _ in range(MAX_ATTEMPTS):
            if not is_done:
                reading = self.poll(selection, step.done)
                if reading is Reading.NOT_READY:
                    break
                if reading is not Reading.OK:
                    continue
            answers = self.exchange(selection, step.read if whole else step.read_value)
            if answers is not None:
                return decode_results(answers, 1)[0]
            reading = Reading.NO_ANSWER
        return reading, _NAN

    def check(self, selection: int, check: ReadBackCheck) -> Reading:
        """Ask some legs for a setting; MISCONFIGURED if it is another one, NO_ANSWER if that fails.

        Raises:
            I2cTimeoutError: A line is held low.
        """
        answers = self.exchange(selection, (check.read,))
        if answers is None:
            return Reading.NO_ANSWER
        return Reading.OK if answers[0] == check.expected else Reading.MISCONFIGURED

    def holds_selection(self, selection: int) -> bool:
        """Return whether the mux reads back a selection that was written, or does not answer; True without a mux.

        One that acknowledges and keeps its channels would give every leg the readings of one.

        Raises:
            I2cTimeoutError: A line is held low.
        """
        if self.mux_address is None:
            return True
        answers = self.exchange(selection, (Transaction(self.mux_address, b"", 1),))
        held = answers is None or answers[0][0] == selection
        if not held:
            self.forget_selection()
        return held

    def forget_selection(self) -> None:
        """Discard the stored selection, so that the next one is written even if unchanged."""
        self._selection = None

    def free_bus(self) -> bool:
        """Disconnect all legs from a possibly stuck bus; return whether it is free again.

        A leg that holds SDA low blocks the write that would disconnect it, so that only the RESET pin helps. Without
        one, nine clocks and that write are tried all the same: the line may be released.
        """
        self._selection = None
        with contextlib.suppress(I2cError):
            if self._reset_line is not None:
                self._reset_line.pulse()
            else:
                release_sda(self.adapter)
            self.connect(0)
        return self._selection is not None

    def disconnect_legs(self) -> None:
        """Disconnect all mux channels."""
        try:
            self.connect(0)
        except I2cError as error:
            _log.info("the mux at %#04x was not released: %s", self.mux_address, error)
