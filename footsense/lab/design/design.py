"""Design of feet from requirements to files: screen candidates, choose, assess, write each `foot.yaml`."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.errors import FootsenseError
from footsense.lab.design.assess import Assessment, assess_foot
from footsense.lab.design.requirements import PITCH_DEG, Requirements
from footsense.lab.design.screen import (
    LIMIT_NAMES,
    TRAINED_RANGE_FACTOR,
    Candidates,
    ScreeningResult,
    all_candidates,
    screen_candidates,
)
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
#: Feet of a size that may be assessed.
_MAX_ASSESSED_PER_SIZE = 12
#: Largest ball that is tried where no smaller one carries the load [mm].
_LARGEST_BALL_MM = 120.0


class Choice(NamedTuple):
    """Candidates of a design and their screening.

    Attributes:
        manufacturable: All candidates that can be made and read, n of them.
        screened: Their range and error.
        rows_to_assess: For some sizes of the ball the rows to assess, the most accurate first.
        n_all_candidates: Number of all candidates.
    """

    manufacturable: Candidates
    screened: ScreeningResult
    rows_to_assess: list[NDArray[np.intp]]
    n_all_candidates: int


def choose_candidates(library: FootShapeLibrary, requirements: Requirements, keep: int) -> Choice:
    """Return the most accurate feet of some sizes, to be assessed, after screening all candidates.

    Args:
        library: The solved shapes.
        requirements: The input.
        keep: Number of feet to choose at most.

    Raises:
        FootsenseError: No candidate works; the message names the conflicting requirements and the nearest that do not.
    """
    everything = all_candidates(requirements)
    feet = _manufacturable_candidates(library, requirements, everything)
    screened = screen_candidates(library, requirements, feet)
    works = np.flatnonzero(screened.direction_error_bound_deg <= requirements.max_noise_direction_error_deg)
    if not len(works):
        raise FootsenseError(_conflict_message(library, requirements, feet, screened))
    error = screened.direction_error_bound_deg
    radii = np.unique(feet.ball_radius_mm[works])
    spread = np.unique(np.round(np.linspace(0, len(radii) - 1, min(keep, len(radii)))).astype(int))
    of_radius = [works[feet.ball_radius_mm[works] == radius] for radius in radii[spread]]
    ranked = [rows[np.argsort(error[rows])][:_MAX_ASSESSED_PER_SIZE] for rows in of_radius]
    return Choice(feet, screened, ranked, len(everything.gap_um))


def _manufacturable_candidates(
    library: FootShapeLibrary, requirements: Requirements, feet: Candidates
) -> Candidates:
    """Return the candidates that can be fabricated, read by the board and predicted by the shape library.

    Raises:
        FootsenseError: There is none.
    """
    board, unloaded, largest_mm = requirements.board, feet.unloaded_pf, requirements.ball_diameter_range_mm[1]
    if largest_mm < board.min_ball_mm:
        raise FootsenseError(
            f"--ball {largest_mm:g} and --board {board.name} conflict: the tail of its flex does not fit on the socket "
            f"of such a ball; use a ball from {math.ceil(board.min_ball_mm)} mm"
        )
    least_bar_mm = max(requirements.process.bar_mm, board.min_bar_mm)
    bar_mm = feet.pitch_mm - feet.electrode_mm
    bars = (bar_mm >= least_bar_mm - 1e-9) & (2.0 * feet.ball_radius_mm >= board.min_ball_mm)
    widest_mm = float(bar_mm.max())
    if not bars.any():
        raise FootsenseError(
            f"--ball {largest_mm:g} and bars of at least {least_bar_mm:.3g} mm conflict: "
            f"the widest bar of such a ball has {widest_mm:.2f} mm; use a ball from "
            f"{math.ceil(largest_mm * least_bar_mm / widest_mm):.0f} mm"
        )
    read = (unloaded >= board.min_unloaded_pf) & (feet.half_closed_pf <= board.range_end_pf)
    if not (bars & read).any():
        low, high = unloaded[bars].min(), unloaded[bars].max()
        most = low >= board.range_end_pf
        share = (board.range_end_pf / low) ** 0.5 if most else (board.min_unloaded_pf / high) ** 0.5
        raise FootsenseError(
            f"--ball {requirements.ball_diameter_range_mm[0]:g} {requirements.ball_diameter_range_mm[1]:g} and "
            f"--board {board.name} conflict: "
            f"elements of such balls have {low:.1f} to {high:.1f} pF, the board reads {board.min_unloaded_pf:g} to "
            f"{board.range_end_pf:.1f} pF; use a ball {'up to' if most else 'from'} "
            f"{share * requirements.ball_diameter_range_mm[0 if most else 1]:.0f} mm"
        )
    known = library.covers(feet.shape)
    if not (bars & read & known).any():
        raise FootsenseError(
            "--ball and --material conflict: plate, spacer and sheet are too far from the solved shapes, whose plates "
            "have 0.025 to 0.1 of the ball's radius and 0.2 to 1.5 of the rubber's modulus; use other materials"
        )
    return feet.select(bars & read & known)


def _conflict_message(
    library: FootShapeLibrary, requirements: Requirements, feet: Candidates, screened: ScreeningResult
) -> str:
    """Return the message naming the requirements that no candidate meets, and the nearest design that works."""
    able = screened.range_n >= requirements.max_load_n
    if able.any():
        best = int(np.nanargmin(screened.direction_error_bound_deg))
        thinnest = min(requirements.process.gap_um)
        return (
            f"--min-load {requirements.min_load_n:g} and --max-load {requirements.max_load_n:g} conflict at "
            f"--error {requirements.max_noise_direction_error_deg:g}: the noise of board {requirements.board.name} "
            f"alone gives {screened.direction_error_bound_deg[best]:.2g} deg over this range, "
            f"with the gap of {feet.gap_um[best]:g} um (the process makes {thinnest:g} um and more); "
            f"nearest that works: --error {math.ceil(10.0 * screened.direction_error_bound_deg[best]) / 10.0:g}"
        )
    best = int(np.argmax(screened.range_n))
    rubbers = requirements.materials.rubbers
    text = (
        f"--max-load {requirements.max_load_n:g} and --ball {requirements.ball_diameter_range_mm[1]:g} conflict: no "
        f"rubber and gap at hand carry more than {screened.range_n[best]:.3g} N on such a ball, the force leaning "
        f"{requirements.lean_deg:g} deg "
        f"({rubbers[int(feet.rubber[best])].name}, gap {feet.gap_um[best]:g} um, ends "
        f"by the {LIMIT_NAMES[int(screened.limiting_factor_index[best])]})"
    )
    larger = requirements._replace(
        ball_diameter_range_mm=(requirements.ball_diameter_range_mm[1], _LARGEST_BALL_MM)
    )
    try:
        others = _manufacturable_candidates(library, larger, all_candidates(larger))
    except FootsenseError:
        others = feet
    carries = screen_candidates(library, larger, others).range_n >= requirements.max_load_n
    nearest = f"--max-load {0.99 * screened.range_n[best]:.3g}"
    if carries.any():
        nearest = (
            f"--ball {requirements.ball_diameter_range_mm[0]:g} {2.0 * others.ball_radius_mm[carries].min():g}, or "
            f"{nearest}"
        )
    return f"{text}; nearest that works: {nearest}"


class DesignedFoot(NamedTuple):
    """A chosen foot.

    Attributes:
        name: Its foot type.
        text: Its description, the content of `foot.yaml`.
        design: The foot.
        rubber: Name of the ball's rubber.
        figures: Its predicted figures.
        limiting_factor: What ends its range.
    """

    name: str
    text: str
    design: FootDesign
    rubber: str
    figures: Assessment
    limiting_factor: str

    @property
    def cells(self) -> dict[str, str]:
        """The foot's column of the printed table, by row name: what its description does not say, and its kind."""
        one, design = self.figures, self.design
        return {
            "ball [mm]": f"{2.0 * design.ball_radius_mm:g}",
            "rubber": f"{self.rubber}, {design.rubber.youngs_mpa:g} MPa",
            "gap [um]": f"{design.gap_um:g}",
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
        """Write the description into a folder of the foot's name and return its path."""
        path = folder / self.name / FOOT_FILE
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.text, encoding="utf-8")
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
                limit = LIMIT_NAMES[int(choice.screened.limiting_factor_index[row])]
                feet.append(DesignedFoot(own, text, foot, rubber, figures, limit))
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
