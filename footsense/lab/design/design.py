"""Design of feet from requirements to files: screen candidates, choose, assess, write."""

from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from footsense.errors import FootsenseError
from footsense.lab.design.choice import Choice, choose_candidates
from footsense.lab.design.foot_files import DesignedFoot, foot_text, write_foot
from footsense.lab.design.inputs.requirements import Requirements
from footsense.lab.design.prediction.assess import ELEVATIONS_DEG, assess_foot
from footsense.lab.design.prediction.shapes import FootShapeLibrary
from footsense.lab.design.screen import LIMIT_NAMES
from footsense.lab.foot_file import load_foot

#: Predicted over required range [1]: the ranges of solved tables are up to 2 % below the predicted ones.
_RANGE_RESERVE_FACTOR = 1.02


class DesignResult(NamedTuple):
    """Result of a design: requirements, candidates, chosen feet and picture.

    Attributes:
        requirements: The input.
        choice: All candidates.
        feet: The chosen ones.
        picture: The picture's file.
    """

    requirements: Requirements
    choice: Choice
    feet: list[DesignedFoot]
    picture: Path

    def table_rows(self) -> dict[str, list[str]]:
        """Return the rows of the printed table of chosen feet: one formatted cell per foot, by row name."""
        table_rows: dict[str, list[str]] = {}
        max_deg = self.requirements.max_force_to_leg_axis_deg
        for foot in self.feet:
            one, design, row = foot.figures, foot.design, foot.candidate_row
            materials = self.requirements.materials
            cells = {
                "ball [mm]": f"{2.0 * design.ball_radius_mm:g}",
                "rubber": materials.rubbers[int(self.choice.manufacturable.rubber[row])].name,
                "  modulus [MPa]": f"{design.rubber.youngs_mpa:g}",
                "sheet": materials.sheets[int(self.choice.manufacturable.sheet[row])].name,
                "  modulus [MPa] ": f"{design.pdms.youngs_mpa:g}",
                "plate [mm]": f"{design.plate_mm:g}",
                "gap [um]": f"{design.gap_um:g}",
                "film [um]": f"{design.film_um:g}",
                "pitch [mm]": f"{design.pitch_mm:g}",
                "electrode [mm]": f"{design.electrode_mm:g}",
                "cavity": design.cavity,
                "unloaded [pF]": f"{one.unloaded_pf:.2f}",
                f"range to {max_deg:g} deg [N]": f"{one.all_directions_range_n:.3g}",
                **{
                    f"  at {e} deg [N]": f"{n:.3g}"
                    for e, n in zip(ELEVATIONS_DEG, one.range_by_elevation_n, strict=True)
                },
                "limited by": foot.limiting_factor,
                **{
                    f"noise at {size:.3g} N": f"{deg:.2g} deg, {100.0 * rel:.2g} %"
                    for size, deg, rel in zip(
                        one.force_levels_n,
                        one.direction_error_bound_deg,
                        one.magnitude_error_bound_rel,
                        strict=True,
                    )
                },
                "made, calibrated": (
                    f"{one.calibrated_direction_error_deg:.2g} deg, "
                    f"{100.0 * one.calibrated_magnitude_error_rel:.2g} %"
                ),
            }
            for title, cell in cells.items():
                table_rows.setdefault(title, []).append(cell)
        return table_rows

    def json_values(self) -> dict[str, Any]:
        """Return the predicted figures of the chosen feet as JSON values."""
        return {
            "max_n": self.requirements.max_n,
            "min_n": self.requirements.min_evaluated_force_n,
            "candidates": self.choice.n_all_candidates,
            "scan_s": self.requirements.board.scan_s,
            "feet": [
                {
                    "name": foot.name,
                    "foot": msgspec.to_builtins(foot.design),
                    "limit": foot.limiting_factor,
                    **foot.figures._asdict(),
                }
                for foot in self.feet
            ],
        }


def design(requirements: Requirements, name: str, keep: int, folder: Path) -> DesignResult:
    """Find feet that meet the requirements; write their `foot.yaml` files and the Pareto plot.

    Args:
        requirements: The input.
        name: Beginning of the foot types' names; the diameter of the ball follows.
        keep: Number of feet at most.
        folder: Existing folder; each foot gets one of its own in it.

    Raises:
        FootsenseError: No foot works, or a file cannot be written.
    """
    from footsense.lab.design.drawing import draw_design

    library = FootShapeLibrary()
    choice = choose_candidates(library, requirements, keep)
    feet = []
    for table_rows in choice.rows_to_assess:
        own = f"{name}-{2.0 * choice.manufacturable.ball_radius_mm[table_rows[0]]:g}mm".replace(".", "-")
        for row in map(int, table_rows):
            text = foot_text(
                own,
                f"A foot for forces up to {requirements.max_n:.3g} N",
                choice.manufacturable,
                row,
                requirements,
            )
            made = load_foot(text.encode())
            figures = assess_foot(library.response(made), requirements)
            if figures.all_directions_range_n >= _RANGE_RESERVE_FACTOR * requirements.max_n:
                path = write_foot(folder / own, text)
                feet.append(
                    DesignedFoot(
                        own,
                        row,
                        path,
                        made,
                        figures,
                        LIMIT_NAMES[int(choice.screened.limiting_factor_index[row])],
                    )
                )
                break
    if not feet:
        raise FootsenseError(
            f"--max-force {requirements.max_n:g} and --ball conflict: feet of these sizes come near and do not reach "
            f"it; "
            f"nearest that works: --max-force {0.95 * requirements.max_n:.3g}"
        )
    picture = folder / "design.png"
    draw_design(picture, choice, feet, requirements)
    return DesignResult(requirements, choice, feet, picture)
