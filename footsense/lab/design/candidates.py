"""Candidate feet: every combination of the available dimensions, materials and processes, as arrays."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.frames import Vector
from footsense.lab.design.requirements import Requirements
from footsense.lab.design.shapes import FootShape, sheet_filling_pitch_mm
from footsense.lab.geometry import UM_PER_MM

#: Steps of the ball's diameter.
_N_BALL_DIAMETERS_TRIED = 9


class Candidates(NamedTuple):
    """Parameters of n candidate feet; every field has shape (n,).

    Attributes:
        ball_radius_mm: Radius of the ball [mm].
        electrode_over_pitch: Side of an electrode over the pitch [1].
        plate_mm: Thickness of a plate [mm].
        gap_um: Unloaded gap [um].
        film: Number of the film in the process's table.
        rubber: Number of the rubber in the table.
        sheet: Number of the sheet in the table.
        rubber_mpa: Young's modulus of the rubber [MPa].
        sheet_mpa: Young's modulus of the sheet [MPa].
        sheet_poisson: Poisson's ratio of the sheet [1].
        film_um: Thickness of the film [um].
        film_eps_r: Its permittivity [1].
    """

    ball_radius_mm: Vector
    electrode_over_pitch: Vector
    plate_mm: Vector
    gap_um: Vector
    film: NDArray[np.intp]
    rubber: NDArray[np.intp]
    sheet: NDArray[np.intp]
    rubber_mpa: Vector
    sheet_mpa: Vector
    sheet_poisson: Vector
    film_um: Vector
    film_eps_r: Vector

    def select(self, selection: NDArray[np.intp] | NDArray[np.bool_] | slice) -> "Candidates":
        """Return the candidates selected by a mask or by indices."""
        parts: list[Any] = [part[selection] for part in self]
        return Candidates(*parts)

    @property
    def pitch_mm(self) -> Vector:
        """Distance between the centres of neighbouring elements [mm]."""
        return sheet_filling_pitch_mm(self.electrode_over_pitch, self.ball_radius_mm)

    @property
    def electrode_mm(self) -> Vector:
        """Side length of an electrode [mm]."""
        return self.electrode_over_pitch * self.pitch_mm

    @property
    def eps0_area_pf_um(self) -> Vector:
        """Capacitance times plate distance of an element, eps0 A [pF um]."""
        area: Vector = EPS0_PF_UM_PER_MM2 * self.electrode_mm**2
        return area

    @property
    def unloaded_distance_um(self) -> Vector:
        """Equivalent air distance of the unloaded electrodes [um]: gap plus film over its permittivity."""
        distance: Vector = self.gap_um + self.film_um / self.film_eps_r
        return distance

    @property
    def unloaded_pf(self) -> Vector:
        """Capacitance of an unloaded element [pF]."""
        unloaded: Vector = self.eps0_area_pf_um / self.unloaded_distance_um
        return unloaded

    @property
    def half_closed_pf(self) -> Vector:
        """Capacitance of an element whose gap is half closed [pF]."""
        half: Vector = self.eps0_area_pf_um / (self.unloaded_distance_um - 0.5 * self.gap_um)
        return half

    @property
    def shape(self) -> FootShape:
        """Dimensionless shapes of the candidates, for the response library."""
        spacer_mm = (self.gap_um + self.film_um) / UM_PER_MM
        return FootShape(
            self.electrode_over_pitch,
            self.plate_mm / self.ball_radius_mm,
            spacer_mm / self.ball_radius_mm,
            self.sheet_mpa / self.rubber_mpa,
            self.sheet_poisson,
        )


def all_candidates(requirements: Requirements) -> Candidates:
    """Return every combination of available dimensions, materials and films, feasible or not."""
    low_mm, high_mm = requirements.ball_diameter_range_mm
    radii = np.unique(np.round(np.linspace(low_mm, high_mm, _N_BALL_DIAMETERS_TRIED) * 2.0) / 2.0) / 2.0
    process, materials = requirements.process, requirements.materials
    axes = (
        radii,
        np.array(process.fill_rel, float),
        np.array(process.plate_mm, float),
        np.array(process.gap_um, float),
        np.arange(len(process.film)),
        np.arange(len(materials.rubbers)),
        np.arange(len(materials.sheets)),
    )
    radius, fill, plate, gap, film, rubber, sheet = (
        part.ravel() for part in np.meshgrid(*axes, indexing="ij")
    )
    rubbers = [solid.material for solid in materials.rubbers]
    sheets = [solid.material for solid in materials.sheets]
    return Candidates(
        *(radius, fill, plate, gap, film, rubber, sheet),
        rubber_mpa=np.array([one.youngs_mpa for one in rubbers])[rubber],
        sheet_mpa=np.array([one.youngs_mpa for one in sheets])[sheet],
        sheet_poisson=np.array([one.poisson for one in sheets])[sheet],
        film_um=np.array([one.um for one in process.film])[film],
        film_eps_r=np.array([one.eps_r for one in process.film])[film],
    )
