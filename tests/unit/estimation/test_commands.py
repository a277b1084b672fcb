"""Every command to a leg has one answer, soon, whatever its foot reads meanwhile."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from footsense.estimation.tare import MAX_WINDOWS, SETTLING_SCANS
from footsense.frames import CapFrame, Command, CommandKind, CommandResult, Mask, Reading, Result
from tests.support.feet import SCAN_NS, WINDOW, Feet, unread

LEGS = 2
#: Scans in which a command is answered.
LONGEST = MAX_WINDOWS * WINDOW + SETTLING_SCANS + 1


class Span(NamedTuple):
    """Some scans in a row, and what is sent before the first of them.

    Attributes:
        commands: The commands.
        n_scans: Scans.
        closure_um: Closure of all gaps.
        opened: Elements without an electrode, by leg.
        failed: Elements of leg 0 that give no reading, and the reading that says so.
        is_old: Whether the readings are those of the scan before.
    """

    commands: list[Command]
    n_scans: int = 1
    closure_um: float = 0.0
    opened: tuple[frozenset[int], ...] = (frozenset(), frozenset())
    failed: tuple[frozenset[int], Reading] = (frozenset(), Reading.DELAYED)
    is_old: bool = False


elements = st.frozensets(st.integers(0, 8), max_size=3)
commands = st.builds(Command, st.sampled_from(CommandKind), st.integers(0, LEGS - 1))
failures = st.tuples(elements | st.just(frozenset(range(9))), st.sampled_from(list(Reading)[1:]))
spans = st.builds(
    Span,
    st.lists(commands, max_size=3),
    st.integers(1, 14),
    st.sampled_from([0.0, 0.0, 0.02, 0.3, 5.0]),
    st.tuples(elements, elements),
    st.just((frozenset[int](), Reading.DELAYED)) | failures,
    st.sampled_from([False, False, True]),
)


class Robot:
    """Tared feet, and the commands that wait for an answer."""

    def __init__(self) -> None:
        self.feet = Feet(LEGS).tared()
        self.waiting: dict[int, list[int]] = {
            leg: [] for leg in range(LEGS)
        }  # since which scan, of each TARE
        self.answers: list[CommandResult] = []
        self.newest_ns = self.feet.sequence * SCAN_NS

    def send(self, command: Command) -> None:
        """Send a command; anything but a TARE is answered at once."""
        answer = self.feet.pipeline.execute(command)
        if command.kind is CommandKind.TARE:
            self.waiting[command.leg].append(self.feet.sequence)
            if answer is None:
                return
        assert answer is not None
        self.take(answer)

    def take(self, answer: CommandResult) -> None:
        """An answer to a TARE answers all that wait: one tare is in progress, and its result is theirs."""
        self.answers.append(answer)
        if answer.command.kind is CommandKind.TARE:
            assert self.waiting[answer.command.leg], f"{answer} was not asked for"
            self.waiting[answer.command.leg].clear()

    def scan(self, span: Span) -> None:
        """Feed a scan, and check who is answered: who asked, or a leg that had no baseline."""
        feet = self.feet
        scan = self._scan(span)
        untared: Mask = np.asarray(np.isnan(feet.pipeline.baseline_pf).all(axis=1))
        _, answers = feet.pipeline.process(scan, feet.sequence * SCAN_NS)
        for answer in answers:
            if self.waiting[answer.command.leg] or not untared[answer.command.leg]:
                self.take(answer)
        late = [
            since for waits in self.waiting.values() for since in waits if feet.sequence - since > LONGEST
        ]
        assert not late

    def _scan(self, span: Span) -> CapFrame:
        scan = self.feet.scan(span.closure_um)
        for leg, opened in enumerate(span.opened):
            scan.capacitance_pf[leg, list(opened)] = 0.3
        elements, reading = span.failed
        if elements:
            unread(scan, 0, *elements, reading=reading)
        if not span.is_old:
            self.newest_ns = self.feet.sequence * SCAN_NS
        np.minimum(scan.t_ns, self.newest_ns, out=scan.t_ns)
        return scan


@pytest.mark.slow
@given(st.lists(spans, max_size=8))
@example([Span([Command(CommandKind.TARE, 0)], 12, opened=(frozenset({0, 4}), frozenset()))])
def test_every_command_has_one_answer_and_nothing_is_done_unasked(script: list[Span]) -> None:
    """START and STOP at once, a TARE in a few windows at most; what was refused is not done when the foot is well."""
    robot = Robot()
    for span in script:
        for command in span.commands:
            robot.send(command)
        for _ in range(span.n_scans):
            robot.scan(span)
    for _ in range(4 * LONGEST):
        robot.scan(Span([]))
    assert not any(robot.waiting.values())


def test_a_tare_that_finds_no_steady_readings_says_which() -> None:
    """Two open elements that are no row or column: it was never answered, and done when the plug was back."""
    robot = Robot()
    robot.send(Command(CommandKind.TARE, 0))
    two_open = Span([], opened=(frozenset({0, 4}), frozenset()))
    for _ in range(LONGEST):
        robot.scan(two_open)
    [answer] = robot.answers
    assert answer == (
        Command(CommandKind.TARE, 0),
        Result.ELEMENT_FAULT,
        "elements 0, 4 give no steady readings: 0 of 4 scans in 0.4 s",
    )


def test_a_foot_that_touches_during_its_tare_is_not_tared() -> None:
    """The foot hung when the command came; its light load alone is within what a tare allows."""
    robot = Robot()
    robot.send(Command(CommandKind.TARE, 0))
    for _ in range(WINDOW):
        robot.scan(Span([], closure_um=0.2))
    [answer] = robot.answers
    assert answer.result is Result.LOADED
    assert answer.reason.startswith("the foot is in contact: it carries 0.09 N")
    assert np.ptp(robot.feet.pipeline.baseline_pf) == 0.0
