"""Refusal of feet that cannot be made: which wish conflicts with which, and the nearest that works."""

import math
from collections.abc import Iterator

from footsense.errors import ConfigError
from footsense.lab.fabrication import process
from footsense.lab.fabrication.array import ElementArray
from footsense.lab.fabrication.parts.flex import flexes
from footsense.lab.fabrication.parts.sheets import has_rim
from footsense.lab.fabrication.tolerances import area_rel, hardness_limit
from footsense.lab.geometry import UM_PER_MM, FootDesign
from footsense.sim.foot.fabrication import FootTolerances

#: Lines to either side that a converter board addresses: an FDC1004 has four inputs, an ADG715 switches four lines.
BOARD_LINES = 4
#: Largest deviation of the overlap of rows and columns that leaves the rubber a tolerance [1].
_MOST_AREA_REL = 0.15
_ROUNDING = 1e-9


def require_makeable(design: FootDesign, array: ElementArray, assumed: FootTolerances) -> None:
    """Check that workshops can make a foot and that a converter board can address it.

    Args:
        design: The foot.
        array: Its array.
        assumed: Rms deviations that the design assumed.

    Raises:
        ConfigError: They cannot, or it cannot; the message begins with the key.
    """
    problem = next(problems(design, array, assumed), None)
    if problem is not None:
        raise ConfigError(problem)


def problems(design: FootDesign, array: ElementArray, assumed: FootTolerances) -> Iterator[str]:
    """Yield why a foot cannot be made, each with its key first and what would be right last.

    Args:
        design: The foot.
        array: Its array.
        assumed: Rms deviations that the design assumed.
    """
    for lines, word in ((array.row_x_mm, "rows"), (array.column_y_mm, "columns")):
        if len(lines) > BOARD_LINES:
            yield (
                f"{word}: {len(lines)} {word} do not fit the converter board: the FDC1004 has {BOARD_LINES} inputs for "
                f"columns, an ADG715 switches {BOARD_LINES} rows; use at most {BOARD_LINES}"
            )
    yield from _in_the_sheet(design, array)
    yield from _between_the_plates(design, array, assumed)
    tail_half, socket_mm = (
        _widest_tail_mm(design, array) / 2.0 + process.CHANNEL_PLAY_MM,
        process.socket_radius_mm(design.ball_radius_mm),
    )
    inside = socket_mm - process.CHANNEL_MM
    if tail_half > inside / math.sqrt(2.0) - 1.0:
        least = math.sqrt(2.0) * (tail_half + 1.0) + design.ball_radius_mm - inside
        yield (
            f"ball_radius_mm: two tails of {_widest_tail_mm(design, array):g} mm do not fit beside each other on the "
            f"socket of a ball of {design.ball_radius_mm:g} mm; use at least {math.ceil(10.0 * least) / 10.0:g}"
        )


def _in_the_sheet(design: FootDesign, array: ElementArray) -> Iterator[str]:
    pitch = array.bar_mm + array.electrode_mm
    if array.bar_mm < process.MIN_GAP_MM - _ROUNDING:
        yield (
            f"electrode_mm: electrodes of {array.electrode_mm:g} mm at a pitch of {pitch:g} mm leave "
            f"{array.bar_mm:.3g} mm between the nets, a flex needs {process.MIN_GAP_MM:g} and the spacer's bars "
            f"{process.MIN_BAR_MM:g}; use at most {pitch - process.MIN_BAR_MM:g}"
        )
    if array.bar_mm < process.MIN_BAR_MM - _ROUNDING:
        yield (
            f"electrode_mm: electrodes of {array.electrode_mm:g} mm at a pitch of {pitch:g} mm leave bars of "
            f"{array.bar_mm:.3g} mm in the spacer, a laser cuts {process.MIN_BAR_MM:g}; "
            f"use at most {pitch - process.MIN_BAR_MM:g}"
        )
    for flex in flexes(array, design.ball_radius_mm):
        if not 0.0 <= flex.steepest <= process.MAX_SLOPE:
            least = (max(flex.line_v_mm) - flex.contact_v_mm[-2]) / process.MAX_SLOPE - flex.fan_mm
            radius = math.ceil(10.0 * (design.ball_radius_mm + least)) / 10.0
            yield (
                f"ball_radius_mm: the {len(flex.line_v_mm)} traces of the {flex.kind}s do not converge to the tail "
                f"between a sheet of {array.sheet_mm:g} mm and the socket of a ball of {design.ball_radius_mm:g} mm; "
                f"use at least {radius:g}"
            )
    if not has_rim(array) and design.cavity != "vented":
        closed_mm = array.sheet_mm + 2.0 * (process.MIN_RIM_MM - array.rim_mm)
        yield (
            f"cavity: {design.cavity} cavities need a rim of {process.MIN_RIM_MM:g} mm around the array, a sheet of "
            f"{array.sheet_mm:g} mm leaves {array.rim_mm:g} mm; use sheet_mm: {closed_mm:g}, or cavity: vented"
        )


def _between_the_plates(design: FootDesign, array: ElementArray, assumed: FootTolerances) -> Iterator[str]:
    for key, value in (("gap_um", design.gap_um), ("film_um", design.film_um)):
        if value < process.MIN_SHEET_UM:
            yield (
                f"{key}: a layer of {value:g} um cannot be cast or bought; use at least {process.MIN_SHEET_UM:g}"
            )
    filled_um, spacer_um = design.gap_um + design.film_um, UM_PER_MM * design.spacer_mm
    if abs(filled_um - spacer_um) > UM_PER_MM * _ROUNDING:
        yield (
            f"spacer_mm: film and spacer are two layers of {design.film_um:g} and {design.gap_um:g} um, together not "
            f"{spacer_um:g} um; use {filled_um / UM_PER_MM:g}"
        )
    if hardness_limit(design, assumed) <= 0.0:
        least = array.electrode_mm * area_rel(array.electrode_mm) / _MOST_AREA_REL
        yield (
            f"electrode_mm: an offset of {process.REGISTRATION_MM:g} mm of electrodes of {array.electrode_mm:g} mm "
            f"changes their overlap by {area_rel(array.electrode_mm):.0%}, more than the design assumes; "
            f"use at least {math.ceil(100.0 * least) / 100.0:g}"
        )


def _widest_tail_mm(design: FootDesign, array: ElementArray) -> float:
    return max(2.0 * flex.tail_half_mm for flex in flexes(array, design.ball_radius_mm))
