"""Foot with a soft gel film in place of the spacer and its air gaps (the paper's outlook, section VI).

The film fills the whole area between the plates, electrodes and bars alike, and takes the place of the bars in the
weak form of `quarter`: an elastic layer between the two bodies,

    int over the film of (G [u_t].[v_t] + M [u_n][v_n]) / t_film

As a layer it needs no elements of its own, so that nothing in it can lock, however soft or incompressible it is. It
is bonded to two plates that are far stiffer and cannot spread sideways but near its rim, so that it resists being
pressed with the confined modulus M = lambda + 2 G and not with E. How near: a pressure in such a layer dies away over

    l = t sqrt(M / (12 G))

from the rim, lateral flow being a parabola between the two plates.
"""

from dataclasses import dataclass, field

from footsense.foot.capacitor import Capacitor
from footsense.lab.fem.elasticity import BondedLayer
from footsense.lab.geometry import UM_PER_MM, FootDesign, Material


@dataclass(frozen=True, slots=True, kw_only=True)
class GelLayerDesign:
    """Gel film in place of the spacer: thickness, material and permittivity.

    Attributes:
        thickness_mm: Thickness, that of the spacer [mm].
        gel: Gelled polyurethane; the paper gives E = 20 kPa, Poisson's ratio is a choice.
        eps_r: Relative permittivity of the gel [1], a choice: capacitance and sensitivity are proportional to it.
    """

    thickness_mm: float
    gel: Material = field(default_factory=lambda: Material(0.020, 0.49))
    eps_r: float = 5.0

    @property
    def layer(self) -> BondedLayer:
        """The gel as an elastic layer bonded to both plates over their whole area, cavities and bars alike."""
        return BondedLayer(self.gel, self.thickness_mm, "bars|cell.*")

    def equivalent_air_capacitor(self, design: FootDesign) -> Capacitor:
        """Return an equivalent air capacitor: the gel's thickness as the gap, electrode area times eps_r."""
        return Capacitor(
            gap_um=UM_PER_MM * self.thickness_mm,
            film_um=0.0,
            film_eps_r=1.0,
            electrode_area_mm2=self.eps_r * design.electrode_mm**2,
        )
