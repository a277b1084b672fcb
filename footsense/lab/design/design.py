"""Design of feet from requirements to files: screen candidates, choose, assess, write each `foot.yaml`."""

from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from footsense.errors import FootsenseError
from footsense.lab.design.assess import Assessment, assess_foot
from footsense.lab.design.candidates import Candidates
from footsense.lab.design.choice import choose_candidates
from footsense.lab.design.requirements import PITCH_DEG, Requirements
from footsense.lab.design.screen import LIMIT_NAMES, TRAINED_RANGE_FACTOR
from footsense.lab.design.shapes import SHEET_SIDE_OVER_RADIUS, FootShapeLibrary
from footsense.lab.evaluation.force_range import CENTRED_DEG, LEANS_DEG
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.geometry import UM_PER_MM, FootDesign
from footsense.lab.template import render

#: Predicted over required range [1]: the ranges of solved tables are up to 2 % below the predicted ones.
_RANGE_RESERVE_FACTOR = 1.02
#: Feet that are described at most, of some sizes.
_MAX_FEET = 3
#: Loads of the training that no requirement changes: those of the paper's foot.
_DEFAULT_LOAD_RANGE = {
    "friction_angle_deg": 35,
    "typical_lean_deg": 10,
    "min_elevation_deg": 30,
    "centred_share": 0.5,
}


class DesignedFoot(NamedTuple):
    """A chosen foot.

    Attributes:
        name: Its foot type.
        text: Its description, the content of `foot.yaml`.
        design: The foot.
        rubber: Name of the ball's rubber.
        sheet: Name of the sheet's material.
        figures: Its predicted figures.
        limiting_factor: What ends its range.
    """

    name: str
    text: str
    design: FootDesign
    rubber: str
    sheet: str
    figures: Assessment
    limiting_factor: str

    @property
    def cells(self) -> dict[str, str]:
        """The foot's column of the printed table, by row name."""
        one, design = self.figures, self.design
        return {
            "ball [mm]": f"{2.0 * design.ball_radius_mm:g}",
            "rubber": f"{self.rubber}, {design.rubber.youngs_mpa:g} MPa",
            "sheet": f"{self.sheet}, {design.pdms.youngs_mpa:g} MPa",
            "plate [mm]": f"{design.plate_mm:g}",
            "gap [um]": f"{design.gap_um:g}",
            "film [um]": f"{design.film_um:g}",
            "pitch [mm]": f"{design.pitch_mm:g}",
            "electrode [mm]": f"{design.electrode_mm:g}",
            "cavity": design.cavity,
            "unloaded [pF]": f"{one.unloaded_pf:.2f}",
            "range, designed [N]": f"{one.design_range_n:.3g}",
            **{
                f"  upright, leaning {lean:g}": f"{range_n:.3g}"
                for lean, range_n in zip(LEANS_DEG, one.upright_range_n, strict=True)
            },
            f"  centred, {CENTRED_DEG:g} deg": f"{one.centred_range_n:.3g}",
            "limited by": self.limiting_factor,
            **{
                f"noise at {load_n:.3g} N": f"{deg:.2g} deg, {100.0 * rel:.2g} %"
                for load_n, deg, rel in zip(
                    one.load_levels_n,
                    one.direction_error_bound_deg,
                    one.magnitude_error_bound_rel,
                    strict=True,
                )
            },
            "made, calibrated": f"{one.calibrated_direction_error_deg:.2g} deg, "
            f"{100.0 * one.calibrated_magnitude_error_rel:.2g} %",
        }

    def json_values(self) -> dict[str, Any]:
        """Return the foot and its predicted figures as JSON values."""
        foot = msgspec.to_builtins(self.design)
        return {"name": self.name, "foot": foot, "limit": self.limiting_factor, **self.figures._asdict()}

    def write(self, folder: Path) -> Path:
        """Write the description into a folder of the foot's name and return its path.

        Raises:
            FootsenseError: The folder cannot be written to.
        """
        path = folder / self.name / FOOT_FILE
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self.text, encoding="utf-8")
        except OSError as error:
            raise FootsenseError(
                f"{path.parent}: cannot be written to: {error.strerror}; choose another folder"
            ) from error
        return path


