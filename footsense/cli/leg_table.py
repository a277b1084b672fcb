"""Terminal tables with one row per leg, at most 80 columns wide, with common columns and colours."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from firmware_interface.can.codes import State
from footsense.leg_phase import LegPhase, phase_of

_PHASE_STYLES = {
    LegPhase.ABSENT: "bold red",
    LegPhase.STARTING: "yellow",
    LegPhase.TARING: "yellow",
    LegPhase.VALID: "green",
    LegPhase.DEGRADED: "yellow",
    LegPhase.FAULTED: "bold red",
    LegPhase.STOPPED: "dim",
}

#: Cell without a value.
EMPTY_CELL = Text("-", "dim")

Leg = TypeVar("Leg")
#: Alignment and least width, such as ">7", and the cell of a leg, by the title of the column.
LegColumns = Mapping[str, tuple[str, Callable[[Leg], RenderableType]]]


def leg_table(legs: Mapping[str, Leg], columns: LegColumns[Leg]) -> Table:
    """Return a table with one row per leg; the first column is the leg's name.

    Args:
        legs: What is known of each leg, by its name.
        columns: The other columns.
    """
    table = Table(box=None, pad_edge=False, padding=(0, 1))
    table.add_column("leg")
    for title, (form, _) in columns.items():
        table.add_column(
            escape(title),
            justify="right" if form[0] == ">" else "left",
            min_width=int(form[1:]),
            no_wrap=True,
        )
    for name, leg in legs.items():
        table.add_row(name, *(cell(leg) for _, cell in columns.values()))
    return table


def state_text(state: State) -> Text:
    """Return a leg's state as text, in the colour of its operating phase."""
    return Text(enum_words(state.name), _PHASE_STYLES[phase_of(state)])


def force_columns(force_n: Callable[[Leg], Sequence[float]]) -> LegColumns[Leg]:
    """Return the table columns of the force components; NaN gives an empty cell.

    A component that rounds to zero has no sign, which would flicker.

    Args:
        force_n: Returns the force on a leg [N].

    Example:
        >>> [cell((-0.0004, -0.0006, 1.0)) for _, cell in force_columns(tuple).values()]
        ['+0.000', '-0.001', '+1.000']
    """

    def cell(leg: Leg, axis: int) -> str | Text:
        return number_cell(round(force_n(leg)[axis], 3) + 0.0, "+.3f")

    return {f"{name} [N]": (">7", partial(cell, axis=axis)) for axis, name in enumerate(("fx", "fy", "fz"))}


def number_cell(value: float | None, form: str, scale: float = 1.0) -> str | Text:
    """Return a table cell with a number times `scale`; None and NaN give an empty cell."""
    return EMPTY_CELL if value is None or math.isnan(value) else format(value * scale, form)


def enum_words(name: str) -> str:
    """Return an enumeration member's name as lower-case words."""
    return name.lower().replace("_", " ")
