"""Library of solved foot shapes: response of feet of any size and modulus by scaling and interpolation.

The solid is linear, so with R the ball's radius and E the rubber's modulus

    closure = F / (E R) [g0(n) + (a / R)^2 g2(n)],    (a / R)^3 = 3/4 (1 - nu^2) F / (E R^2)      (Hertz)

where g0 and g2 depend on the shape alone. Size, modulus and gap are then free: a foot of another size or hardness needs
no mesh, and a thicker gap only takes more closure to close. The shape is five numbers: how much of the pitch an
electrode fills, plate and spacer over the ball's radius, the sheet's modulus over the rubber's, its Poisson's ratio.
The sheet is as wide as the ball carries, and the array as wide as the sheet: 1.4 R, as in the paper.

Shapes beside the paper's were solved once, one number changed at a time (`footsense lab shapes` of commit 4a590b77, in
half an hour); the page `design` tells how far the library is from tables solved today. Between them a response is a
pattern times an amplitude: the pattern and the amplitude's logarithm are parabolas in each number's logarithm. The five
changes of the pattern add; those of the amplitude multiply, with corrections for some pairs of numbers, from coarse
meshes with both of them changed.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator

from footsense.foot.gap_contact import CELLS_PER_SIDE
from footsense.foot.response_table import GRID_SIDE, FootResponse, series_basis
from footsense.frames import Vector
from footsense.lab.geometry import MIN_FITTED_ELEVATION_DEG, MIN_TABLE_ELEVATION_DEG, FootDesign

#: File of the solved shapes, in steps of 1e-5 of the largest number of a shape: 1 MB, capacitances off by up to 2e-4
#: rms, a tenth of what the tables' own fit is.
SHAPES_FILE = Path(__file__).with_name("shapes.npz")
#: Ball radius [mm], rubber modulus [MPa] and its Poisson's ratio of the solved shapes: the paper's.
RADIUS_MM, YOUNGS_MPA, RUBBER_POISSON = 10.0, 5.2, 0.49
#: Side of the sheet, and of the array on it, over the ball's radius [1].
SHEET_SIDE_OVER_RADIUS = 1.4
#: Degree of the stored series, that of `response.DEGREE`.
_SERIES_DEGREE = 12
#: Element of each cell of a quarter, as a number of an amplitude: corner, edge, middle.
_AMPLITUDE_INDEX_OF_QUARTER_CELL = np.add.outer(*[np.arange(GRID_SIDE // 2) // CELLS_PER_SIDE] * 2)
#: Element of each element of the foot, likewise.
AMPLITUDE_INDEX_OF_ELEMENT = np.add.outer([0, 1, 0], [0, 1, 0]).ravel()


class FootShape(NamedTuple):
    """Dimensionless shape of a foot, after scaling by ball radius and modulus; each field may be an array.

    Attributes:
        electrode_over_pitch: Side of an electrode over the pitch [1].
        plate_rel: Thickness of a plate over the ball's radius [1].
        spacer_rel: Thickness of the spacer over the ball's radius [1].
        sheet_modulus_rel: Young's modulus of the sheet over the rubber's [1].
        sheet_poisson: Poisson's ratio of the sheet [1].
    """

    electrode_over_pitch: Vector | float
    plate_rel: Vector | float
    spacer_rel: Vector | float
    sheet_modulus_rel: Vector | float
    sheet_poisson: Vector | float

    @property
    def interpolation_coordinates(self) -> Vector:
        """Interpolation coordinates: logarithms of the shape's numbers, shape (..., 5)."""
        numbers = (*self[:4], 1.0 - 2.0 * np.asarray(self.sheet_poisson))
        logarithms: Vector = np.log(np.stack(np.broadcast_arrays(*numbers), axis=-1))
        return logarithms


#: The paper's foot.
PAPER_SHAPE = FootShape(0.8, 0.05, 0.0037, 3.0 / 5.2, 0.40)
#: Values of each number beside the paper's that are solved: below and above, or twice above.
SHAPE_INTERPOLATION_NODES = {
    "electrode_over_pitch": (0.7, 0.88),
    "plate_rel": (0.025, 0.1),
    "spacer_rel": (0.0018, 0.0105),
    "sheet_modulus_rel": (0.2, 1.5),
    "sheet_poisson": (0.45, 0.48),
}


def sheet_filling_pitch_mm(electrode_over_pitch: Vector | float, ball_radius_mm: Vector | float) -> Vector:
    """Return the electrode pitch [mm] of an array that fills the whole sheet."""
    pitch: Vector = (
        SHEET_SIDE_OVER_RADIUS * np.asarray(ball_radius_mm) / (2.0 + np.asarray(electrode_over_pitch))
    )
    return pitch


def shape_of(design: FootDesign) -> FootShape:
    """Return the dimensionless shape of a foot whose array fills its sheet."""
    radius_mm = design.ball_radius_mm
    return FootShape(
        design.electrode_mm / design.pitch_mm,
        design.plate_mm / radius_mm,
        design.spacer_mm / radius_mm,
        design.pdms.youngs_mpa / design.rubber.youngs_mpa,
        design.pdms.poisson,
    )


