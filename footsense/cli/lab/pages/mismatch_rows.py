"""Rows of the study `mismatch`: feet that differ from their calibration's model, each in one way."""

from dataclasses import dataclass

from footsense.lab.fem.whole import Imperfection
from footsense.lab.geometry import ThinFilm
from footsense.lab.monte_carlo.sweeps import PAPER_LIKE_TOLERANCES
from footsense.lab.other_solids import ALTERNATIVE_MESH, AS_DESIGNED, DesignVariant
from footsense.sim.reference_sensor import MAX_NONLINEARITY_REL
from footsense.validation.mismatch_trial import UNDISTURBED, Disturbance


@dataclass(frozen=True, slots=True, kw_only=True)
class MismatchRow:
    """One kind of mismatch between a foot and the model of its calibration.

    Attributes:
        title: What differs, in words.
        solid: The true solid.
        disturbance: What else is true.
        is_representable: Whether the parameters of a calibration can represent it; else a warning is wanted.
    """

    title: str
    solid: DesignVariant = AS_DESIGNED
    disturbance: Disturbance = UNDISTURBED
    is_representable: bool = True


def _assembly_row(title: str, imperfection: Imperfection, *, represented: bool = True) -> MismatchRow:
    """Return the row of feet with one assembly error."""
    return MismatchRow(
        title=title, solid=DesignVariant(imperfection=imperfection), is_representable=represented
    )


#: The rows by name; the first is the foot that the calibration supposes.
MISMATCH_ROWS = {
    "none": MismatchRow(title="none: the foot that the calibration supposes"),
    "mesh": MismatchRow(title="solved on another mesh", solid=DesignVariant(mesh_size=ALTERNATIVE_MESH)),
    "plate": MismatchRow(title="plates 10 % thicker", solid=DesignVariant(plate_thickness_factor=1.1)),
    "pdms": MismatchRow(title="PDMS 30 % stiffer", solid=DesignVariant(sheet_modulus_factor=1.3)),
    "poisson": MismatchRow(
        title="Poisson's ratio of the rubber 0.47", solid=DesignVariant(rubber_poisson=0.47)
    ),
    "offset": _assembly_row("sheet off centre by 0.6 mm", Imperfection(sheet_offset_mm=(0.6, 0.0))),
    "offset-far": _assembly_row(
        "sheet off centre by 1.5 mm", Imperfection(sheet_offset_mm=(1.5, 0.0)), represented=False
    ),
    "turn": MismatchRow(title="sheet turned by 3 deg", disturbance=Disturbance(sheet_rotation_deg=3.0)),
    "wedge": _assembly_row("wedge of glue, 0 to 0.1 mm", Imperfection(glue_wedge_mm=0.1)),
    "bubble": _assembly_row(
        "bubble of 1.5 mm in the rubber",
        Imperfection(bubble_centre_and_radius_mm=(2.5, -1.5, -2.0, 0.75)),
        represented=False,
    ),
    "bar": _assembly_row(
        "one bar bonded over half its width", Imperfection(bonded_width_share=0.5), represented=False
    ),
    "bar-open": _assembly_row("one bar not bonded", Imperfection(bonded_width_share=0.01), represented=False),
    "worn": MismatchRow(
        title="ball worn flat by 0.3 mm",
        disturbance=Disturbance(worn_cap_height_mm=0.3),
        is_representable=False,
    ),
    "creep": MismatchRow(title="creep 3 times that assumed", disturbance=Disturbance(creep_factor=3.0)),
    "play": MismatchRow(title="play 3 times that assumed", disturbance=Disturbance(hysteresis_factor=3.0)),
    "touchdown": MismatchRow(
        title="floor adds 0.05 to 0.2 pF",
        disturbance=Disturbance(max_ground_capacitance_pf=0.2),
        is_representable=False,
    ),
    "microphonics": MismatchRow(
        title="cables in motion, 5 fF rms",
        disturbance=Disturbance(cable_noise_pf=5e-3),
        is_representable=False,
    ),
    "reference": MismatchRow(
        title="reference off by its linearity of 1.5 %",
        disturbance=Disturbance(reference_nonlinearity_rel=MAX_NONLINEARITY_REL),
    ),
    "stand": MismatchRow(
        title="test stand of the page error-causes",
        disturbance=Disturbance(
            press_lean_rms_deg=PAPER_LIKE_TOLERANCES.press_lean_deg,
            press_mean_noise_rms_steps=PAPER_LIKE_TOLERANCES.reference_error_resolutions,
        ),
    ),
    "gold": MismatchRow(
        title="0.1 um of gold stiffens the plates",
        solid=DesignVariant(gold=ThinFilm(thickness_um=0.1, youngs_mpa=79e3, poisson=0.42)),
    ),
    "fringe": MismatchRow(
        title="fringe fields at the electrodes", disturbance=Disturbance(has_fringe_field=True)
    ),
}
