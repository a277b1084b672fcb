"""The live table fits onto any terminal: it loses what is worth least, and never a leg's name."""

import io
from functools import partial

import numpy as np
import pytest
from rich.console import Console

from footsense.cli.live import LiveView, Picture, legs_table
from footsense.frames import LEGS, CapFrame, Cycle, State
from tests.support.frames import contact_frame

STATES = (
    State.VALID,
    State.CONVERTER_FAULT,
    State.ELEMENT_FAULT,
    State.OUT_OF_RANGE,
    State.STOPPED,
    State.DEGRADED,
)


def cycle() -> Cycle:
    """Return a cycle of six legs, the first at half of the bar and one hair below zero in x, two at full load."""
    n = len(LEGS)
    force_n = np.full((n, 3), -12.3456)
    force_n[0] = (-0.0004, 0.25, 0.6)
    force_n[5, 2] = 20.0
    return Cycle(
        CapFrame(7, np.ones((n, 9), np.int64), np.ones((n, 9)), np.zeros((n, 9), np.uint8)),
        (),
        contact_frame(
            2_000_000_000, n, sequence=7, t_ns=1_900_000_000, force_n=force_n, sigma_n=1.0, state=STATES
        ),
        (),
    )


def drawn(encoding: str, width: int = 80) -> list[str]:
    """Return the headings and legs that a terminal of this width and encoding shows after one cycle."""
    screen = io.BytesIO()
    file = io.TextIOWrapper(screen, encoding=encoding)
    console = Console(file=file, force_terminal=True, width=width, color_system=None)
    true_n = np.full((len(LEGS), 3), 12.3456)
    view = LiveView(
        console, partial(legs_table, console, LEGS, "tripod, simulated", "", lambda _: true_n, 2.0)
    )
    view.observe(cycle())
    view.close()
    file.flush()
    lines = [
        line
        for line in screen.getvalue().decode(encoding).splitlines()
        if line.startswith((*LEGS, "leg", "footsense"))
    ]
    return lines[-len(LEGS) - 2 :]  # the table is drawn once more when it is closed


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "ascii"])
def test_each_leg_is_one_line_of_at_most_80_columns(encoding: str) -> None:
    """The longest state beside the largest numbers breaks no line, in whatever encoding the terminal has."""
    _, _, *lines = drawn(encoding)
    assert [line[:2] for line in lines] == list(LEGS)
    assert max(map(len, lines)) <= 80
    for line, state in zip(lines, STATES, strict=True):
        assert state.name.lower().replace("_", " ") in line
        assert line.count("12.346") == 1 + (2 if line.startswith("rr") else 0)


@pytest.mark.parametrize(("encoding", "cell"), [("utf-8", "━"), ("latin-1", "-"), ("ascii", "-")])
def test_a_bar_is_drawn_with_what_the_terminal_has(encoding: str, cell: str) -> None:
    """Half the scale is half the cells, more than the scale all of them."""
    _, _, *lines = drawn(encoding)
    assert [lines[row].count(cell) - lines[row].count(f" {cell}1") for row in (0, 5)] == [5, 10]


@pytest.mark.parametrize(
    ("width", "headings"),
    [
        (120, "leg state foot P holds fx [N] fy [N] fz [N] load true [N] age [ms] cause"),
        (80, "leg state foot fx [N] fy [N] fz [N] load true [N]"),
        (60, "leg state foot fx [N] fy [N] fz [N]"),
        (40, "leg state foot fz [N]"),
        (20, "leg state"),
        (4, "leg"),
    ],
)
def test_a_narrow_terminal_loses_what_is_worth_least(width: int, headings: str) -> None:
    """Nothing is cut or folded but the line above, whose end is worth least."""
    head, titles, *lines = drawn("utf-8", width)
    assert " ".join(titles.split()) == headings
    assert [line[:2] for line in lines] == list(LEGS)
    assert max(map(len, (head, titles, *lines))) <= width


@pytest.mark.parametrize(
    ("width", "left_out"), [(120, ""), (80, "a wider terminal shows P, holds, age [ms], cause, too")]
)
def test_what_a_narrow_terminal_leaves_out_is_named(width: int, left_out: str) -> None:
    screen = io.StringIO()
    console = Console(file=screen, width=width, color_system=None)
    console.print(
        legs_table(console, LEGS, "tripod", "", lambda _: np.zeros((len(LEGS), 3)), 2.0, cycle(), 1.0)
    )
    assert screen.getvalue().splitlines()[1].strip() == left_out


def test_after_a_resize_the_table_is_drawn_on_an_empty_screen() -> None:
    """A terminal that is narrower has folded the lines of the last picture, and they would stay."""
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=80, height=30, color_system=None)
    with Picture(console) as picture:
        picture.update("one", refresh=True)
        assert "\x1b[2J" not in screen.getvalue()
        console.width = 60
        picture.update("two", refresh=True)
        picture.update("three", refresh=True)
    assert screen.getvalue().count("\x1b[2J") == 1
    assert screen.getvalue().index("\x1b[2J") < screen.getvalue().index("two")
