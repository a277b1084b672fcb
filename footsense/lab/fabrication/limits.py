"""Checks that a foot can be made: which requirements conflict, and the nearest values that work."""

import math
from collections.abc import Iterator

from footsense.lab.design.processes import AssumedProcess
from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.electronics import has_element_lines
from footsense.lab.fabrication.parts.flex import Board, flexes
from footsense.lab.fabrication.tolerances import hardness_tolerance_shore_a, overlap_area_deviation_rel
from footsense.lab.geometry import UM_PER_MM, FootDesign

#: Largest deviation of the overlap of rows and columns that leaves the rubber a tolerance [1].
_SUGGESTED_AREA_DEVIATION_REL = 0.15
_ROUNDING_TOLERANCE_MM = 1e-9


def manufacturing_problems(design: FootDesign, assumed: AssumedProcess, board: Board) -> Iterator[str]:
    """Yield the reasons why a foot cannot be made, each with its key first and a remedy last.

    Args:
        design: The foot.
        assumed: What its design assumed.
        board: Its board.
    """
    yield from _sheet_problems(design, assumed, board)
    yield from _layer_and_hardness_problems(design, assumed)
    n_contacts = max(len(flex.contacts) for flex in flexes(design, board))
    least = dimensions.least_ball_radius_mm(n_contacts)
    if design.ball_radius_mm < least:
        yield (
            f"ball_radius_mm: the tail of {2.0 * dimensions.tail_half_width_mm(n_contacts):g} mm of board {board} does "
            f"not fit on the socket of a ball of {design.ball_radius_mm:g} mm; use at least {least:g}"
        )


def _sheet_problems(design: FootDesign, assumed: AssumedProcess, board: Board) -> Iterator[str]:
    """Yield the reasons why the gaps between electrodes, the spacer's bars cannot be made."""
    pitch, bar, needs = design.pitch_mm, assumed.process.bar_mm, f"process {assumed.process_name} needs"
    if has_element_lines(board) and bar < dimensions.MIN_TRACED_BAR_MM:
        bar, needs = dimensions.MIN_TRACED_BAR_MM, f"the traces of board {board} between two columns need"
    leave = f"electrodes of {design.electrode_mm:g} mm at a pitch of {pitch:g} mm leave"
    if design.bar_mm < dimensions.MIN_NET_CLEARANCE_MM - _ROUNDING_TOLERANCE_MM:
        yield (
            f"electrode_mm: {leave} {design.bar_mm:.3g} mm between the nets, a flex needs "
            f"{dimensions.MIN_NET_CLEARANCE_MM:g} and the spacer's bars {bar:g}; use at most {pitch - bar:g}"
        )
    if design.bar_mm < bar - _ROUNDING_TOLERANCE_MM:
        yield (
            f"electrode_mm: {leave} bars of {design.bar_mm:.3g} mm in the spacer, {needs} "
            f"{bar:g}; use at most {pitch - bar:g}"
        )


def _layer_and_hardness_problems(design: FootDesign, assumed: AssumedProcess) -> Iterator[str]:
    """Yield the reasons why gap, film or spacer cannot be made, or why no hardness tolerance remains."""
    gaps, films = assumed.process.gap_um, [film.um for film in assumed.process.film]
    layers = (("gap_um", design.gap_um, gaps, "gap"), ("film_um", design.film_um, films, "film"))
    for key, value, made, word in layers:
        if not min(made) <= value <= max(made):
            text = (
                f"{word}s of {min(made):g} to {max(made):g} um"
                if min(made) < max(made)
                else f"{made[0]:g} um"
            )
            nearest = f"at least {min(made):g}" if value < min(made) else f"at most {max(made):g}"
            process = assumed.process_name
            yield f"{key}: a {word} of {value:g} um cannot be made, process {process} makes {text}; use {nearest}"
    filled_um, spacer_um = design.gap_um + design.film_um, UM_PER_MM * design.spacer_mm
    if abs(filled_um - spacer_um) > UM_PER_MM * _ROUNDING_TOLERANCE_MM:
        yield (
            f"spacer_mm: film and spacer are two layers of {design.film_um:g} and {design.gap_um:g} um, together not "
            f"{spacer_um:g} um; use {filled_um / UM_PER_MM:g}"
        )
    if hardness_tolerance_shore_a(design, assumed.rms_deviations) <= 0.0:
        overlap_rel = overlap_area_deviation_rel(design.electrode_mm)
        least = design.electrode_mm * overlap_rel / _SUGGESTED_AREA_DEVIATION_REL
        yield (
            f"electrode_mm: an offset of {dimensions.FLEX_OFFSET_TOLERANCE_MM:g} mm of electrodes of "
            f"{design.electrode_mm:g} mm changes their overlap by "
            f"{overlap_rel:.0%}, more than the design assumes; "
            f"use at least {math.ceil(100.0 * least) / 100.0:g}"
        )
