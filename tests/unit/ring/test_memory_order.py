"""The ring on weak memory order: the stores for a record are seen in any order, and laps are written during a copy."""

import mmap
import os
import resource
from collections.abc import Callable, Sequence
from contextlib import closing

import msgspec
import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from footsense.errors import FootsenseError
from footsense.frames import CommandResult, Cycle, Result
from footsense.ring import ring_file
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.cycle_ring import CycleRing, encode_cycle
from footsense.ring.records import LostCycles, NumberedCycle
from tests.support.cycles import LEGS, TARE, quick_cycle, status

HEAD_BYTES = ring_file.RECORD_HEAD.size
#: A small ring, four margins long, so that laps are short [bytes].
RING_BYTES = 4 * ring_file.MARGIN_BYTES
#: Records that end at multiples of it begin where a record of the lap before began [bytes].
SLOT_BYTES = RING_BYTES // 16
STATUS_BYTES = HEAD_BYTES + len(msgspec.msgpack.encode(status()))
#: Of one record: length, CRC and first half, second half; `begin` and `end`.
N_STORES = 5


def _nothing() -> None:
    """Let nothing happen."""


class WeakRing(CycleRing):
    """Ring whose readers see the stores for each record in an order of its own.

    Attributes:
        order: This order of the numbers of stores.
        look: Called after each store.
    """

    def __init__(self) -> None:
        super().__init__(None, LEGS, {}, 1.0, status)
        self._n_bytes = RING_BYTES
        os.truncate(self._fd, self._place + RING_BYTES)
        self.memory = np.frombuffer(mmap.mmap(self._fd, self._place + RING_BYTES), np.uint8)
        self.order: Sequence[int] = range(N_STORES)
        self.look: Callable[[], None] = _nothing

    def _write(self, data: bytes) -> None:
        at = self._place + np.arange(self._end, self._end + HEAD_BYTES + len(data)) % RING_BYTES
        stale = self.memory[at]
        counters, held_back = self._counters, dict[int, int]()
        self._counters = held_back  # type: ignore[assignment]
        super()._write(data)
        self._counters = counters
        fresh = self.memory[at]
        self.memory[at] = stale
        cuts = (0, 4, len(at) // 2, len(at))
        for store in self.order:
            if store < 3:
                part = slice(cuts[store], cuts[store + 1])
                self.memory[at[part]] = fresh[part]
            else:
                counter = (ring_file.BEGIN, ring_file.END)[store - 3]
                counters[counter] = held_back.get(counter, counters[counter])
            self.look()


class LappedReader(CycleReader):
    """Reader in the middle of whose copy something happens once.

    Attributes:
        copied: Part of the bytes that is copied before [1].
        meanwhile: What happens.
        n_told: Number of cycles that were read or told as lost.
    """

    def __init__(self, ring: CycleRing) -> None:
        super().__init__(fd=ring.open_for_reading())
        self.copied = 0.0
        self.meanwhile: Callable[[], None] = _nothing
        self.begin_again()

    def begin_again(self) -> None:
        self.rewind(first_number=0)
        self.n_told = 0

    def _copy(self, start: int, end: int) -> bytes:
        middle = start + int(self.copied * max(end - start, 0))
        ahead = super()._copy(start, middle)
        happens, self.meanwhile = self.meanwhile, _nothing
        happens()
        return ahead + super()._copy(middle, end)


def cycle_to_next_slot(number: int, position: int) -> Cycle:
    """Return a cycle whose record, written at a position, ends where a slot ends."""

    def with_text(n: int) -> Cycle:
        return quick_cycle(number)._replace(ended_commands=(CommandResult(TARE, Result.DONE, "x" * n),))

    n_least = 1000
    least_end = position + HEAD_BYTES + len(encode_cycle(number, with_text(n_least)))
    least_end += STATUS_BYTES if number % 4 == 0 else 0
    return with_text(n_least + -least_end % SLOT_BYTES)


class AnyOrder(RuleBasedStateMachine):
    """Readers get all cycles in order, bit for bit, or counted as lost where they were overwritten; none comes late."""

    def __init__(self) -> None:
        super().__init__()
        self.ring = WeakRing()
        self.records: list[bytes] = []
        #: Position behind each cycle.
        self.ends: list[int] = []
        self.readers = [LappedReader(self.ring) for _ in range(3)]

    def teardown(self) -> None:
        for reader in self.readers:
            reader.close()
        self.ring.close()

    def write_cycles(self, n: int, *, in_slots: bool) -> None:
        for _ in range(n):
            number = len(self.records)
            one = cycle_to_next_slot(number, self.ring._end) if in_slots else quick_cycle(number)
            self.records.append(encode_cycle(number, one))
            self.ring.observe(one)
            self.ends.append(self.ring._end)

    def read(self, reader: LappedReader) -> None:
        n_whole = len(self.ends)
        for entry in reader.read():
            if isinstance(entry, LostCycles):
                assert entry.next_cycle_number - entry.n_cycles == reader.n_told < entry.next_cycle_number
                assert self.ends[entry.next_cycle_number - 1] <= self.ring._begin
                reader.n_told = entry.next_cycle_number
            else:
                assert entry.cycle_number == reader.n_told
                assert encode_cycle(*entry) == self.records[reader.n_told]
                reader.n_told += 1
        assert reader.n_told >= n_whole or self.ends[n_whole - 1] <= self.ring._begin

    @rule(
        n=st.integers(1, 6),
        in_slots=st.booleans(),
        order=st.permutations(range(N_STORES)),
        looking=st.sets(st.integers(0, 2)),
        from_begin=st.booleans(),
    )
    def write_while_readers_look(
        self, *, n: int, in_slots: bool, order: Sequence[int], looking: set[int], from_begin: bool
    ) -> None:
        """Readers look after each store, one of them from the beginning of the ring."""

        def look() -> None:
            for number in looking:
                if from_begin and number == 2:
                    self.readers[2].begin_again()
                self.read(self.readers[number])

        self.ring.order, self.ring.look = order, look
        self.write_cycles(n, in_slots=in_slots)
        self.ring.look = _nothing
        look()

    @rule(n=st.integers(1, 24), in_slots=st.booleans())
    def write(self, *, n: int, in_slots: bool) -> None:
        """Up to one and a half laps in slots."""
        self.write_cycles(n, in_slots=in_slots)

    @rule(number=st.integers(0, 2), n=st.integers(1, 24), copied=st.sampled_from([0.0, 0.01, 0.5, 1.0]))
    def write_under_a_reader(self, *, number: int, n: int, copied: float) -> None:
        reader = self.readers[number]
        reader.copied, reader.meanwhile = copied, lambda: self.write_cycles(n, in_slots=True)
        self.read(reader)


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = settings(max_examples=25, stateful_step_count=12, deadline=None)


#: What is written over a record, and how far behind its beginning [bytes].
DAMAGES = {
    "no length": (0, bytes(4)),
    "a length beyond the end": (0, (1 << 18).to_bytes(4, "little")),
    "a length that no record has": (0, (1 << 20).to_bytes(4, "little")),
    "another CRC": (4, bytes(4)),
    "another byte": (300, b"!"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_record_is_refused_with_the_next(damage: str) -> None:
    """Until then, however often a reader looks, its bytes may still come; one far back needs no next one."""
    at, content = DAMAGES[damage]
    with closing(CycleRing(None, LEGS, {}, 40.0, status)) as ring, closing(LappedReader(ring)) as reader:
        ring.observe(quick_cycle(0))
        start = ring._end
        ring.observe(quick_cycle(1))
        os.pwrite(ring._fd, content, ring._place + start + at)
        assert [len(reader.read()) for _ in range(4)] == [1, 0, 0, 0]
        ring.observe(quick_cycle(2))
        with pytest.raises(FootsenseError, match="a record is damaged"):
            reader.read()
        while reader.end - start < 3 * ring_file.MAX_RECORD_BYTES:
            ring.observe(quick_cycle(3))
        with closing(LappedReader(ring)) as other:
            assert len(other.read()) == 1
            with pytest.raises(FootsenseError, match="a record is damaged"):
                other.read()


def test_a_record_that_could_not_be_written_is_not_published() -> None:
    """Its bytes come before `end`; the cycle counts as lost."""
    with closing(CycleRing(None, LEGS, {}, 1.0, status)) as ring, closing(LappedReader(ring)) as reader:
        ring.observe(quick_cycle(0))
        end, limits = reader.end, resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
        try:
            with pytest.raises(OSError, match="File too large"):
                ring.observe(quick_cycle(1))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert reader.end == end
        ring.observe(quick_cycle(2))
        assert [entry[0] for entry in reader.read() if isinstance(entry, NumberedCycle)] == [0, 2]
