"""Reader of a KiCad board: pads with their nets, holes, edge, and where each is."""

import math
import re
from pathlib import Path
from typing import NamedTuple, TypeAlias

#: A list of an s-expression: its name, then words and lists.
Node: TypeAlias = "list[str | Node]"

Point: TypeAlias = tuple[float, float]

_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[()]|[^\s()"]+')


class Pad(NamedTuple):
    """A pad, seen from the front; places are from the lower left corner of the board [mm].

    Attributes:
        reference: Its part.
        number: Its number; empty where it is none.
        net: Its net without the path of its sheet; empty for none.
        x_mm: To the right.
        y_mm: Up.
        drill_mm: Diameter of its hole, 0 for none.
    """

    reference: str
    number: str
    net: str
    x_mm: float
    y_mm: float
    drill_mm: float


class Copper(NamedTuple):
    """Tracks, vias and planes of a board, places as in its file [mm].

    Attributes:
        tracks: Net, start and end of each track.
        vias: Middle of each via.
        planes: Filled areas by net and layer, each a list of points.
    """

    tracks: tuple[tuple[str, Point, Point], ...]
    vias: tuple[Point, ...]
    planes: dict[tuple[str, str], list[list[Point]]]


class Board(NamedTuple):
    """A board.

    Attributes:
        width_mm: Width of its edge.
        height_mm: Its height.
        pads: All pads.
        values: Value of each part.
        descriptions: What KiCad's library says of the footprint of each part.
        numbers: Manufacturer's number of each part that is bought.
    """

    width_mm: float
    height_mm: float
    pads: tuple[Pad, ...]
    values: dict[str, str]
    descriptions: dict[str, str]
    numbers: dict[str, str]

    def nets(self, reference: str) -> dict[str, str]:
        """Return the net of each numbered pad of a part."""
        return {pad.number: pad.net for pad in self.pads if pad.reference == reference and pad.number}

    def on_net(self, net: str) -> set[str]:
        """Return the pads of a net, such as `U1.7`."""
        return {f"{pad.reference}.{pad.number}" for pad in self.pads if pad.net == net}


def read_board(path: Path) -> Board:
    """Return the board of a `.kicad_pcb` file, all of whose parts are on the front."""
    root = _parse(path.read_text(encoding="utf-8"))
    ends = [
        _numbers(_child(shape, name))
        for kind in ("gr_line", "gr_arc")
        for shape in _children(root, kind)
        if _text(shape, "layer") == "Edge.Cuts"
        for name in ("start", "end")
    ]
    left, right = min(x for x, _ in ends), max(x for x, _ in ends)
    top, bottom = min(y for _, y in ends), max(y for _, y in ends)
    pads: list[Pad] = []
    values, descriptions, numbers = {}, {}, {}
    for part in _children(root, "footprint"):
        named = {str(node[1]): str(node[2]) for node in _children(part, "property")}
        reference = named["Reference"]
        values[reference], descriptions[reference] = named["Value"], _text(part, "descr")
        if "MPN" in named:
            numbers[reference] = named["MPN"]
        x, y, *turn = _numbers(_child(part, "at"))
        angle = math.radians(turn[0] if turn else 0.0)
        for pad in _children(part, "pad"):
            u, v = _numbers(_child(pad, "at"))[:2]
            drill, net = _children(pad, "drill"), _children(pad, "net")
            pads.append(
                Pad(
                    reference,
                    str(pad[1]),
                    str(net[0][2]).removeprefix("/") if net else "",
                    x + u * math.cos(angle) + v * math.sin(angle) - left,
                    bottom - (y - u * math.sin(angle) + v * math.cos(angle)),
                    float(str(drill[0][1])) if drill else 0.0,
                )
            )
    return Board(right - left, bottom - top, tuple(pads), values, descriptions, numbers)


def read_copper(path: Path) -> Copper:
    """Return tracks, vias and planes of a `.kicad_pcb` file."""
    root = _parse(path.read_text(encoding="utf-8"))
    nets = {str(net[1]): str(net[2]).removeprefix("/") for net in _children(root, "net")}
    tracks = tuple(
        (nets[_text(track, "net")], _point(_child(track, "start")), _point(_child(track, "end")))
        for track in _children(root, "segment")
    )
    planes: dict[tuple[str, str], list[list[Point]]] = {}
    for zone in _children(root, "zone"):
        for area in _children(zone, "filled_polygon"):
            corners = [_point(corner) for corner in _children(_child(area, "pts"), "xy")]
            planes.setdefault((nets[_text(zone, "net")], _text(area, "layer")), []).append(corners)
    return Copper(tracks, tuple(_point(_child(via, "at")) for via in _children(root, "via")), planes)


def _parse(text: str) -> Node:
    stack: list[Node] = [[]]
    for token in _TOKEN.findall(text):
        if token == "(":
            stack.append([])
        elif token == ")":
            node = stack.pop()
            stack[-1].append(node)
        else:
            stack[-1].append(token[1:-1].replace('\\"', '"') if token.startswith('"') else token)
    (root,) = stack[0]
    assert isinstance(root, list)
    return root


def _children(node: Node, name: str) -> list[Node]:
    return [each for each in node if isinstance(each, list) and each and each[0] == name]


def _child(node: Node, name: str) -> Node:
    return _children(node, name)[0]


def _text(node: Node, name: str) -> str:
    return str(_child(node, name)[1])


def _point(node: Node) -> Point:
    x, y = _numbers(node)[:2]
    return x, y


def _numbers(node: Node) -> list[float]:
    return [float(str(each)) for each in node[1:]]
