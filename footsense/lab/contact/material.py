"""Rubber and PDMS as weak forms: neo-Hookean at finite strain, or Hooke at small strain.

The stored energy per undeformed volume, with F = 1 + grad u and J = det F, is

    W = G/2 (F:F - 3 - 2 ln J) + lambda/2 (J - 1)^2,

whose small-strain limit is Hooke's law with the same G and lambda. Where nu is close to 1/2 the second term locks
the mesh; there the pressure-like p = lambda (J - 1) is an unknown of its own,

    W = G/2 (F:F - 3 - 2 ln J) + p (J - 1) - p^2 / (2 lambda),

which with p one order below u (Taylor-Hood) is stable up to nu = 1/2. At small strain J - 1 becomes div u.

Source:
    Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, ch. 6 (compressible neo-Hookean).
"""

from typing import Any

import ngsolve as ng

from footsense.lab.geometry import Material


def _deformation(u: Any) -> tuple[Any, Any, Any]:
    """Return F, its cofactor J F^-T, and J of a displacement."""
    gradient = ng.Id(3) + ng.Grad(u)
    return gradient, ng.Cof(gradient), ng.Det(gradient)


def _strain(u: Any) -> Any:
    """Return the small strain of a displacement [1]."""
    return 0.5 * (ng.Grad(u) + ng.Grad(u).trans)


def plain_work(material: Material, u: Any, v: Any, *, finite_strain: bool) -> Any:
    """Return the work of the stress under u along v, per undeformed volume [MPa]; for nu well below 1/2."""
    shear, lame = material.shear_mpa, material.lame_mpa
    if not finite_strain:
        return 2.0 * shear * ng.InnerProduct(_strain(u), _strain(v)) + lame * ng.div(u) * ng.div(v)
    gradient, cofactor, volume = _deformation(u)
    stress = shear * (gradient - cofactor / volume) + lame * (volume - 1.0) * cofactor
    return ng.InnerProduct(stress, ng.Grad(v))


def mixed_work(material: Material, u: Any, p: Any, v: Any, q: Any, *, finite_strain: bool) -> Any:
    """Return the same with p [MPa] of its own, tested by q: symmetric, and indefinite by design."""
    shear, lame = material.shear_mpa, material.lame_mpa
    if not finite_strain:
        deviator = 2.0 * shear * ng.InnerProduct(_strain(u), _strain(v))
        return deviator + p * ng.div(v) + (ng.div(u) - p / lame) * q
    gradient, cofactor, volume = _deformation(u)
    stress = shear * (gradient - cofactor / volume) + p * cofactor
    return ng.InnerProduct(stress, ng.Grad(v)) + (volume - 1.0 - p / lame) * q
