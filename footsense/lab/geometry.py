"""The sole sensor of the paper as numbers: one frozen description that mesh, material and read-out share.

Lengths in mm and stresses in MPa inside the lab, so that forces are in N; closures leave it in um.
Not given by the paper and decided here: the cavities have the size of the electrodes, so that the spacer is four
crossing bars of 1 mm, open to the edge of the sheet; the air in the cavities does not resist (it is vented).

Source:
    Aoyagi et al., sections III A (materials), III C and F (array), IV and Fig. 13 (layers).
"""

import math
from dataclasses import dataclass, field

from footsense.core.design import CapacitorDesign


@dataclass(frozen=True, slots=True)
class Material:
    """An isotropic linear elastic material.

    Attributes:
        youngs_mpa: Young's modulus E [MPa].
        poisson: Poisson's ratio nu [1].
    """

    youngs_mpa: float
    poisson: float

    @property
    def shear_mpa(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)) [MPa]."""
        return self.youngs_mpa / (2.0 * (1.0 + self.poisson))

    @property
    def lame_mpa(self) -> float:
        """Lame's first parameter [MPa]."""
        return self.youngs_mpa * self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))

    @property
    def confined_mpa(self) -> float:
        """Modulus of a layer that cannot spread sideways, lambda + 2 G [MPa]."""
        return self.lame_mpa + 2.0 * self.shear_mpa

    @property
    def hertz_mpa(self) -> float:
        """Contact modulus against a rigid body, E / (1 - nu^2) [MPa]."""
        return self.youngs_mpa / (1.0 - self.poisson**2)


@dataclass(frozen=True, slots=True, kw_only=True)
class SoleDesign:
    """The foot: two hemispheres, two plates of PDMS, and a spacer with nine cavities between the plates.

    Attributes:
        foot_type: Name under which table and network are released.
        ball_radius_mm: Radius of both hemispheres [mm].
        sheet_mm: Side of the square sheet [mm].
        plate_mm: Thickness of each of the two plates that carry the electrodes [mm].
        spacer_mm: Thickness of the layer with the cavities [mm].
        pitch_mm: Distance of neighbouring elements [mm].
        electrode_mm: Side of an electrode and of its cavity [mm].
        gap_um: Air gap at rest [um].
        film_um: Film below the gap [um].
        film_eps_r: Relative permittivity of the film [1].
        rubber: Butadiene rubber of the ball.
        pdms: Silicone of the sheet.
    """

    foot_type: str = "aoyagi-3x3"
    ball_radius_mm: float = 10.0
    sheet_mm: float = 14.0
    plate_mm: float = 0.5
    spacer_mm: float = 0.037
    pitch_mm: float = 5.0
    electrode_mm: float = 4.0
    gap_um: float = 20.0
    film_um: float = 17.0
    film_eps_r: float = 2.7
    rubber: Material = field(default_factory=lambda: Material(5.2, 0.49))
    pdms: Material = field(default_factory=lambda: Material(3.0, 0.40))

    def __post_init__(self) -> None:
        """Check that the parts fit.

        Raises:
            ValueError: The array is larger than the sheet, or the sheet than the hemispheres' flat faces.
        """
        array_mm = 2.0 * self.pitch_mm + self.electrode_mm
        if not (self.electrode_mm < self.pitch_mm and array_mm <= self.sheet_mm):
            raise ValueError(f"an array of {array_mm:g} mm does not fit on a sheet of {self.sheet_mm:g} mm")
        if self.sheet_mm >= math.sqrt(2.0) * self.ball_radius_mm:
            raise ValueError(
                f"a sheet of {self.sheet_mm:g} mm overhangs a ball of {self.ball_radius_mm:g} mm radius"
            )

    @property
    def capacitor(self) -> CapacitorDesign:
        """The electrical dimensions, as the daemon reads them."""
        return CapacitorDesign(
            gap_um=self.gap_um,
            film_um=self.film_um,
            film_eps_r=self.film_eps_r,
            electrode_area_mm2=self.electrode_mm**2,
        )

    @property
    def centres_mm(self) -> list[tuple[float, float]]:
        """Centre (x, y) of each element [mm], flat index 3 i + j: row 0 most forward, column 0 leftmost."""
        return [((1 - i) * self.pitch_mm, (1 - j) * self.pitch_mm) for i in range(3) for j in range(3)]
