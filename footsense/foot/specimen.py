"""One fabricated foot (specimen), its loads, and its response: that of its type with its deviations from the design.

The solid is the designed one but for its stiffness; gaps, films, strays and the mounting are each foot's own. The air
of a closing gap gets out freely.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np

from footsense.foot import gap_contact
from footsense.foot.directions import normalized
from footsense.foot.gap_contact import fringe_pf
from footsense.foot.response_table import FootResponse
from footsense.frames import ELEMENTS, Vector


class ContactLoads(NamedTuple):
    """Loads of a foot, or of one foot at n times: contact normals and forces [N], in the foot's or the leg's frame.

    Attributes:
        normal: Inward unit normal of the ball at the contact, shape (n, 3).
        force_n: Ground reaction on the foot [N], shape (n, 3); zero in the air.
    """

    normal: Vector
    force_n: Vector

    @classmethod
    def centred(cls, force_n: Vector) -> Self:
        """Return loads through the centre of the ball, where the contact normal is parallel to the force."""
        return cls(normalized(force_n), force_n)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations:
    """Deviations of one foot from its design: gaps, films, stray capacitances, gains, stiffness, mounting.

    Attributes:
        gap_um: Added to the gap of each element [um], shape (elements,), or (1,) for all alike.
        film_um: Added to the film of each element [um], same shapes.
        stray_pf: Capacitance in parallel with each element [pF], same shapes.
        gain_rel: Closure that each element reads over its real one, minus one [1], same shapes.
        stiffness_rel: Added to the stiffness of the whole foot [1]; the contact patch stays the designed one.
        mount: Rotation from the leg's frame to the foot's, shape (3, 3).
        fringe: Whether its electrodes have a fringe field at their edges.
    """

    gap_um: Vector = field(default_factory=lambda: np.zeros(1))
    film_um: Vector = field(default_factory=lambda: np.zeros(1))
    stray_pf: Vector = field(default_factory=lambda: np.zeros(1))
    gain_rel: Vector = field(default_factory=lambda: np.zeros(1))
    stiffness_rel: float = 0.0
    mount: Vector = field(default_factory=lambda: np.eye(3))
    fringe: bool = False


class Specimen:
    """One fabricated foot: loads to capacitances, with its deviations from the design.

    Args:
        response: Response of its type.
        deviations: Its deviations; None for a foot exactly as designed.
        contact: Whether a closed gap carries load; else closures are only limited to the gap.

    Attributes:
        response: Response of its type.
        gap_um: Gap of each element of the free foot [um], shape (elements,).
        stray_pf: Stray capacitance of each element [pF], shape (elements,) or (1,).
        unloaded_pf: Capacitance of each element of the free foot, stray included [pF], shape (elements,).

    Raises:
        ValueError: A gap, a film or the stiffness is not above 0, or the deviations are of another number of elements.
    """

    def __init__(
        self, response: FootResponse, deviations: Deviations | None = None, *, contact: bool = True
    ) -> None:
        own = deviations or Deviations()
        self.response = response
        self.gap_um = response.design.gap_um + np.broadcast_to(own.gap_um, ELEMENTS)
        film_um = response.design.film_um + np.broadcast_to(own.film_um, ELEMENTS)
        # A NaN fails every comparison.
        if not (self.gap_um.min() > 0.0 and film_um.min() > 0.0 and own.stiffness_rel > -1.0):
            raise ValueError(
                f"gaps {self.gap_um.min():g} um, films {film_um.min():g} um and stiffness "
                f"{1.0 + own.stiffness_rel:g} have to be above 0"
            )
        self._gap_of_cell_um = np.repeat(self.gap_um, gap_contact.CELLS_PER_ELEMENT)
        self._film_of_cell_um = np.repeat(film_um, gap_contact.CELLS_PER_ELEMENT) / response.design.film_eps_r
        self._relative_compliance = 1.0 / (1.0 + own.stiffness_rel)
        self._compliance_um_per_n = response.compliance_um_per_n * self._relative_compliance
        self.stray_pf = own.stray_pf
        gain = np.repeat(np.broadcast_to(1.0 + own.gain_rel, ELEMENTS), gap_contact.CELLS_PER_ELEMENT)
        self._gain_of_cell = gain if own.gain_rel.any() else None
        self._mount = own.mount
        self._contact = contact
        self._film_um = np.repeat(film_um, gap_contact.CELLS_PER_ELEMENT) if own.fringe else None
        unloaded_um = self._limited_closures_um(np.zeros((1, len(self._gap_of_cell_um))))
        self.unloaded_pf = self._capacitance_pf(unloaded_um)[0]

    def cell_closures_um(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the closure of each cell under n loads [um], shape (n, 324), limited to the cell's gap.

        Args:
            normal: Inward unit normals of the ball at the contacts, frame of the leg, shape (n, 3).
            force_n: Ground reactions on the foot [N], frame of the leg, shape (n, 3).

        Raises:
            ValueError: As `FootResponse.free_closure_um`.
        """
        return self._limited_closures_um(self._free_closures_um(normal, force_n))

    def _free_closures_um(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the cell closures as if gaps were infinitely deep [um], shape (n, 324)."""
        free_um = self.response.free_closure_um(normal @ self._mount.T, force_n @ self._mount.T)
        return self._relative_compliance * free_um

    def _limited_closures_um(self, free_um: Vector) -> Vector:
        """Return the cell closures with gap contact [um], shape (n, 324), from free closures."""
        if not self._contact:
            return np.minimum(free_um, self._gap_of_cell_um)
        return gap_contact.contact_closures_um(free_um, self._gap_of_cell_um, self._compliance_um_per_n)

    def capacitance_pf(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the capacitances under n loads [pF], shape (n, elements), with stray; as `cell_closures_um`."""
        if not force_n.any():  # a foot in swing costs nothing
            return np.tile(self.unloaded_pf, (len(force_n), 1))
        return self._capacitance_pf(self.cell_closures_um(normal, force_n))

    def capacitance_of_free_closures_pf(self, free_um: Vector) -> Vector:
        """Return the capacitances [pF], shape (n, elements), from free cell closures [um], shape (n, cells)."""
        return self._capacitance_pf(self._limited_closures_um(free_um))

    def _capacitance_pf(self, cell_closures_um: Vector) -> Vector:
        """Return the capacitances, stray included [pF], from cell closures limited to the gaps [um]."""
        if self._gain_of_cell is not None:
            cell_closures_um = np.minimum(self._gain_of_cell * cell_closures_um, self._gap_of_cell_um)
        distance_um = self._gap_of_cell_um - cell_closures_um + self._film_of_cell_um
        capacitance_pf = gap_contact.capacitance_pf(self.response.design, distance_um) + self.stray_pf
        if self._film_um is not None:
            spacing_um = self._gap_of_cell_um - cell_closures_um + self._film_um
            capacitance_pf += fringe_pf(self.response.design, spacing_um)
        return capacitance_pf
