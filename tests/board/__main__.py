"""`make board`: checks the converter board of `deploy/board`, and writes what a maker of boards needs.

Electrical and design rules, schematic against board, nets against chip and pages, connectors against the flexes, holes
against the mount. Then Gerber, drill and placement files, bill of materials, schematic and pictures, in build/board. It
needs KiCad 9, which Debian 12 has in its backports; where it cannot be had, one line says so, and the exit code is 0,
because CI runs it everywhere. `ARGS=--pictures` renews the pictures of docs/converter-board.md.
"""

import csv
import json
import os
import re
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from footsense.lab.fabrication.package import write_fabrication_package
from tests.board.checks import (
    BOARD_FOLDER,
    ROOT,
    bill_of_materials,
    connector_problems,
    mount_problems,
    net_problems,
    price_words,
    shield_problems,
)
from tests.board.kicad_files import read_board, read_copper
from tests.lab.released import FOOT_DESIGN
from tests.support.made_once import LackingError, fetch, run

_OUT = ROOT / "build" / "board"
_PICTURES = ROOT / "docs" / "images"
_KICAD, _LEAST_VERSION = Path("/usr/share/kicad"), 9
_BACKPORTS = "deb http://deb.debian.org/debian bookworm-backports main\n"
_SIDE_PIXELS = "1000"


