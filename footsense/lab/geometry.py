"""Geometry, materials and load range of a foot type.

The numbers of each foot stand in its `foot.yaml` alone, which `foot_file` reads. Lengths in mm and stresses in MPa
inside the lab, so that forces are in N; closures leave it in um. Decided here for every foot: the array is square, and
the cavities have the size of the electrodes, so that the spacer is crossing bars, open to the edge of the sheet.

Source:
    Aoyagi et al., sections III A (materials), III C and F (array), IV and Fig. 13 (layers).
"""

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from footsense.foot.capacitor import Capacitor
from footsense.foot.gap_contact import CELLS_PER_SIDE
from footsense.foot.response_table import contact_radius_mm
from footsense.frames import ROWS

#: Full load of the paper's foot [N].
PAPER_MAX_FORCE_N = 2.0
#: Micrometres in a millimetre.
UM_PER_MM = 1000.0
#: Lowest contact normal that a foot's response table answers for [deg].
MIN_TABLE_ELEVATION_DEG = 25.0
#: Rim of the disc that the table is fitted on [deg]: below the lowest contact by more than the largest patch.
MIN_FITTED_ELEVATION_DEG = 12.0

#: Name of a foot type or of a material.
Name = Annotated[
    str, Meta(pattern=r"^[a-z0-9][a-z0-9-]{0,39}$", description="small letters, digits and hyphens")
]
_LengthMm = Annotated[float, Meta(gt=0.0, le=200.0, description="a length in mm")]
_LayerThicknessUm = Annotated[float, Meta(ge=0.1, le=2000.0, description="a thickness in um")]
_Share = Annotated[float, Meta(ge=0.0, le=1.0)]
_LeanDeg = Annotated[float, Meta(ge=1.0, le=60.0, description="an angle in degrees")]


class Material(Struct, frozen=True, forbid_unknown_fields=True):
    """An isotropic linear elastic material.

    Attributes:
        youngs_mpa: Young's modulus E [MPa].
        poisson: Poisson's ratio nu [1].
    """

    youngs_mpa: Annotated[float, Meta(ge=0.01, le=1e6, description="Young's modulus in MPa")]
    poisson: Annotated[float, Meta(gt=0.0, lt=0.5, description="rubber has 0.49")]

    @property
    def shear_modulus_mpa(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)) [MPa]."""
        return self.youngs_mpa / (2.0 * (1.0 + self.poisson))

    @property
    def lame_lambda_mpa(self) -> float:
        """Lame's first parameter lambda [MPa]."""
        return self.youngs_mpa * self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))

    @property
    def confined_modulus_mpa(self) -> float:
        """Confined (P-wave) modulus lambda + 2 G [MPa]: stiffness of a layer that cannot spread sideways."""
        return self.lame_lambda_mpa + 2.0 * self.shear_modulus_mpa

    @property
    def plane_strain_modulus_mpa(self) -> float:
        """Plane-strain modulus E / (1 - nu^2) for Hertz contact with a rigid body [MPa]."""
        return self.youngs_mpa / (1.0 - self.poisson**2)


