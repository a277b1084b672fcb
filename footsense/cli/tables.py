"""One renderer for all commands: named values, as a table for people, or as JSON with the same names.

The suffix of a name is its unit: `age_ms` is the name in JSON, and `age [ms]` the heading of the table. What is not
known, None or NaN, is null in JSON and a dash in a table. Cells are text with rich's markup; rich is imported when a
table is drawn, so that a service without a terminal does without it.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from operator import methodcaller
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import click
import msgspec

from firmware_interface.can.codes import State
from footsense.foot.force_errors import GRAM_FORCE_N, ForceErrors
from footsense.leg_words import LegPhase, contact_word, phase_of, word_of

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

#: Columns of the terminal between two of a table.
_SPACE = 2
#: Columns in which no value is folded, for a file or another program.
_UNFOLDED_WIDTH = 1_000_000
#: Cell of an unknown value.
EMPTY_CELL = "[dim]-[/]"

_UNITS = {
    "c": "degC",
    "deg": "deg",
    "ff": "fF",
    "gf": "gf",
    "hz": "Hz",
    "mib": "MiB",
    "mm": "mm",
    "mn": "mN",
    "ms": "ms",
    "n": "N",
    "pf": "pF",
    "rel": "1",
    "s": "s",
    "um": "um",
    "us": "us",
}
_PHASE_STYLES = {
    LegPhase.ABSENT: "bold red",
    LegPhase.STARTING: "yellow",
    LegPhase.TARING: "yellow",
    LegPhase.VALID: "green",
    LegPhase.DEGRADED: "yellow",
    LegPhase.FAULTED: "bold red",
    LegPhase.STOPPED: "dim",
}

Row = TypeVar("Row")


@dataclass(frozen=True)
class Column(Generic[Row]):
    """One named value of every row.

    Attributes:
        name: Name in JSON, its unit as suffix; "baseline.mean_ff" is in the group `baseline`. Empty: in tables alone.
        value: The value of a row; None and NaN are unknown.
        form: Format of a cell, such as ">7.3f": alignment, least width, format of a number. Empty: in JSON alone.
        titles: Headings; several for a value of several parts. None: that of the name.
        style: Style of the cell of a row; None for a plain one.
        cell: Text of the cell, with markup; None for the value in the form and style.
        worth: A terminal that is too narrow loses the columns of the least worth first, those of one worth together.
    """

    name: str
    value: Callable[[Row], Any]
    form: str = ""
    titles: tuple[str, ...] | None = None
    style: Callable[[Row], str] | None = None
    cell: Callable[[Row], "RenderableType"] | None = None
    worth: int = 9

    @property
    def headings(self) -> tuple[str, ...]:
        """Headings in a table; none if the value is in JSON alone."""
        if not self.form:
            return ()
        return (heading(self.name.rpartition(".")[2]),) if self.titles is None else self.titles

    @property
    def width(self) -> int:
        """Width in a table, with the space behind it; 0 if the value is in JSON alone."""
        return sum(max(self.least_width, len(title)) + _SPACE for title in self.headings)

    @property
    def least_width(self) -> int:
        """Least width of its cells, of the form."""
        found = re.search(r"\d+", self.form)
        return int(found[0]) if found else 0

    def cells(self, row: Row) -> list["RenderableType"]:
        """Return the cells of a row, one under each heading."""
        if self.cell is not None:
            return [self.cell(row)]
        value = self.value(row)
        parts: Sequence[object] = value if isinstance(value, tuple | list) else [value] * len(self.headings)
        texts = [value_text(part, self.form) for part in parts[: len(self.headings)]]
        style = self.style(row) if self.style else ""
        return [f"[{style}]{text}[/]" if style else text for text in texts]


def left_out_text(columns: Iterable[Column[Row]], width: int) -> str:
    """Return in words which columns do not fit into a width; empty if all do."""
    every = [column for column in columns if column.form]
    shown = fitting(every, width)
    titles = [title for column in every if column not in shown for title in column.headings]
    return f"a wider terminal shows {', '.join(titles)}, too" if titles else ""


def fitting(columns: Iterable[Column[Row]], width: int) -> list[Column[Row]]:
    """Return the columns that fit into a width, without those of the least worth."""
    shown = [column for column in columns if column.form]
    while sum(column.width for column in shown) - _SPACE > width:
        least = min(column.worth for column in shown)
        if not (kept := [column for column in shown if column.worth > least]):
            break
        shown = kept
    return shown


def table(columns: Iterable[Column[Row]], rows: Iterable[Row]) -> "Table":
    """Return a table with a line for each row, of those columns that have a form."""
    from rich.markup import escape
    from rich.table import Table

    shown = [column for column in columns if column.form]
    drawn = Table(box=None, pad_edge=False, padding=(0, _SPACE // 2))
    for column in shown:
        for title in column.headings:
            drawn.add_column(
                escape(title),
                justify="right" if column.form[0] == ">" else "left",
                min_width=column.least_width or None,
                no_wrap=True,
            )
    for row in rows:
        drawn.add_row(*(cell for column in shown for cell in column.cells(row)))
    return drawn


def json_row(columns: Iterable[Column[Row]], row: Row) -> dict[str, Any]:
    """Return the values of a row by their names, numbers to six digits, codes by name; an unknown group is None."""
    values: dict[str, Any] = {}
    groups: dict[str, dict[str, Any]] = {}
    for column in columns:
        group, _, name = column.name.rpartition(".")
        value = _plain(column.value(row)) if name else None
        if group:
            groups.setdefault(group, {})[name] = value
            values[group] = (
                groups[group] if any(item is not None for item in groups[group].values()) else None
            )
        elif name:
            values[name] = value
    return values


def echo_json(values: object, indent: int = 2) -> None:
    """Print values as JSON: NaN as null, numpy values as plain ones; on one line if `indent` is 0."""
    click.echo(
        msgspec.json.format(msgspec.json.encode(values, enc_hook=methodcaller("tolist")), indent=indent)
    )


def figures_table(figures: Mapping[str, Any]) -> "Table":
    """Return figures, each on a line after its name; those that are unknown or empty are left out."""
    from rich.table import Table

    lines = Table(box=None, show_header=False, padding=(0, 2, 0, 0), pad_edge=False)
    lines.add_column(style="bold", no_wrap=True)
    lines.add_column(overflow="fold")
    for name, value in figures.items():
        parts = value if isinstance(value, Mapping) else {}
        if any(isinstance(part, Mapping) for part in parts.values()):
            texts = {f"{name}, {key}": _figure_text(part) for key, part in parts.items()}
        else:
            texts = {name: _figure_text(value)}
        for label, text in texts.items():
            if text:
                lines.add_row(escaped(heading(label)), escaped(text))
    return lines


def echo_figures(figures: Mapping[str, Any], *, as_json: bool) -> None:
    """Print figures: as JSON, or each on a line after its name."""
    if as_json:
        echo_json(figures)
        return
    from rich.console import Console

    console = Console(highlight=False)
    if console.is_terminal:
        console.print(figures_table(figures))
        return
    with console.capture() as lines:
        console.width = _UNFOLDED_WIDTH
        console.print(figures_table(figures))
    click.echo("\n".join(line.rstrip() for line in lines.get().splitlines()))


def errors_text(errors: ForceErrors) -> str:
    """Return force errors in words."""
    mean_mn, p95_mn = (1e3 * GRAM_FORCE_N * gf for gf in (errors.magnitude_gf, errors.magnitude_p95_gf))
    return (
        f"direction {errors.direction_deg:.1f} deg, p95 {errors.direction_p95_deg:.1f} deg; "
        f"magnitude {mean_mn:.0f} mN, p95 {p95_mn:.0f} mN; of {errors.n} loads"
    )


def heading(name: str) -> str:
    """Return the name of a value as words, its unit in brackets; the n_ of a count is left out.

    Example:
        >>> heading("direction_error_deg"), heading("cycles")
        ('direction error [deg]', 'cycles')
    """
    words, _, unit = name.removeprefix("n_").rpartition("_")
    if not words or unit not in _UNITS:
        return name.removeprefix("n_").replace("_", " ")
    return f"{words.replace('_', ' ')} [{_UNITS[unit]}]"


def value_text(value: object, form: str) -> str:
    """Return a value as a cell: a number in its format, a code in words, a dash for what is not known.

    Example:
        >>> value_text(-0.0004, ">+z7.3f"), value_text(State.NO_BASELINE, "<9"), value_text(float("nan"), ">7.3f")
        (' +0.000', 'no baseline', '[dim]-[/]')
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return EMPTY_CELL
    if isinstance(value, IntEnum):
        return word_of(value)
    return escaped(value) if isinstance(value, str) else format(value, form)


