"""Checks of the converter board against what else says how it has to be: chip, pages, flexes, mount."""

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import shapely
from netgen import occ

from firmware_interface.chips import ad7147 as chip
from footsense.acquisition.boards.ad7147 import REFERENCE_INPUT, REFERENCE_PF
from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.package import PINS
from footsense.lab.fabrication.parts.flex import board_corner_mm, flexes
from footsense.lab.geometry import FootDesign
from tests.board.kicad_files import Board, Copper
from tests.lab.fabrication.readback import read_layer, read_step

ROOT = Path(__file__).parents[2]
BOARD_FOLDER = ROOT / "deploy" / "board"
#: Legs of the robot whose price is told.
_N_LEGS = 6
#: How far a pad or a hole may be from where its flex or its thread is [mm].
_PLACE_MM = 0.05
#: How far from the middle of a via the planes of other nets may end, with the necks between two [mm].
_SPARED_MM = 0.55
#: Net of each pin of the chip that is not open.
_CHIP = {f"CIN{k}": f"CIN{k}" for k in (*range(9), REFERENCE_INPUT)}
_CHIP |= {"GND": "GND", "VCC": "+3V0", "VDRIVE": "+3V3", "SDA": "SDA", "SCLK": "SCL"}
_CHIP |= {name: name for name in ("ACSHIELD", "BIAS", "ADD0", "ADD1")}
#: What each part with two ends is, and its nets.
_PARTS = {
    "C1": ("reference capacitor", {f"CIN{REFERENCE_INPUT}", "GND"}),
    "C2": ("capacitor at VCC", {"+3V0", "GND"}),
    "C3": ("capacitor at VDRIVE", {"+3V3", "GND"}),
    "C4": ("capacitor at BIAS", {"BIAS", "GND"}),
    "R1": ("pull-up", {"SDA", "+3V3"}),
    "R2": ("pull-up", {"SCL", "+3V3"}),
    "R3": ("strap", {"ADD0", "GND"}),
    "R4": ("strap", {"ADD1", "GND"}),
    "JP1": ("strap", {"ADD0", "+3V3"}),
    "JP2": ("strap", {"ADD1", "+3V3"}),
}


def pins_of_the_page() -> dict[str, int]:
    """Return the pin of each connection in the table of docs/wiring.md."""
    rows = re.findall(r"^\| ([A-Z][\w, ]*?\(.*?\)(?:, [A-Z]\w* \(\d+\))*) \|", _wiring(), re.MULTILINE)
    pins: dict[str, int] = {}
    for row in rows:
        for names, numbers in re.findall(r"([A-Z]\w*(?: to \w+)?) \(([\d, to]+)\)", row):
            first, _, last = names.partition(" to ")
            spans = [span.split(" to ") for span in numbers.split(", ")]
            found = [n for span in spans for n in range(int(span[0]), int(span[-1]) + 1)]
            start = int(re.sub(r"\D", "", first)) if last else 0
            pins |= {f"CIN{start + k}": n for k, n in enumerate(found)} if last else {names: found[0]}
    return pins


def _wiring() -> str:
    return (ROOT / "docs" / "wiring.md").read_text(encoding="utf-8")


def net_problems(board: Board) -> Iterator[str]:
    """Yield what is connected otherwise than docs/wiring.md and `firmware_interface` say."""
    yield from _chip_problems(board)
    for reference, (what, nets) in _PARTS.items():
        if set(board.nets(reference).values()) != nets:
            yield f"{reference}, {what}: has to connect {' and '.join(sorted(nets))}"
    if not board.values["C1"].startswith(f"{REFERENCE_PF:g}".replace(".", "p") + " C0G"):
        yield f"C1, reference capacitor: is {board.values['C1']}, has to be {REFERENCE_PF:g} pF, C0G"
    for bit, jumper in enumerate(("JP1", "JP2")):
        step = chip.ADDRESSES[1 << bit] - chip.ADDRESSES[0]
        if board.values[jumper] != f"+{step}":
            yield f"{jumper}, strap: says {board.values[jumper]}, adds {step} to the address"
    if list(board.nets("J3").values())[:4] != ["+3V3", "GND", "SDA", "SCL"]:
        yield "J3, cable of the leg: has to have 3.3 V, GND, SDA, SCL in this order"


def _chip_problems(board: Board) -> Iterator[str]:
    """Yield which pin of the chip is on a wrong net, or not open, and what else the shield is on."""
    pins, nets = pins_of_the_page(), board.nets("U1")
    for name, pin in pins.items():
        net = _CHIP.get(name)
        if net is None and len(board.on_net(nets[str(pin)])) > 1:
            yield f"U1 pin {pin}, {name}: is on {nets[str(pin)]}, has to be open"
        elif net is not None and nets[str(pin)] != net:
            yield f"U1 pin {pin}, {name}: is on {nets[str(pin)]}, has to be on {net}"
    shield = {pad for pad in board.on_net("ACSHIELD") if not pad.startswith("J1.")}
    if shield != {f"U1.{pins['ACSHIELD']}"}:
        yield f"ACSHIELD: is on {', '.join(sorted(shield))} beside the element flex, has to be on the chip alone"


def shield_problems(copper: Copper) -> Iterator[str]:
    """Yield which lines of elements lack the shield in the first inner layer or on the back, or have ground there.

    Beside a via, whose hole the planes spare, nothing is asked.
    """
    vias = shapely.MultiPoint(copper.vias).buffer(_SPARED_MM)
    for layer in ("In1.Cu", "B.Cu"):
        shield = shapely.union_all(
            [shapely.Polygon(area) for area in copper.planes.get(("ACSHIELD", layer), [])]
        )
        bare = {
            net
            for net, start, end in copper.tracks
            if net.startswith("CIN")
            and shapely.LineString([start, end]).difference(vias).difference(shield).length > _PLACE_MM
        }
        if bare:
            yield f"{', '.join(sorted(bare))}: without ACSHIELD behind it, in layer {layer}"


