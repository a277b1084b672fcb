"""Rows of the study `mismatch`: feet that differ from what their calibration supposes, each in one way."""

from dataclasses import dataclass

from footsense.foot.cavity.air import VENTED, Cavity
from footsense.lab.fem.whole import Imperfection
from footsense.lab.geometry import ThinFilm
from footsense.lab.monte_carlo.sweeps import PAPER_LIKE_TOLERANCES
from footsense.lab.other_solids import AS_DESIGNED, OTHER_MESH, OtherSolid
from footsense.sim.test_stand.reference_sensor import LINEARITY_REL
from footsense.validation.mismatch_trial import UNDISTURBED, Disturbance


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One kind of mismatch.

    Attributes:
        title: What differs, in words.
        solid: The true solid.
        disturbance: What else is true.
        cavity: How its cavities hold their air.
        represented: Whether the parameters of a calibration can represent it; else a warning is wanted.
    """

    title: str
    solid: OtherSolid = AS_DESIGNED
    disturbance: Disturbance = UNDISTURBED
    cavity: Cavity = VENTED
    represented: bool = True


def _assembled(title: str, own: Imperfection, *, represented: bool = True) -> Row:
    return Row(title=title, solid=OtherSolid(own=own), represented=represented)


#: The rows by name; the first is the foot that the calibration supposes.
ROWS = {
    "none": Row(title="none: the foot that the calibration supposes"),
    "mesh": Row(title="solved on another mesh", solid=OtherSolid(size=OTHER_MESH)),
    "plate": Row(title="plates 10 % thicker", solid=OtherSolid(plate=1.1)),
    "pdms": Row(title="PDMS 30 % stiffer", solid=OtherSolid(pdms=1.3)),
    "poisson": Row(title="Poisson's ratio of the rubber 0.47", solid=OtherSolid(poisson=0.47)),
    "offset": _assembled("sheet off centre by 0.6 mm", Imperfection(sheet_offset_mm=(0.6, 0.0))),
    "offset-far": _assembled(
        "sheet off centre by 1.5 mm", Imperfection(sheet_offset_mm=(1.5, 0.0)), represented=False
    ),
    "turn": Row(title="sheet turned by 3 deg", disturbance=Disturbance(turn_deg=3.0)),
    "wedge": _assembled("wedge of glue, 0 to 0.1 mm", Imperfection(glue_wedge_mm=0.1)),
    "bubble": _assembled(
        "bubble of 1.5 mm in the rubber", Imperfection(bubble_mm=(2.5, -1.5, -2.0, 0.75)), represented=False
    ),
    "bar": _assembled("one bar bonded over half its width", Imperfection(bonded_rel=0.5), represented=False),
    "bar-open": _assembled("one bar not bonded", Imperfection(bonded_rel=0.01), represented=False),
    "worn": Row(title="ball worn flat by 0.3 mm", disturbance=Disturbance(worn_mm=0.3), represented=False),
    "creep": Row(title="creep 3 times that assumed", disturbance=Disturbance(creep=3.0)),
    "play": Row(title="play 3 times that assumed", disturbance=Disturbance(play=3.0)),
    "touchdown": Row(
        title="floor adds 0.05 to 0.2 pF", disturbance=Disturbance(touchdown_pf=0.2), represented=False
    ),
    "microphonics": Row(
        title="cables in motion, 5 fF rms", disturbance=Disturbance(microphonics_pf=5e-3), represented=False
    ),
    "reference": Row(
        title="reference off by its linearity of 1.5 %",
        disturbance=Disturbance(reference_linearity_rel=LINEARITY_REL),
    ),
    "stand": Row(
        title="test stand of the yardstick",
        disturbance=Disturbance(
            lean_deg=PAPER_LIKE_TOLERANCES.stick_deg,
            reference_steps=PAPER_LIKE_TOLERANCES.reference_resolutions,
        ),
    ),
    "gold": Row(
        title="0.1 um of gold stiffens the plates",
        solid=OtherSolid(gold=ThinFilm(thickness_um=0.1, youngs_mpa=79e3, poisson=0.42)),
    ),
    "fringe": Row(title="fringe fields at the electrodes", disturbance=Disturbance(fringe=True)),
    "sealed": Row(title="cavities sealed", cavity=Cavity(kind="sealed"), represented=False),
    "leaking": Row(
        title="cavities leak in 1 s", cavity=Cavity(kind="leaking", leak_time_s=1.0), represented=False
    ),
}
