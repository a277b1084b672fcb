"""Exploded view of the parts, drawn from the STEP, Gerber and DXF files."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colors
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from netgen import occ
from netgen.meshing import MeshingStep

from footsense.frames import Vector
from footsense.lab.fabrication.parts import sheets, solids
from footsense.lab.fabrication.parts.flex import Flex
from footsense.lab.fabrication.parts.readback import read_layer, read_outline
from footsense.lab.geometry import FootDesign

_COPPER, _POLYMER, _LAYER, _PDMS, _RUBBER, _METAL = (
    "#c9752a",
    "#f0dfae",
    "#a9d5b0",
    "#bcd8e8",
    "#7d8890",
    "#d0d0d0",
)
#: Direction of the light, and light of a face that is turned away from it [1].
_LIGHT, _SHADE = np.array([0.9, 0.1, 0.7]), 0.4
_DPI = 110
#: Direction of the view [deg]: both tails come forward, both ears lie behind.
_AZIMUTH_DEG, _ELEVATION_DEG = 35.0, 24.0


def draw_parts(folder: Path, design: FootDesign, flexes: tuple[Flex, Flex]) -> None:
    """Write `parts.png`, an exploded view of the foot's parts in the order of assembly.

    Args:
        folder: Folder of the files.
        design: The foot.
        flexes: Row flex and column flex.
    """
    radius, half = design.ball_radius_mm, design.sheet_mm / 2.0
    rows, columns = flexes
    step = 0.6 * radius
    azimuth = np.radians(_AZIMUTH_DEG)
    aside = np.array([-np.sin(azimuth), np.cos(azimuth)])
    figure = Figure(figsize=(7.5, 9.0))
    axes: Any = figure.add_axes((-0.2, -0.06, 1.2, 1.12), projection="3d", computed_zorder=False)
    plate = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    layers: list[tuple[str, Any]] = [
        ("ground hemisphere", ("solid", "hemisphere-ground", _RUBBER)),
        ("plate", [(plate, _PDMS)]),
        ("row flex, copper up", _flex_polygons(folder, rows, upwards=True)),
        ("film", [(_ring_points(sheets.read_dxf(folder / "film.dxf").exterior), _LAYER)]),
        ("spacer", [(r, c) for r, c in _sheet_polygons(folder / "spacer.dxf")]),
        ("column flex, copper down", _flex_polygons(folder, columns, upwards=False)),
        ("plate", [(plate, _PDMS)]),
        ("leg hemisphere", ("solid", "hemisphere-leg", _RUBBER)),
        ("socket of the leg", ("solid", "leg-socket", _METAL)),
    ]
    z = 0.0
    for order, (name, what) in enumerate(layers):
        if isinstance(what, tuple):
            _, part, colour = what
            triangles = _surface_triangles(folder / "step" / f"{part}.step", radius / 6.0)
            z += 0.8 * radius if part == "leg-socket" else 0.0
            _draw_surface(axes, triangles + np.array([0.0, 0.0, z]), colour, order)
        else:
            for ring, colour in what:
                flat = np.column_stack([ring, np.full(len(ring), z)])
                axes.add_collection3d(
                    Poly3DCollection(
                        [flat], fc=colour, ec="k", lw=0.0 if colour == _COPPER else 0.4, zorder=order
                    )
                )
        axes.text(*(1.9 * radius * aside), z, name, fontsize=10, va="center", zorder=99)
        z += step
    low, high = -radius, z + 1.2 * radius
    wide = 2.0 * radius
    axes.set(xlim=(-wide, wide), ylim=(-wide, wide), zlim=(low, high))
    axes.set_box_aspect((2.0 * wide, 2.0 * wide, high - low), zoom=1.13)
    axes.set_proj_type("ortho")
    axes.view_init(elev=_ELEVATION_DEG, azim=_AZIMUTH_DEG)
    axes.set_axis_off()
    figure.savefig(folder / "parts.png", dpi=_DPI, metadata={"Software": None})


def _flex_polygons(folder: Path, flex: Flex, *, upwards: bool) -> list[tuple[Vector, str]]:
    """Return outline and visible copper of a flex in the foot frame as polygons with colours, tail cut short."""
    shown = [(read_outline(folder / flex.name / "profile.gbr"), _POLYMER)]
    if upwards:
        shown += [(shape.polygon, _COPPER) for shape in read_layer(folder / flex.name / "copper.gbr")]
    end = 1.9 * flex.ball_radius_mm
    return [
        (np.array([flex.artwork_to_foot((min(u, end), v)) for u, v in area.exterior.coords]), colour)
        for area, colour in shown
    ]


def _sheet_polygons(path: Path) -> list[tuple[Vector, str]]:
    """Return outline and openings of a DXF sheet as polygons with colours."""
    shape = sheets.read_dxf(path)
    return [(_ring_points(shape.exterior), _LAYER), *((_ring_points(ring), "w") for ring in shape.interiors)]


def _ring_points(ring: Any) -> Vector:
    """Return the points of a polygon ring [mm], shape (n, 2)."""
    return np.asarray(ring.coords)


def _surface_triangles(path: Path, edge_mm: float) -> Vector:
    """Return the surface triangulation of a STEP file [mm], shape (n, 3, 3).

    Args:
        path: The file.
        edge_mm: Largest edge of a triangle [mm].
    """
    mesh = occ.OCCGeometry(solids.read_step(path)).GenerateMesh(
        maxh=edge_mm, perfstepsend=MeshingStep.MESHSURFACE
    )
    corners = mesh.Elements2D().NumPy()["nodes"][:, :3] - 1  # netgen counts from 1
    triangles: Vector = mesh.Coordinates()[corners]
    return triangles


def _draw_surface(axes: Any, triangles: Vector, colour: str, order: int) -> None:
    """Draw a triangulated surface with shading."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
    light = _SHADE + (1.0 - _SHADE) * np.abs(normal @ _LIGHT) / np.linalg.norm(_LIGHT)
    faces = np.clip(np.array(colors.to_rgb(colour)) * (0.3 + 0.8 * light)[:, None], 0.0, 1.0)
    axes.add_collection3d(Poly3DCollection(triangles, fc=faces, ec=faces, lw=0.2, zorder=order))