def connector_problems(board: Board, folder: Path, design: FootDesign) -> Iterator[str]:
    """Yield which contact of a flex, as `lab fabricate` drew it into a folder, meets a pad of another net.

    Seen from the front, a flex comes from below with its contacts up: to its left is the foot's right.
    """
    for flex, reference, middle_mm in zip(
        flexes(design, "ad7147"),
        ("J2", "J1"),
        (dimensions.BOARD_COMMON_FLEX_MM, dimensions.BOARD_ELEMENT_FLEX_MM),
        strict=True,
    ):
        if "top-side contacts" not in board.descriptions[reference]:
            yield f"{reference}: its contacts have to be above the flex: {board.descriptions[reference]}"
        pads = {
            round(pad.x_mm, 3): pad.net
            for pad in board.pads
            if pad.reference == reference and pad.number != "MP"
        }
        for shape in read_layer(folder / flex.name / "copper.gbr"):
            if not shape.pin_number:
                continue
            x = middle_mm - shape.polygon.centroid.y
            net = PINS["ad7147"][shape.net].removeprefix("AD7147: ")
            meets = [name for place, name in pads.items() if abs(place - x) < _PLACE_MM]
            if meets != [net]:
                found = meets[0] if meets else "no pad"
                yield f"{reference}: contact {shape.pin_number} of the {flex.name} meets {found}, has to meet {net}"


def mount_problems(board: Board, step: Path, design: FootDesign) -> Iterator[str]:
    """Yield what of edge and holes does not fit the mount in a STEP file."""
    mount = read_step(step)
    x, y, z = board_corner_mm(design.ball_radius_mm)
    body = occ.Box(
        occ.Pnt(x, y, z),
        occ.Pnt(x + dimensions.BOARD_THICKNESS_MM, y + board.width_mm, z + board.height_mm),
    )
    if (mount * body).mass > 1e-6 or mount.Distance(body) > _PLACE_MM:
        yield "edge: the board does not lie on the spacers of the mount"
    side = dimensions.BOARD_SIDE_MM
    if abs(board.width_mm - side) > _PLACE_MM or abs(board.height_mm - side) > _PLACE_MM:
        yield f"edge: {board.width_mm:g} x {board.height_mm:g} mm, has to be {side:g} x {side:g}"
    holes = [pad for pad in board.pads if pad.reference.startswith("H")]
    # A pin that is thinner than the thread by the tolerance is free, a ring within the spacer is full.
    core, ring = dimensions.MOUNT_CORE_MM / 2.0, dimensions.MOUNT_SPACER_DIAMETER_MM / 2.0
    depth = dimensions.MOUNT_SPACER_MM + dimensions.MOUNT_WALL_MM
    for hole in holes:
        start = occ.Pnt(x - depth, y + hole.x_mm, z + hole.y_mm)
        foot = occ.Pnt(x - dimensions.MOUNT_SPACER_MM, y + hole.x_mm, z + hole.y_mm)
        pin = occ.Cylinder(start, occ.X, r=core - _PLACE_MM, h=depth)
        spacer = occ.Cylinder(foot, occ.X, r=ring - _PLACE_MM, h=dimensions.MOUNT_SPACER_MM)
        spacer -= occ.Cylinder(foot, occ.X, r=core + _PLACE_MM, h=depth)
        if (mount * pin).mass > 1e-6 or (mount * spacer).mass < spacer.mass - 1e-6:
            yield f"{hole.reference}: no thread of the mount behind it"
        if hole.drill_mm != dimensions.BOARD_HOLE_DIAMETER_MM:
            yield f"{hole.reference}: {hole.drill_mm:g} mm, has to be {dimensions.BOARD_HOLE_DIAMETER_MM:g}"
    if len(holes) != len(dimensions.BOARD_HOLES_MM):
        yield f"{len(holes)} holes, the mount has {len(dimensions.BOARD_HOLES_MM)} threads"


def bill_of_materials(board: Board) -> list[dict[str, str]]:
    """Return the lines of the bill: deploy/board/parts.csv, with the references of each number on the board.

    Args:
        board: The board.

    Raises:
        AssertionError: A part has no line in parts.csv, or a cell of one is empty.
    """
    with (BOARD_FOLDER / "parts.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    lacking = set(board.numbers.values()) - {row["number"] for row in rows}
    assert not lacking, f"parts.csv: no line for {', '.join(sorted(lacking))}"
    lines = []
    for row in rows:
        assert all(row.values()), f"parts.csv: {row['number']}: a cell is empty"
        references = sorted(name for name, number in board.numbers.items() if number == row["number"])
        counts = {"references": " ".join(references) or "-", "quantity": str(len(references) or 1)}
        lines.append(counts | row)
    return lines


def price_words(lines: list[dict[str, str]]) -> dict[str, str]:
    """Return what docs/converter-board.md says of the prices of a bill [USD], by the name of its mark."""
    foot, order = (
        sum(float(line["price [USD]"]) * int(line["quantity"]) for line in lines if line["per"] == per)
        for per in ("foot", "order")
    )
    return {
        "foot": f"{foot:.2f}",
        "order": f"{order:.0f}",
        "six": f"{_N_LEGS * foot + order:.0f}",
        "estimates": str(sum("estimate" in line["kind of source"] for line in lines)),
        "lines": str(len(lines)),
    }
