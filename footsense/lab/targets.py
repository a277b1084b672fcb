"""Targets of the report: which figures of a page stand on the first page, and what is wanted of them.

They are the rows of `targets.yaml`, computed from a page's figures whenever its text is written: another target needs
no study anew.
"""

from collections.abc import Iterator, Mapping
from itertools import zip_longest
from pathlib import Path
from string import Formatter
from typing import Any

from msgspec import Struct

from footsense.strict_yaml import load


class _Limits(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Most and least of the numbers of a row, in the order in which they stand there; None for no limit."""

    most: tuple[float | None, ...] = ()
    least: tuple[float | None, ...] = ()


class _Target(_Limits, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A row: formats of the figure's name, of the limits, and of what was measured.

    Name and measured are filled by the figures of the page, or of a board of it; limits in their order. `boards` has
    the limits of each board of which something is wanted.
    """

    figure: str
    target: str
    measured: str
    boards: dict[str, _Limits] = {}


_TARGETS = load(Path(__file__).with_suffix(".yaml"), dict[str, tuple[_Target, ...]])


def rows_of_targets(figures: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the rows of a page: `figure`, `target`, `measured`, and `told`, the same with whether it is missed.

    Args:
        figures: Its figures by name, also those that its text derives of them; `boards` has those of each board, and
            `study` its name.
    """
    for row in _TARGETS.get(figures["study"], ()):
        for board, limits in (row.boards or {"": row}).items():
            own = figures["boards"][board] if board else figures
            pairs = list(zip_longest(limits.most, limits.least))
            fields = [field for _, field, _, _ in Formatter().parse(row.measured) if field]
            found = [Formatter().get_field(field, (), own)[0] for field in fields]
            met = all(
                (most is None or one <= most) and (least is None or one >= least)
                for one, (most, least) in zip(found, pairs, strict=False)
            )
            wanted = [
                least if most is None else most for most, least in pairs if (most, least) != (None, None)
            ]
            measured = row.measured.format_map(own)
            yield {
                "figure": (f"`{board}`: " if board else "") + row.figure.format_map(figures),
                "target": row.target.format(*wanted),
                "measured": measured,
                "told": measured if met else f"{measured}, **missed**",
            }
