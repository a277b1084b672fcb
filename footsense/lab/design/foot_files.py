"""A chosen foot, and the writer of `foot.yaml`, its description, ready for `footsense lab build`."""

from pathlib import Path
from typing import Any, NamedTuple

from footsense.errors import FootsenseError
from footsense.lab.design.candidates import Candidates
from footsense.lab.design.inputs.requirements import Requirements
from footsense.lab.design.prediction.assess import Assessment
from footsense.lab.design.prediction.shapes import SHEET_SIDE_OVER_RADIUS
from footsense.lab.design.screen import TRAINED_RANGE_FACTOR
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.geometry import UM_PER_MM, FootDesign

#: Loads of the training that no requirement changes: those of the paper's foot.
_DEFAULT_LOAD_RANGE = {
    "friction_angle_deg": 35,
    "typical_lean_deg": 10,
    "min_elevation_deg": 30,
    "centred_share": 0.5,
}


class DesignedFoot(NamedTuple):
    """A chosen foot: path of its description, predicted figures, and the factor that limits its range.

    Attributes:
        name: Its foot type.
        candidate_row: Its row among the candidates.
        path: Its description.
        design: The foot.
        figures: Its predicted figures.
        limiting_factor: What ends its range.
    """

    name: str
    candidate_row: int
    path: Path
    design: FootDesign
    figures: Assessment
    limiting_factor: str


def foot_text(name: str, description: str, feet: Candidates, row: int, requirements: Requirements) -> str:
    """Return the content of `foot.yaml` for a chosen candidate.

    Args:
        name: Name of the foot type.
        description: Short description.
        feet: The candidates.
        row: The chosen one.
        requirements: The input, for materials and loads.
    """
    foot = {field: float(getattr(feet, field)[row]) for field in ("ball_radius_mm", "plate_mm", "gap_um")}
    # The outer elements end where the sheet does, open to its edge: a strip beside them, however narrow, would join the
    # plates there and take a quarter off the closures.
    sheet_mm = round(SHEET_SIDE_OVER_RADIUS * foot["ball_radius_mm"], 2)
    pitch_mm = round(float(feet.pitch_mm[row]), 2)
    film = requirements.process.film[int(feet.film[row])]
    rubber, sheet = (
        requirements.materials.rubbers[int(feet.rubber[row])],
        requirements.materials.sheets[int(feet.sheet[row])],
    )
    lengths: dict[str, Any] = {
        "ball_radius_mm": foot["ball_radius_mm"],
        "sheet_mm": sheet_mm,
        "plate_mm": foot["plate_mm"],
        "spacer_mm": round((foot["gap_um"] + film.um) / UM_PER_MM, 5),
        "pitch_mm": pitch_mm,
        "electrode_mm": round(sheet_mm - 2.0 * pitch_mm, 2),
        "gap_um": foot["gap_um"],
        "film_um": film.um,
        "film_eps_r": film.eps_r,
    }
    solids = {"rubber": rubber, "pdms": sheet}
    loads = {"max_n": float(f"{TRAINED_RANGE_FACTOR * requirements.max_n:.3g}"), **_DEFAULT_LOAD_RANGE}
    title = (
        f"# Designed for {requirements.min_evaluated_force_n:.3g} to {requirements.max_n:.3g} N up to "
        f"{requirements.max_force_to_leg_axis_deg:g} deg from the leg, board {requirements.board.name}."
    )
    lines = [
        title,
        f"foot_type: {name}",
        f"about: {description}",
        "",
        *(f"{key}: {value:g}" for key, value in lengths.items()),
        "cavity: vented",
        "",
        *(
            f"{key}: {{youngs_mpa: {one.material.youngs_mpa:g}, poisson: {one.poisson:g}}}   # {one.name}: {one.source}"
            for key, one in solids.items()
        ),
        "",
        "loads:",
        *(f"  {key}: {value:g}" for key, value in loads.items()),
    ]
    return "\n".join(lines) + "\n"


def write_foot(folder: Path, text: str) -> Path:
    """Write `foot.yaml` into a folder and return its path.

    Raises:
        FootsenseError: The folder cannot be written to.
    """
    path = folder / FOOT_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise FootsenseError(
            f"{folder}: cannot be written to: {error.strerror}; choose another folder"
        ) from error
    return path