class ThinFilm(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A film on a plate that resists stretching but not bending.

    Attributes:
        thickness_um: Thickness [um].
        youngs_mpa: Young's modulus [MPa].
        poisson: Poisson's ratio [1].
    """

    thickness_um: Annotated[float, Meta(ge=0.001, le=20.0, description="a thickness in um")]
    youngs_mpa: Annotated[float, Meta(ge=0.01, le=1e6, description="gold has 79000 MPa, parylene C 2800")]
    poisson: Annotated[float, Meta(gt=0.0, lt=0.5, description="gold has 0.42, parylene C 0.4")]


class LoadRange(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Range of the random loads on which a foot's network is trained.

    Attributes:
        max_n: Largest force [N].
        friction_angle_deg: Largest angle between force and contact normal [deg].
        typical_lean_deg: Lean of the leaning loads, sideways and along [deg, rms each].
        min_elevation_deg: Lowest elevation of force and of contact normal [deg].
        centred_share: Share of the loads that do not lean [1].
    """

    max_n: Annotated[float, Meta(gt=0.0, le=500.0, description="a force in N")]
    friction_angle_deg: _LeanDeg
    typical_lean_deg: _LeanDeg
    min_elevation_deg: Annotated[
        float, Meta(ge=MIN_TABLE_ELEVATION_DEG, le=80.0, description="the response table begins at 25 deg")
    ]
    centred_share: _Share

    @property
    def force_unit(self) -> float:
        """Unit [1] in which the full load is that of the paper's foot: every foot's network is trained in its own.

        Closures depend on the force over modulus and area alone: in this unit a foot of any range looks to the
        training like the paper's, and the network's forces are multiplied by it at its output.
        """
        return self.max_n / PAPER_MAX_FORCE_N

    @property
    def min_training_force_n(self) -> float:
        """Smallest force of the training loads [N]."""
        return 0.005 * self.max_n

    @property
    def min_evaluated_force_n(self) -> float:
        """Smallest force in error tables [N]: below, noise alone hides the direction."""
        return 0.1 * self.max_n


class FootDesign(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Geometry and materials of a foot: two hemispheres, two PDMS plates, a spacer with cavities between.

    Attributes:
        foot_type: Name under which table and network are built, and of their folder.
        about: Short description of the foot, with which its model card begins.
        ball_radius_mm: Radius of both hemispheres [mm].
        sheet_mm: Side of the square sheet [mm].
        plate_mm: Thickness of each of the two plates that carry the electrodes [mm].
        spacer_mm: Thickness of the layer with the cavities [mm].
        pitch_mm: Distance of neighbouring elements [mm].
        electrode_mm: Side of an electrode and of its cavity [mm].
        gap_um: Unloaded air gap [um].
        film_um: Film below the gap [um].
        film_eps_r: Relative permittivity of the film [1].
        rubber: Material of the ball.
        pdms: Material of the sheet.
        loads: Range of the training loads.
        gold: Electrodes on both plates, as large as the cavities; None where they do not stiffen the plates.
        parylene: Lining of the cavities on the side of the film; None for none.
        cavity: That the air of a closing gap gets out: `vented` is the one kind that is computed.
    """

    foot_type: Name
    about: Annotated[str, Meta(min_length=1, max_length=80)]
    ball_radius_mm: _LengthMm
    sheet_mm: _LengthMm
    plate_mm: Annotated[float, Meta(ge=0.01, le=20.0, description="a thickness in mm")]
    spacer_mm: Annotated[float, Meta(ge=0.002, le=2.0, description="a thickness in mm")]
    pitch_mm: _LengthMm
    electrode_mm: _LengthMm
    gap_um: _LayerThicknessUm
    film_um: _LayerThicknessUm
    film_eps_r: Annotated[float, Meta(ge=1.0, le=100.0, description="that of air is 1")]
    rubber: Material
    pdms: Material
    loads: LoadRange
    cavity: Literal["vented"]
    gold: ThinFilm | None = None
    parylene: ThinFilm | None = None

    @property
    def capacitor(self) -> Capacitor:
        """Gap, film, permittivity and electrode area, as the service's capacitor model needs them."""
        return Capacitor(
            gap_um=self.gap_um,
            film_um=self.film_um,
            film_eps_r=self.film_eps_r,
            electrode_area_mm2=self.electrode_mm**2,
        )

    @property
    def element_centres_mm(self) -> list[tuple[float, float]]:
        """Centre (x, y) of each element [mm], flat index 3 * i + j: row 0 most forward, column 0 leftmost."""
        return [(x, y) for x in self.line_mm for y in self.line_mm]

    @property
    def line_mm(self) -> tuple[float, ...]:
        """X of each row, the most forward first, and y of each column, the leftmost first [mm]."""
        return self.pitch_mm, 0.0, -self.pitch_mm

    @property
    def bar_mm(self) -> float:
        """Width of the spacer's bars between neighbouring electrodes [mm]."""
        return self.pitch_mm - self.electrode_mm

    @property
    def rim_mm(self) -> float:
        """Width of the sheet outside the outermost electrodes [mm]; 0 where the array fills the sheet."""
        return max(0.0, (self.sheet_mm - self.array_side_mm) / 2.0)

    @property
    def array_side_mm(self) -> float:
        """Side of the electrode array between its outer edges [mm]."""
        return (ROWS - 1) * self.pitch_mm + self.electrode_mm

    @property
    def bar_span_mm(self) -> tuple[float, float]:
        """Begin and end of the bar between electrodes along the positive half axis [mm]."""
        return self.electrode_mm / 2.0, self.pitch_mm - self.electrode_mm / 2.0

    @property
    def cavity_cell_area_mm2(self) -> float:
        """Area of one square cell of a cavity [mm2]."""
        return (self.electrode_mm / CELLS_PER_SIDE) ** 2

    def hertz_patch_radius_mm(self, force_n: float) -> float:
        """Return the Hertz contact radius under a normal force [mm]."""
        return float(contact_radius_mm(force_n, self.ball_radius_mm, self.rubber.plane_strain_modulus_mpa))

    def hertz_patch_angle_deg(self, force_n: float) -> float:
        """Return the Hertz contact radius as an angle seen from the ball's centre [deg]."""
        return float(np.degrees(self.hertz_patch_radius_mm(force_n) / self.ball_radius_mm))
