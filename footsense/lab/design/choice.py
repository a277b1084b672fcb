"""Choice of a few feet from screened candidates, or the conflicting requirements if none works."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.errors import FootsenseError
from footsense.lab.design.candidates import Candidates, all_candidates
from footsense.lab.design.materials import load_materials
from footsense.lab.design.requirements import Requirements
from footsense.lab.design.screen import LIMIT_NAMES, ScreeningResult, screen_candidates
from footsense.lab.design.shapes import FootShapeLibrary

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
            f"nearest that works: --min-load {_lowest_feasible_min_load_n(library, requirements, feet):.2g}"
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
    harder = requirements._replace(materials=load_materials())
    if carries.any():
        nearest = (
            f"--ball {requirements.ball_diameter_range_mm[0]:g} {2.0 * others.ball_radius_mm[carries].min():g}, or "
            f"{nearest}"
        )
    else:
        others = _manufacturable_candidates(library, harder, all_candidates(harder))
        carries = screen_candidates(library, harder, others).range_n >= requirements.max_load_n
        if carries.any():
            nearest = f"a rubber of {others.rubber_mpa[carries].min():g} MPa, or {nearest}"
    return f"{text}; nearest that works: {nearest}"


def _lowest_feasible_min_load_n(
    library: FootShapeLibrary, requirements: Requirements, feet: Candidates
) -> float:
    """Return the lowest minimum load at which some candidate meets the required error [N]."""
    low, high = np.log(requirements.min_load_n), np.log(requirements.max_load_n)
    for _ in range(8):
        middle = (low + high) / 2.0
        trial = requirements._replace(min_load_n=float(np.exp(middle)))
        bound_deg = screen_candidates(library, trial, feet).direction_error_bound_deg
        if np.nanmin(bound_deg) <= requirements.max_noise_direction_error_deg:
            high = middle
        else:
            low = middle
    return float(np.exp(high))
