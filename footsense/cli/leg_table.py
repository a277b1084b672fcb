"""Tables with one row per leg, at most 80 columns wide: the same columns and colours in every command."""

import math
from collections.abc import Iterable

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from firmware_interface.can_codes import Phase, State, phase_of

_PHASE_STYLES = {
    Phase.ABSENT: "bold red",
    Phase.STARTING: "yellow",
    Phase.TARING: "yellow",
    Phase.VALID: "green",
    Phase.DEGRADED: "yellow",
    Phase.FAULTED: "bold red",
    Phase.STOPPED: "dim",
}

#: Cell without a value.
EMPTY = Text("-", "dim")

#: Columns of `force_cells`.
FORCE_COLUMNS = {f"{axis} [N]": ">7" for axis in ("fx", "fy", "fz")}


def leg_table(columns: dict[str, str]) -> Table:
    """Return an empty table whose first column is the leg.

    Args:
        columns: Alignment and least width of every other column by its title, such as ">7".
    """
    table = Table(box=None, pad_edge=False, padding=(0, 1))
    table.add_column("leg")
    for title, form in columns.items():
        table.add_column(
            escape(title),
            justify="right" if form[0] == ">" else "left",
            min_width=int(form[1:]),
            no_wrap=True,
        )
    return table


def state_text(state: State) -> Text:
    """Return the state of a leg in the colour of its phase."""
    return Text(words(state.name), _PHASE_STYLES[phase_of(state)])


def force_cells(force_n: Iterable[float] | None) -> list[str | Text]:
    """Return the components of a force [N]; one that rounds to zero has no sign, which would flicker.

    Example:
        >>> force_cells((-0.0004, -0.0006, 1.0))
        ['+0.000', '-0.001', '+1.000']
    """
    return [EMPTY] * 3 if force_n is None else [f"{round(value, 3) + 0.0:+.3f}" for value in force_n]


def number(value: float, form: str) -> str | Text:
    """Return a number in the format `form`, NaN as an empty cell."""
    return EMPTY if math.isnan(value) else format(value, form)


def words(name: str) -> str:
    """Return the name of an enum's member as words."""
    return name.lower().replace("_", " ")
