"""Elastic energy densities of small strain (Hooke) for displacement and mixed forms.

    W = G eps:eps + lambda/2 (div u)^2,                         eps = (grad u + grad u^T) / 2

Near nu = 1/2 the volume term locks the mesh; there the pressure p = lambda div u is an unknown of its own,

    W = G eps:eps + p div u - p^2 / (2 lambda),

which with p one order below u (Taylor-Hood) is stable up to nu = 1/2. `ng.Variation` makes the weak form of an energy.
"""

from dataclasses import dataclass
from typing import Any

import ngsolve as ng

from footsense.lab.geometry import Material, ThinFilm


def _shear_energy_density(material: Material, u: Any) -> Any:
    strain = 0.5 * (ng.Grad(u) + ng.Grad(u).trans)
    return material.shear_modulus_mpa * ng.InnerProduct(strain, strain)


def strain_energy_density(material: Material, u: Any) -> Any:
    """Return the strain energy density [MPa] of a displacement u [mm]; for Poisson's ratios well below 1/2."""
    return _shear_energy_density(material, u) + 0.5 * material.lame_lambda_mpa * ng.div(u) ** 2


def mixed_strain_energy_density(material: Material, u: Any, p: Any) -> Any:
    """Return the energy density [MPa] of displacement u [mm] and pressure p [MPa] (mixed form, saddle point in p)."""
    return _shear_energy_density(material, u) + p * ng.div(u) - p**2 / (2.0 * material.lame_lambda_mpa)


@dataclass(frozen=True, slots=True)
class BondedLayer:
    """Thin elastic layer bonded between the two bodies, as an interface traction law without elements.

    Attributes:
        material: Material of the layer.
        thickness_mm: Thickness of the layer [mm].
        face_pattern: Faces of the mesh that it covers.
        bonded_share: Share of it that is bonded [1], which may be a function of the place.
    """

    material: Material
    thickness_mm: float
    face_pattern: str = "bars"
    bonded_share: Any = 1.0

    def traction(self, jump: Any) -> Any:
        """Return the traction [MPa] of a displacement jump u_ground - u_leg [mm] across the layer."""
        shear, confined = self.material.shear_modulus_mpa, self.material.confined_modulus_mpa
        across = (shear, shear, confined)
        return ng.CF(tuple(self.bonded_share * across[k] / self.thickness_mm * jump[k] for k in range(3)))


def membrane_energy_per_area(film: ThinFilm, u: Any) -> Any:
    """Return the stretching energy per area [N/mm] of a thin film in a plane of constant z, displaced by u [mm].

    Plane stress, W = E t / (2 (1 - nu^2)) (e_xx^2 + e_yy^2 + 2 nu e_xx e_yy + 2 (1 - nu) e_xy^2).
    """
    gradient = ng.Grad(u).Trace()
    along_x, along_y = gradient[0, 0], gradient[1, 1]
    shear = 0.5 * (gradient[0, 1] + gradient[1, 0])
    stiffness = 1e-3 * film.thickness_um * film.youngs_mpa / (1.0 - film.poisson**2)
    squares = along_x**2 + along_y**2 + 2.0 * film.poisson * along_x * along_y
    return 0.5 * stiffness * (squares + 2.0 * (1.0 - film.poisson) * shear**2)
