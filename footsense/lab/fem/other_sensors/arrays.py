"""The paper's sensors A to H on a plain block between the hemispheres: geometry, stresses, pressure patterns.

Source:
    Aoyagi et al., sections III B to III E, Figs. 5, 6 and 8.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import mirrored_series
from footsense.frames import Vector
from footsense.lab.fem.mesh import MeshSize
from footsense.lab.fem.other_sensors.block import BlockColumn, solve_column_stress_fields
from footsense.lab.fem.symmetry_classes import single_cell_series, transposed_series
from footsense.lab.geometry import FootDesign
from footsense.lab.response import SERIES_DEGREE, fit_series, mean_over_patch

#: Force of the contacts [gf]: patterns are divided by their maximum, so that it sets the size of the patch alone.
CONTACT_PATCH_FORCE_GF = 100.0


@dataclass(frozen=True, slots=True)
class SensorArray:
    """Sensor array on the block, as in the paper's Fig. 6: number, side and pitch of the elements.

    Attributes:
        name: The paper's letter.
        elements_per_side: Elements along a side.
        element_side_mm: Side of an element [mm].
        pitch_mm: Distance of neighbouring elements [mm].
    """

    name: str
    elements_per_side: int
    element_side_mm: float
    pitch_mm: float

    def half_axis_element_borders_mm(self) -> list[tuple[float, float]]:
        """Return inner and outer border of each element on the positive half axis [mm], outermost first, at least 0."""
        centres = [
            self.pitch_mm * ((self.elements_per_side - 1) / 2.0 - k)
            for k in range((self.elements_per_side + 1) // 2)
        ]
        return [(max(0.0, c - self.element_side_mm / 2.0), c + self.element_side_mm / 2.0) for c in centres]

    def quarter_element_columns(self) -> list[BlockColumn]:
        """Return the block columns under the quarter's elements, grouped by x."""
        halves = self.half_axis_element_borders_mm()
        return [BlockColumn(x, y) for x in halves for y in halves]


#: A to C have their elements at the centres of F to H, which have the largest that leave bars of 1 mm between them, as
#: G has; D and E reach to the edge of the block.
PAPER_SENSOR_ARRAYS = (
    SensorArray("A", 2, 1.0, 7.5),
    SensorArray("B", 3, 1.0, 5.0),
    SensorArray("C", 5, 1.0, 3.0),
    SensorArray("D", 7, 1.0, 13.0 / 6.0),
    SensorArray("E", 9, 1.0, 13.0 / 8.0),
    SensorArray("F", 2, 6.5, 7.5),
    SensorArray("G", 3, 4.0, 5.0),
    SensorArray("H", 5, 2.0, 3.0),
)


def _series_of_all_elements(quarter: Vector, elements_per_side: int) -> Vector:
    """Return the response series of all elements, (products, n, n, 3), mirrored from the quarter's.

    The two or four parts of an element that a mirror plane cuts are as large, so that it feels their mean.
    """
    half = np.concatenate([quarter, mirrored_series(quarter, SERIES_DEGREE, 0)[:, ::-1]], axis=1)
    parts = np.concatenate([half, mirrored_series(half, SERIES_DEGREE, 1)[:, :, ::-1]], axis=2)
    for axis in (1, 2) if elements_per_side % 2 else ():
        middle = elements_per_side // 2
        mean = parts.take([middle, middle + 1], axis).mean(axis=axis, keepdims=True)
        outer = (parts.take(range(middle), axis), parts.take(range(middle + 2, elements_per_side + 1), axis))
        parts = np.concatenate([outer[0], mean, outer[1]], axis=axis)
    return parts


def stress_series(
    foot_design: FootDesign, sensors: Sequence[SensorArray], size: MeshSize
) -> dict[str, Vector]:
    """Return each sensor's mean element stress as response series [MPa/N], shapes (products, n, n, 3)."""
    fields = solve_column_stress_fields(
        foot_design, [column for sensor in sensors for column in sensor.quarter_element_columns()], size
    )
    fitted = {parity: fit_series(field) for parity, field in fields.items()}
    series, first = {}, 0
    for sensor in sensors:
        m = len(sensor.half_axis_element_borders_mm())
        own = {parity: part[:, first : first + m * m].reshape(-1, m, m, 3) for parity, part in fitted.items()}
        first += m * m
        raw = single_cell_series(own, SERIES_DEGREE)
        series[sensor.name] = _series_of_all_elements(
            (raw + transposed_series(raw, SERIES_DEGREE)) / 2.0, sensor.elements_per_side
        )
    return series


def pressure_patterns(foot_design: FootDesign, series: Vector, direction: Vector) -> Vector:
    """Return the element pressures [MPa], (n, elements), under centred Hertz contacts."""
    force_n = CONTACT_PATCH_FORCE_GF * GRAM_FORCE_N
    patch_mm = foot_design.hertz_patch_radius_mm(force_n)
    unit = mean_over_patch(series.reshape(len(series), -1), direction, patch_mm, foot_design)
    stress_mpa = (unit.reshape(len(direction), -1, 3) * direction[:, None, :]).sum(axis=2)
    pressure_mpa: Vector = -force_n * stress_mpa
    return pressure_mpa