def styled(text: str, style: str) -> str:
    """Return a text as a cell in a style of rich; plain if the style is empty."""
    return f"[{style}]{escaped(text)}[/]" if style else escaped(text)


def escaped(text: str) -> str:
    """Return a text as markup that shows it as it is."""
    return text.replace("[", "\\[")


def state_column(state: Callable[[Row], State | None]) -> Column[Row]:
    """Return the column of a leg's state, in the colour of its operating phase."""

    def style(row: Row) -> str:
        found = state(row)
        return "" if found is None else _PHASE_STYLES[phase_of(found)]

    return Column("state", state, "<15", style=style, worth=8)


def contact_column(contact: Callable[[Row], bool | None]) -> Column[Row]:
    """Return the column of whether a foot is in contact."""
    style = {None: "dim", True: "cyan", False: ""}
    return Column(
        "contact",
        contact,
        "<7",
        ("foot",),
        cell=lambda row: styled(contact_word(contact(row)) or "-", style[contact(row)]),
        worth=6,
    )


def force_columns(name: str, force_n: Callable[[Row], Sequence[float]]) -> list[Column[Row]]:
    """Return the columns of a force [N] in its three components; one that rounds to zero has no sign."""
    parts: list[Column[Row]] = [
        Column("", lambda row: force_n(row)[0:2], ">+z7.3f", ("fx [N]", "fy [N]"), worth=5),
        Column("", lambda row: force_n(row)[2], ">+z7.3f", ("fz [N]",), worth=7),
    ]
    return [Column(name, force_n), *parts]


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever JSON has
    if isinstance(value, IntEnum):
        return value.name.lower()
    if isinstance(value, float):
        return None if math.isnan(value) else float(f"{value:.6g}") + 0.0
    return [_plain(part) for part in value] if isinstance(value, tuple | list) else value


def _figure_text(value: object) -> str:
    if isinstance(value, Mapping):
        parts = {heading(name): _figure_text(part) for name, part in value.items()}
        return ", ".join(f"{name} {text}" for name, text in parts.items() if text)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, list | tuple):
        return ", ".join(filter(None, map(_figure_text, value)))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