def design(requirements: Requirements, name: str) -> tuple[list[DesignedFoot], int]:
    """Return the most accurate foot of each of some sizes that meets the requirements, and how many were compared.

    Args:
        requirements: The input.
        name: Beginning of the foot types' names; the diameter of the ball follows.

    Raises:
        FootsenseError: No foot works.
    """
    library = FootShapeLibrary()
    choice = choose_candidates(library, requirements, _MAX_FEET)
    feet, candidates, materials = [], choice.manufacturable, requirements.materials
    for rows in choice.rows_to_assess:
        own = f"{name}-{2.0 * candidates.ball_radius_mm[rows[0]]:g}mm".replace(".", "-")
        for row in map(int, rows):
            about = f"A foot for normal loads up to {requirements.max_load_n:.3g} N"
            text = foot_text(own, about, candidates, row, requirements)
            foot = load_foot(text.encode())
            figures = assess_foot(foot, library.response(foot), requirements)
            if figures.design_range_n >= _RANGE_RESERVE_FACTOR * requirements.max_load_n:
                rubber = materials.rubbers[int(candidates.rubber[row])].name
                sheet = materials.sheets[int(candidates.sheet[row])].name
                limit = LIMIT_NAMES[int(choice.screened.limiting_factor_index[row])]
                feet.append(DesignedFoot(own, text, foot, rubber, sheet, figures, limit))
                break
    if not feet:
        raise FootsenseError(
            f"--max-load {requirements.max_load_n:g} and --ball conflict: feet of these sizes come near and do not "
            f"reach it; nearest that works: --max-load {0.95 * requirements.max_load_n:.3g}"
        )
    return feet, choice.n_all_candidates


def foot_text(name: str, description: str, feet: Candidates, row: int, requirements: Requirements) -> str:
    """Return the content of `foot.yaml` for a chosen candidate, ready for `footsense lab build`.

    Args:
        name: Name of the foot type.
        description: Short description.
        feet: The candidates.
        row: The chosen one.
        requirements: The input, for materials and loads.
    """
    radius_mm, plate_mm, gap_um = (
        float(values[row]) for values in (feet.ball_radius_mm, feet.plate_mm, feet.gap_um)
    )
    # The outer elements end where the sheet does, open to its edge: a strip beside them, however narrow, would join the
    # plates there and take a quarter off the closures.
    sheet_mm = round(SHEET_SIDE_OVER_RADIUS * radius_mm, 2)
    pitch_mm = round(float(feet.pitch_mm[row]), 2)
    film = requirements.process.film[int(feet.film[row])]
    lengths = {
        "ball_radius_mm": radius_mm,
        "sheet_mm": sheet_mm,
        "plate_mm": plate_mm,
        "spacer_mm": round((gap_um + film.um) / UM_PER_MM, 5),
        "pitch_mm": pitch_mm,
        "electrode_mm": round(sheet_mm - 2.0 * pitch_mm, 2),
        "gap_um": gap_um,
        "film_um": film.um,
        "film_eps_r": film.eps_r,
    }
    solids = {
        "rubber": requirements.materials.rubbers[int(feet.rubber[row])],
        "pdms": requirements.materials.sheets[int(feet.sheet[row])],
    }
    loads = {"max_n": float(f"{TRAINED_RANGE_FACTOR * requirements.max_load_n:.3g}"), **_DEFAULT_LOAD_RANGE}
    names = {
        "name": name,
        "description": description,
        "asked": requirements,
        "PITCH_DEG": PITCH_DEG,
        "lengths": lengths,
        "solids": solids,
        "loads": loads,
    }
    return render("lab/design/foot.yaml", names)
