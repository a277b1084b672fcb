"""The converter board fits chip, pages, flexes and mount, and a board that does not is found."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from footsense.lab.fabrication.package import write_fabrication_package
from tests.board.__main__ import rule_problems
from tests.board.checks import (
    BOARD_FOLDER,
    bill_of_materials,
    connector_problems,
    mount_problems,
    net_problems,
    pins_of_the_page,
    price_words,
    shield_problems,
)
from tests.board.kicad_files import read_board, read_copper
from tests.lab.released import FOOT_DESIGN

pytestmark = pytest.mark.lab

PCB = (BOARD_FOLDER / "converter.kicad_pcb").read_text(encoding="utf-8")
needs_kicad = pytest.mark.skipif(shutil.which("kicad-cli") is None, reason="KiCad is not installed")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("foot")
    write_fabrication_package(FOOT_DESIGN, folder)
    return folder


def problems(pcb: Path, folder: Path) -> list[str]:
    board = read_board(pcb)
    return [
        *net_problems(board),
        *shield_problems(read_copper(pcb)),
        *connector_problems(board, folder, FOOT_DESIGN),
        *mount_problems(board, folder / "step" / "board-mount.step", FOOT_DESIGN),
    ]


def of_part(reference: str, old: str, new: str | Callable[[re.Match[str]], str]) -> str:
    """Return the board with all matches in one part replaced, at least one."""
    parts = re.split(r"(?=\n\t\(footprint )", PCB)
    (k,) = (k for k, part in enumerate(parts) if f'(property "Reference" "{reference}"' in part)
    parts[k], n = re.subn(old, new, parts[k], flags=re.DOTALL)
    assert n > 0
    return "".join(parts)


def negated(match: re.Match[str]) -> str:
    return f"{match[1]}{-float(match[2]):g}"


def shield_at_ground() -> str:
    (ground,) = re.findall(r'\(net (\d+) "GND"\)', PCB.partition("(footprint")[0])
    text, n = re.subn(r'\(net \d+\)(\s+\(net_name "/ACSHIELD"\)\s+\(layer "In1)', rf"(net {ground})\1", PCB)
    assert n == 1
    return text


def test_the_table_of_pins_is_complete() -> None:
    pins = pins_of_the_page()
    assert sorted(pins.values()) == list(range(1, 25))
    assert (pins["CIN0"], pins["CIN6"], pins["CIN12"], pins["ACSHIELD"], pins["SCLK"]) == (19, 1, 7, 8, 15)


def test_the_board_fits_chip_pages_flexes_and_mount(folder: Path) -> None:
    assert problems(BOARD_FOLDER / "converter.kicad_pcb", folder) == []


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (lambda: PCB.replace("/ADD0", "x").replace("/ADD1", "/ADD0").replace('"x"', '"/ADD1"'), "U1 pin 14, ADD0"),
        (lambda: of_part("JP1", '"\\+1"', '"+2"'), "JP1, strap: says .2, adds 1"),
        (lambda: of_part("J1", '(pad "7".*?)"/ACSHIELD"', r'\1"GND"'), "J1: contact 15 .*GND"),
        (shield_at_ground, "CIN0, .*CIN8: without ACSHIELD behind it, in layer In1.Cu"),
        (lambda: of_part("C4", '"GND"', '"/ACSHIELD"'), "ACSHIELD: is on C4.2, U1.8"),
        (lambda: of_part("C1", "4p7", "47p"), "C1, reference capacitor: is 47p"),
        (lambda: of_part("R1", r'"\+3V3"', '"+3V0"'), "R1, pull-up"),
        (lambda: of_part("U1", '(pad "4".*?)"unconnected[^"]*"', r'\1"GND"'), "U1 pin 4, CIN9: .*open"),
        (lambda: of_part("H1", r"\(at 102.2 62.2\)", "(at 102.7 62.2)"), "H1: no thread"),
        (lambda: of_part("H2", r"\(drill 2.2\)", "(drill 1.6)"), "H2: 1.6 mm"),
        (lambda: PCB.replace("(end 125 84.5)", "(end 125.5 84.5)"), "edge: 25.5 x 25 mm"),
        (lambda: of_part("J1", r'(\(pad "\d+" \w+ \w+\s+\(at )([-\d.]+)', negated), "J1: contact 2 .*CIN2, .*CIN0"),
        (lambda: of_part("J1", "top-side", "bottom-side"), "J1: its contacts have to be above the flex"),
    ],
)  # fmt: skip
def test_a_wrong_board_is_found(spoil: Callable[[], str], line: str, folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "converter.kicad_pcb"
    path.write_text(spoil(), encoding="utf-8")
    assert re.search(line, "\n".join(problems(path, folder)))


def test_the_page_has_the_prices_of_the_bill() -> None:
    page = (BOARD_FOLDER.parents[1] / "docs" / "converter-board.md").read_text(encoding="utf-8")
    words = price_words(bill_of_materials(read_board(BOARD_FOLDER / "converter.kicad_pcb")))
    assert dict(re.findall(r"<!--board (\w+)-->(.*?)<!--end-->", page)) == words


def test_a_part_without_a_line_in_the_bill_is_found(tmp_path: Path) -> None:
    path = tmp_path / "converter.kicad_pcb"
    path.write_text(of_part("U2", "LP5907MFX-3.0/NOPB", "XYZ"), encoding="utf-8")
    with pytest.raises(AssertionError, match=r"parts\.csv: no line for XYZ"):
        bill_of_materials(read_board(path))


@needs_kicad
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "old", "new", "line"),
    [
        ("kicad_pcb", r"\n\t\(segment.*?\n\t\)", "", "Missing connection"),
        ("kicad_pcb", r'\(pad "1" smd.*?"/SDA"', lambda m: m[0].replace("/SDA", "/SCL"), "net"),
        ("kicad_sch", r'\(label "CIN12"', '(label "CIN11"', "CIN1[12]"),
    ],
)
def test_kicads_rules_find_a_fault(name: str, old: str, new: str, line: str, tmp_path: Path) -> None:
    shutil.copytree(BOARD_FOLDER, tmp_path / "board")
    path = tmp_path / "board" / f"converter.{name}"
    text, n = re.subn(old, new, path.read_text(encoding="utf-8"), count=1, flags=re.DOTALL)
    assert n == 1
    path.write_text(text, encoding="utf-8")
    assert re.search(line, "\n".join(rule_problems(tmp_path / "board")))