def response_amplitudes(series: Vector, compliance: Vector) -> Vector:
    """Return the four amplitudes that characterise a response [um/N], shape (4,).

    They are the mean closures upright of a corner, of an edge and of the middle element, and the rms of the compliance.

    Args:
        series: Influence of a quarter, shape (2, products, 9, 9, 3).
        compliance: Compliance of a quarter, shape (9, 9, 18, 18).
    """
    upright = series_basis(np.array([0.0, 0.0, 1.0]), _SERIES_DEGREE, MIN_FITTED_ELEVATION_DEG)
    closures = np.tensordot(upright, series[0, ..., 2], 1)
    of_element = [closures[number == _AMPLITUDE_INDEX_OF_QUARTER_CELL].mean() for number in range(3)]
    return np.array([*of_element, np.sqrt((compliance**2).mean())])


def _of_steps(stored: Mapping[str, NDArray[Any]], name: str) -> Vector:
    """Return an array of the solved shapes, stored as whole steps, of all but the first what they differ from it."""
    steps = stored[name]
    steps[1:] += steps[0]
    numbers: Vector = steps * stored[f"{name}_step"]
    return numbers


class FootShapeLibrary:
    """Library of solved foot shapes, with interpolation of the response between them.

    Args:
        path: File of the solved shapes.

    Attributes:
        series: Patterns of the influence of each solved shape, shape (shapes, 2, products, 9, 9, 3).
        compliance: Patterns of the compliance, shape (shapes, 9, 9, 18, 18).
    """

    def __init__(self, path: Path = SHAPES_FILE) -> None:
        """Load the solved shapes from their file."""
        with np.load(path) as stored:
            series, compliance = (
                _of_steps(stored, name) for name in ("quarter_series", "quarter_compliance")
            )
            self._pairs = stored["pairs"].astype(np.float64)
        each = np.stack(
            [response_amplitudes(one, other) for one, other in zip(series, compliance, strict=True)]
        )
        self._ln_amplitudes = np.log(each)
        self.series = series / each[:, _AMPLITUDE_INDEX_OF_QUARTER_CELL][:, None, None, :, :, None]
        self.compliance = compliance / each[:, 3, None, None, None, None]
        nodes = [(name, value) for name, values in SHAPE_INTERPOLATION_NODES.items() for value in values]
        shapes = [PAPER_SHAPE, *(PAPER_SHAPE._replace(**{name: value}) for name, value in nodes)]
        self._coordinates = np.stack([shape.interpolation_coordinates for shape in shapes])

    def interpolation_weights(self, shape: FootShape) -> Vector:
        """Return the interpolation weight of each solved shape [1], shape (..., shapes)."""
        moved = shape.interpolation_coordinates - self._coordinates[0]
        interpolation_weights = np.zeros((*moved.shape[:-1], len(self._coordinates)))
        interpolation_weights[..., 0] = 1.0
        for axis in range(moved.shape[-1]):
            nodes = [0, 1 + 2 * axis, 2 + 2 * axis]
            places = self._coordinates[nodes, axis] - self._coordinates[0, axis]
            own = BarycentricInterpolator(places, np.eye(3))(moved[..., axis])
            interpolation_weights[..., nodes] += own
            interpolation_weights[..., 0] -= 1.0
        return interpolation_weights

    def interpolated_response_amplitudes_um_per_n(self, interpolation_weights: Vector) -> Vector:
        """Return the interpolated response amplitudes at the solved feet's scale [um/N], (..., 4)."""
        pairs = np.einsum("...a,...b,abk->...k", interpolation_weights, interpolation_weights, self._pairs)
        each: Vector = np.exp(interpolation_weights @ self._ln_amplitudes + pairs)
        return each

    def covers(self, shape: FootShape, margin_rel: float = 0.1) -> NDArray[np.bool_]:
        """Return which shapes lie within the range of the solved ones, with a relative margin, shape (...)."""
        corners = self._coordinates
        low, high = corners.min(axis=0), corners.max(axis=0)
        slack = margin_rel * (high - low)
        inside: NDArray[np.bool_] = (
            (shape.interpolation_coordinates >= low - slack)
            & (shape.interpolation_coordinates <= high + slack)
        ).all(axis=-1)
        return inside

    def response(self, design: FootDesign) -> FootResponse:
        """Return the interpolated response table of a foot, without a finite element solve.

        Args:
            design: The foot; its array fills its sheet.
        """
        interpolation_weights = self.interpolation_weights(shape_of(design))
        amplitude = self.interpolated_response_amplitudes_um_per_n(interpolation_weights)
        size = RADIUS_MM / design.ball_radius_mm
        relative_compliance = YOUNGS_MPA / design.rubber.youngs_mpa * size
        point, patch = (
            relative_compliance
            * amplitude[_AMPLITUDE_INDEX_OF_QUARTER_CELL][:, :, None]
            * np.tensordot(interpolation_weights, self.series, 1)
        )
        return FootResponse(
            foot_type=design.foot_type,
            design=design.capacitor,
            ball_radius_mm=design.ball_radius_mm,
            hertz_modulus_mpa=design.rubber.plane_strain_modulus_mpa,
            min_elevation_deg=MIN_TABLE_ELEVATION_DEG,
            fit_elevation_deg=MIN_FITTED_ELEVATION_DEG,
            degree=_SERIES_DEGREE,
            quarter_series=np.stack([point, size**2 * patch]),
            quarter_compliance=amplitude[3]
            * relative_compliance
            * np.tensordot(interpolation_weights, self.compliance, 1),
            provenance={"from": "solved shapes"},
        )
