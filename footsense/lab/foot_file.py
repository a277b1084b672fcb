"""Strict reader of `foot.yaml`, the description of a foot type; contradictory numbers are refused."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from firmware_interface.chips import fdc1004
from footsense.lab.fabrication.dimensions import MIN_SPACER_RIM_MM
from footsense.lab.geometry import MIN_FITTED_ELEVATION_DEG, MIN_TABLE_ELEVATION_DEG, UM_PER_MM, FootDesign
from footsense.strict_yaml import Problem, load

#: Name of the file in the folder of a foot type.
FOOT_FILE = "foot.yaml"
#: Least unloaded capacitance [pF]: an open line still reads a tenth of a picofarad.
MIN_UNLOADED_PF = 1.0
#: Sums of lengths may be off by this much [mm]: rounding, and nothing that can be made.
_ROUNDING_TOLERANCE_MM = 1e-9


def load_foot(source: Path | bytes) -> FootDesign:
    """Return the foot design from a YAML file or its content, after checks.

    Args:
        source: The file, or its content.

    Raises:
        ConfigError: It is missing, is not such YAML, does not fit, or contradicts itself.
    """
    return load(source, FootDesign, check=lambda design: next(_contradictions(design), None))


def _contradictions(design: FootDesign) -> Iterator[Problem]:
    """Yield a problem for each contradiction between valid numbers of a foot."""
    yield from _sheet_contradictions(design)
    yield from _gap_and_spacer_contradictions(design)
    yield from _converter_contradictions(design)
    loads, room_deg = design.loads, MIN_TABLE_ELEVATION_DEG - MIN_FITTED_ELEVATION_DEG
    if design.hertz_patch_angle_deg(loads.max_n) > room_deg:
        # The patch grows with the cube root of the force.
        most_n = loads.max_n * (room_deg / design.hertz_patch_angle_deg(loads.max_n)) ** 3
        yield Problem(
            "loads.max_n",
            f"{loads.max_n:g} N flatten {design.hertz_patch_angle_deg(loads.max_n):.0f} deg of this ball around the "
            f"contact, the response holds to {room_deg:g} deg; use at most {math.floor(most_n * 100.0) / 100.0:g}",
        )


def _sheet_contradictions(design: FootDesign) -> Iterator[Problem]:
    """Yield the contradictions of electrode, pitch, sheet and ball dimensions."""
    if design.electrode_mm >= design.pitch_mm:
        yield Problem(
            "electrode_mm",
            f"electrodes of {design.electrode_mm:g} mm overlap at a pitch of {design.pitch_mm:g} mm; "
            "use less than the pitch",
        )
    array_mm = design.array_side_mm
    if array_mm > design.sheet_mm + _ROUNDING_TOLERANCE_MM:
        yield Problem(
            "sheet_mm",
            f"an array of {array_mm:g} mm does not fit on a sheet of {design.sheet_mm:g} mm; "
            f"use at least {array_mm:g}",
        )
    strip_mm, closed_mm = 0.5 * (design.sheet_mm - array_mm), array_mm + 2.0 * MIN_SPACER_RIM_MM
    if _ROUNDING_TOLERANCE_MM < strip_mm < MIN_SPACER_RIM_MM - _ROUNDING_TOLERANCE_MM:
        yield Problem(
            "sheet_mm",
            f"a sheet of {design.sheet_mm:g} mm leaves {strip_mm:g} mm of spacer beside an array of {array_mm:g} mm, "
            f"too narrow to be cut; use {array_mm:g}, or at least {closed_mm:g}",
        )
    widest_mm = math.sqrt(2.0) * design.ball_radius_mm
    if design.sheet_mm >= widest_mm:
        yield Problem(
            "sheet_mm",
            f"the corners of a sheet of {design.sheet_mm:g} mm overhang a ball of {design.ball_radius_mm:g} mm radius; "
            f"use less than {widest_mm:.2f}",
        )


def _gap_and_spacer_contradictions(design: FootDesign) -> Iterator[Problem]:
    """Yield the contradictions of gap, film and spacer thickness."""
    spacer_um = UM_PER_MM * design.spacer_mm
    filled_um = design.gap_um + design.film_um
    if design.gap_um > spacer_um + UM_PER_MM * _ROUNDING_TOLERANCE_MM:
        yield Problem(
            "gap_um",
            f"a gap of {design.gap_um:g} um is thicker than the spacer of {spacer_um:g} um that holds it open; "
            f"use at most {spacer_um:g}",
        )
    if spacer_um > filled_um + UM_PER_MM * _ROUNDING_TOLERANCE_MM:
        yield Problem(
            "spacer_mm",
            f"a spacer of {spacer_um:g} um leaves room beside gap and film, which fill {filled_um:g} um; "
            f"use at most {filled_um / UM_PER_MM:g}",
        )


def _converter_contradictions(design: FootDesign) -> Iterator[Problem]:
    """Yield the contradictions of capacitances and converter range."""
    capacitor, most_pf = design.capacitor, fdc1004.capacitance_pf(fdc1004.CODE_MAX)
    half_pf = float(capacitor.capacitance_pf(np.array([0.5 * design.gap_um]))[0])
    if capacitor.unloaded_pf < MIN_UNLOADED_PF:
        yield Problem(
            "electrode_mm",
            f"an element has {capacitor.unloaded_pf:.2f} pF unloaded, too little to differ from an open line; "
            f"use larger electrodes, or a thinner gap or film, for at least {MIN_UNLOADED_PF:g} pF",
        )
    if half_pf > most_pf:
        yield Problem(
            "electrode_mm",
            f"an element has {half_pf:.1f} pF with its gap half closed, the converter reads up to {most_pf:.1f} pF; "
            "use smaller electrodes, or a thicker gap or film",
        )
