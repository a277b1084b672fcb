"""Every number that somebody has chosen on the robot's side is in the table of `docs/reference/numbers.md`."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

from firmware_interface.chips import fdc1004
from footsense.estimation.settings import READING_NOISE_PF

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "numbers.md"
#: Modules by their names below `footsense`.
SOURCES = {
    ".".join(path.relative_to(ROOT / "footsense").with_suffix("").parts): path.read_text(encoding="utf-8")
    for room in ("estimation", "foot", "daemon")
    for path in sorted((ROOT / "footsense" / room).rglob("*.py"))
}
#: Numbers of the table; fewer are welcome.
MOST = 51
#: Counts, halves, and the degrees of a circle.
STRUCTURE = {0, 1, 2, 3, 0.5, 90, 360}
#: Calls whose arguments are a layout, limits of a schema, digits, or the name of a percentile.
LAYOUTS = {"Meta", "Signal", "bytes", "int", "slice", "reshape", "round", "percentile"}
#: Constants of nature, of mathematics, of formats and of other programs.
NOT_CHOSEN = {
    *(
        "EPS0_PF_UM_PER_MM2",
        "GRAM_FORCE_N",
        "_GRAVITY_M_PER_S2",
        "_UM_PER_MM",
        "_NS_PER_S",
        "_GOLDEN_ANGLE_RAD",
        "_MEDIAN_OVER_QUARTILE",
        "_FATAL",
        "_MCL_ONFAULT",
        "_PR_SET_TIMERSLACK",
        "_CAP_IPC_LOCK",
    ),
    *("COORDINATES", "CELLS_PER_SIDE", "_N_HEX_DIGITS"),
}
UNITS = {*(10.0**power for power in range(-12, 13, 3)), 100.0, 1024}


def nodes_that_are_no_numbers(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield indices and slices, arguments of layouts, powers of two, units, and factors of formulas."""
    for node in ast.walk(tree):
        match node:
            case ast.Subscript(slice=index) if (
                not isinstance(node.value, ast.Name) or node.value.id != "Annotated"
            ):
                yield from ast.walk(index)
            case ast.Call(func=function) if ast.unparse(function).rpartition(".")[2] in LAYOUTS:
                yield from ast.walk(node)
            case ast.BinOp(op=ast.LShift()):
                yield from ast.walk(node)
            case ast.BinOp(op=ast.Mult() | ast.Div(), left=left, right=right):
                yield from (side for side in (left, right) if getattr(side, "value", None) in {*UNITS, 4})


def chosen(source: str) -> dict[str, list[float]]:
    """Return the chosen numbers of a module by the constant, or the default of a class, that has them; "" for none."""
    tree = ast.parse(source)
    constants: dict[ast.AST, str] = {}
    bodies = [tree.body, *(node.body for node in ast.walk(tree) if isinstance(node, ast.ClassDef))]
    for statement in chain.from_iterable(bodies):
        match statement:
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                pairs = list(zip(names, values, strict=True))
            case (
                ast.Assign(targets=[name], value=value) | ast.AnnAssign(target=name, value=ast.AST() as value)
            ):
                pairs = [(name, value)]
            case _:
                continue
        constants |= {part: ast.unparse(name) for name, value in pairs for part in ast.walk(value)}
    no_numbers = set(nodes_that_are_no_numbers(tree))
    found = defaultdict[str, list[float]](list)
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, int | float)
            and not isinstance(node.value, bool)
            and node.value not in STRUCTURE
            and node not in no_numbers
            and not (ast.get_source_segment(source, node) or "").startswith("0x")
            and constants.get(node) not in NOT_CHOSEN
        ):
            found[constants.get(node, "")].append(node.value)
    return found


def test_the_table_has_every_chosen_number() -> None:
    """And no other: with its value, and as a constant that has a name."""
    rows = re.findall(r"^\| `(\S+)` \| ([^|]+) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    table = {name: [abs(float(value)) for value in values.split(",")] for name, values in rows}
    code = {
        f"{module}.{name}": sorted(values)
        for module, source in SOURCES.items()
        for name, values in chosen(source).items()
    }
    assert {name: sorted(values) for name, values in table.items()} == code
    assert sum(map(len, code.values())) <= MOST


def test_noise_of_a_reading_is_that_of_the_data_sheet() -> None:
    assert pytest.approx(1e-3 * fdc1004.RATES[400].noise_ff) == READING_NOISE_PF