def install_kicad() -> None:
    """Install KiCad 9 from the backports of Debian 12, if it is not there.

    Raises:
        LackingError: It cannot be had; with the reason.
    """
    libraries = [_KICAD / name for name in ("template/sym-lib-table", "symbols", "footprints")]
    version = run("kicad-cli", "version") if shutil.which("kicad-cli") else "0"
    if int(version.partition(".")[0]) >= _LEAST_VERSION and all(path.exists() for path in libraries):
        return
    release = Path("/etc/os-release")
    if not release.exists() or "VERSION_CODENAME=bookworm" not in release.read_text(encoding="utf-8"):
        raise LackingError("there is no KiCad 9, and it can be installed only on Debian 12")
    if os.geteuid() != 0:
        raise LackingError("there is no KiCad 9, and it needs root to be installed")
    print("installing KiCad 9", flush=True)
    Path("/etc/apt/sources.list.d/bookworm-backports.list").write_text(_BACKPORTS, encoding="utf-8")
    apt = ("env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "--quiet=2", "-o", "DPkg::Lock::Timeout=120")
    fetch(*apt, "update")
    packages = ("kicad", "kicad-symbols", "kicad-footprints")
    fetch(
        *apt,
        "install",
        "--yes",
        "--no-install-recommends",
        "--target-release",
        "bookworm-backports",
        *packages,
    )


def kicad(*arguments: str | Path) -> None:
    """Run kicad-cli with the libraries that KiCad brings, and no settings of a user.

    Raises:
        RuntimeError: It failed; with its output.
    """
    with TemporaryDirectory(prefix="kicad-") as settings:
        tables = Path(settings) / "9.0"
        tables.mkdir()
        for name in ("sym-lib-table", "fp-lib-table"):
            shutil.copy(_KICAD / "template" / name, tables)
        run("env", f"KICAD_CONFIG_HOME={settings}", "kicad-cli", *arguments)


def rule_problems(folder: Path) -> list[str]:
    """Return what breaks KiCad's rules, of all severities, in the project of a folder."""
    with TemporaryDirectory() as out:
        electrical, design = Path(out) / "erc.json", Path(out) / "drc.json"
        options = ("--severity-all", "--format", "json", "--output")
        kicad("sch", "erc", *options, electrical, folder / "converter.kicad_sch")
        kicad("pcb", "drc", "--schematic-parity", *options, design, folder / "converter.kicad_pcb")
        found = [v for sheet in json.loads(electrical.read_text())["sheets"] for v in sheet["violations"]]
        report = json.loads(design.read_text())
    for kind in ("violations", "unconnected_items", "schematic_parity"):
        found += report[kind]
    return [
        f"{v['severity']}: {v['description']}: {'; '.join(item['description'] for item in v['items'])}"
        for v in found
    ]


def file_problems(folder: Path) -> list[str]:
    """Return what the board of a folder contradicts: chip, pages, flexes, mount."""
    board = read_board(folder / "converter.kicad_pcb")
    with TemporaryDirectory() as out:
        write_fabrication_package(FOOT_DESIGN, Path(out))
        return [
            *net_problems(board),
            *shield_problems(read_copper(folder / "converter.kicad_pcb")),
            *connector_problems(board, Path(out), FOOT_DESIGN),
            *mount_problems(board, Path(out) / "step" / "board-mount.step", FOOT_DESIGN),
        ]


def write_files() -> None:
    """Write what a maker of boards needs, and print the price of six legs."""
    shutil.rmtree(_OUT, ignore_errors=True)
    gerbers = _OUT / "gerber"
    gerbers.mkdir(parents=True)
    board, schematic = BOARD_FOLDER / "converter.kicad_pcb", BOARD_FOLDER / "converter.kicad_sch"
    kicad("pcb", "export", "gerbers", "--output", f"{gerbers}/", board)
    kicad("pcb", "export", "drill", "--output", f"{gerbers}/", "--excellon-separate-th", board)
    shutil.make_archive(str(_OUT / "gerber"), "zip", gerbers)
    kicad(
        "pcb", "export", "pos", "--format", "csv", "--units", "mm", "--side", "front", "--use-drill-file-origin",
        "--output", _OUT / "placement.csv", board,
    )  # fmt: skip
    kicad("sch", "export", "pdf", "--output", _OUT / "schematic.pdf", schematic)
    lines = bill_of_materials(read_board(board))
    with (_OUT / "bill-of-materials.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, lines[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
    words = price_words(lines)
    print(f"board: {words['foot']} USD a foot, {words['order']} an order; six legs {words['six']} USD")


def write_pictures(folder: Path) -> None:
    """Write pictures of both sides, of the places of the parts, and of the schematic into a folder."""
    board = BOARD_FOLDER / "converter.kicad_pcb"
    for side, name in (("top", "front"), ("bottom", "back")):
        size = ("--width", _SIDE_PIXELS, "--height", _SIDE_PIXELS, "--zoom", "0.9")
        kicad(
            "pcb", "render", "--side", side, *size, "--output", folder / f"converter-board-{name}.png", board
        )
    with TemporaryDirectory() as out:
        kicad(
            "sch", "export", "svg", "--exclude-drawing-sheet", "--no-background-color", "--output", out,
            BOARD_FOLDER / "converter.kicad_sch",
        )  # fmt: skip
        kicad(
            "pcb", "export", "svg", "--mode-single", "--page-size-mode", "2", "--exclude-drawing-sheet",
            "--layers", "Edge.Cuts,F.Mask,F.Fab", "--output", Path(out) / "parts.svg", board,
        )  # fmt: skip
        # Size on the page, and what is drawn of the sheet [mm].
        for name, file, frame in (
            ("schematic", "converter", 'width="1050" height="540" viewBox="10 18 280 144"'),
            ("parts", "parts", 'width="500" height="500" viewBox="0 0 25.6 25.6"'),
        ):
            text = (Path(out) / f"{file}.svg").read_text(encoding="utf-8")
            # Without the date, and with hundredths of a millimetre: half as long.
            text = re.sub(r"<title>.*?</title>", "", text, flags=re.DOTALL)
            text = re.sub(r"(\.\d\d)\d+", r"\1", text)
            text = re.sub(r'width="[^"]*" height="[^"]*" viewBox="[^"]*"', frame, text, count=1)
            (folder / f"converter-board-{name}.svg").write_text(text, encoding="utf-8")


def main() -> int:
    """Make what is missing, check, write, and return the exit code."""
    try:
        install_kicad()
    except LackingError as error:
        print(f"board: not checked: {error}")
        return 0
    problems = rule_problems(BOARD_FOLDER) + file_problems(BOARD_FOLDER)
    print("\n".join(problems or ["board: no error of rules, nets, connectors and holes"]))
    if not problems:
        write_files()
        write_pictures(_PICTURES if "--pictures" in sys.argv else _OUT)
        print(f"board: {_OUT.relative_to(ROOT)}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
