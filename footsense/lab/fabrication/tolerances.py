"""Checks that a foot can be made, and tolerances of parts and unloaded readings, from the deviations that were assumed.

A process has an rms deviation of gap, film, stiffness and mounting; a part has limits. Printed are twice the rms.
Size and offset of the electrodes change all elements by one factor, as a softer rubber does: elastances, and with them
the closures that the daemon computes, are in proportion to 1 over the area. They are counted as stiffness, and the
hardness of the rubber has what they leave.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from footsense.foot.gap_contact import CELLS_PER_ELEMENT, fringe_pf
from footsense.lab.design.materials import shore_a_from_modulus, youngs_mpa_of
from footsense.lab.design.processes import AssumedProcess
from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.parts.flex import Board, flexes
from footsense.lab.geometry import UM_PER_MM, FootDesign
from footsense.sim.fabrication import FootTolerances

#: Printed limit over the assumed rms [1]: 95 % of normal deviates lie within.
LIMIT_OVER_RMS = 2.0
#: Steps to which the limit of the hardness is rounded down [Shore A]; the least that a gauge can tell.
_HARDNESS_STEP_SHORE_A = 0.5
#: Largest deviation of the overlap of rows and columns that leaves the rubber a tolerance [1].
_SUGGESTED_AREA_DEVIATION_REL = 0.15
_ROUNDING_TOLERANCE_MM = 1e-9


class Tolerance(NamedTuple):
    """A toleranced dimension, with the share of the assumed deviation it uses.

    Attributes:
        name: What it is.
        nominal: Its designed value.
        max_deviation: Largest deviation to either side.
        unit: Unit of both.
        used_of_assumed: How much of the assumed quantity the limit uses up, in the unit of `max_assumed_deviation`.
        max_assumed_deviation: Largest deviation that the design assumed.
        assumed_text: What was assumed, for people.
    """

    name: str
    nominal: float
    max_deviation: float
    unit: str
    used_of_assumed: float
    max_assumed_deviation: float
    assumed_text: str

    @property
    def is_within_assumed(self) -> bool:
        """Whether the tolerance is no wider than the design assumed."""
        return self.used_of_assumed <= self.max_assumed_deviation * (1.0 + 1e-9)


def area_deviations_rel(electrode_mm: float) -> tuple[float, float]:
    """Return the largest relative deviations of a row-column overlap area by etching, and by the flexes' offset [1].

    The offset is one by the tolerance along both axes.
    """
    offset_mm = math.sqrt(2.0) * dimensions.FLEX_OFFSET_TOLERANCE_MM
    return 2.0 * dimensions.ETCH_DEVIATION_MM / electrode_mm, offset_mm / electrode_mm


def hardness_tolerance_shore_a(design: FootDesign, assumed: FootTolerances) -> float:
    """Return the hardness tolerance that remains beside the electrodes' area error [Shore A]; 0 for none."""
    by_area = math.hypot(*area_deviations_rel(design.electrode_mm))
    left = (LIMIT_OVER_RMS * assumed.stiffness_rel) ** 2 - by_area**2
    share, mpa = math.sqrt(max(left, 0.0)), design.rubber.youngs_mpa
    nominal = shore_a_from_modulus(mpa)
    room = min(
        shore_a_from_modulus(mpa * (1.0 + share)) - nominal,
        nominal - shore_a_from_modulus(mpa * (1.0 - share)),
    )
    return math.floor(room / _HARDNESS_STEP_SHORE_A) * _HARDNESS_STEP_SHORE_A


def part_tolerances(design: FootDesign, assumed: FootTolerances) -> list[Tolerance]:
    """Return the toleranced dimensions of a foot.

    Args:
        design: The foot.
        assumed: Rms deviations that the design assumed.
    """
    gap, film = LIMIT_OVER_RMS * assumed.gap_um, LIMIT_OVER_RMS * assumed.film_um
    gap_limit, film_limit = (math.floor(10.0 * value) / 10.0 for value in (gap, film))
    mount_deg, stiffness = LIMIT_OVER_RMS * assumed.mount_deg, LIMIT_OVER_RMS * assumed.stiffness_rel
    play_deg = math.degrees(
        dimensions.TAIL_CHANNEL_PLAY_PER_SIDE_MM / dimensions.socket_outer_radius_mm(design.ball_radius_mm)
    )
    side, mpa = design.electrode_mm, design.rubber.youngs_mpa
    shore, shore_limit = shore_a_from_modulus(mpa), hardness_tolerance_shore_a(design, assumed)
    by_rubber = max(abs(youngs_mpa_of(shore + s * shore_limit) / mpa - 1.0) for s in (-1.0, 1.0))
    area_text = f"stiffness +-{stiffness:.0%}"
    etched, offset = area_deviations_rel(side)
    softer = math.hypot(by_rubber, math.hypot(etched, offset))
    rubber_text, mount_text = f"{area_text}, with size and offset", f"mounting +-{mount_deg:.3g} deg"
    etch_mm, offset_mm = dimensions.ETCH_DEVIATION_MM, dimensions.FLEX_OFFSET_TOLERANCE_MM
    return [
        Tolerance("spacer (gap)", design.gap_um, gap_limit, "um", gap_limit, gap, f"gap +-{gap:.3g} um"),
        Tolerance("film", design.film_um, film_limit, "um", film_limit, film, f"film +-{film:.3g} um"),
        Tolerance("electrode side", side, etch_mm, "mm", etched, stiffness, area_text),
        Tolerance("offset of the flexes", 0.0, offset_mm, "mm", offset, stiffness, area_text),
        Tolerance("hardness", round(shore), shore_limit, "Shore A", softer, stiffness, rubber_text),
        Tolerance("angle on the leg", 0.0, round(play_deg, 2), "deg", play_deg, mount_deg, mount_text),
    ]


class ExpectedCapacitance(NamedTuple):
    """Expected reading of an unloaded element of a finished foot [pF], without the wiring's own.

    Attributes:
        plate_formula_pf: Capacitance of its plates.
        fringe_pf: Capacitance of the field at their edges.
        max_unknown_stray_pf: Largest stray capacitance that the design assumed to be unknown.
        unloaded_pf: The reading.
        min_unloaded_pf: Lowest reading within the tolerances and the assumed stray.
        max_unloaded_pf: Highest.
    """

    plate_formula_pf: float
    fringe_pf: float
    max_unknown_stray_pf: float
    unloaded_pf: float
    min_unloaded_pf: float
    max_unloaded_pf: float


def expected_capacitance(design: FootDesign, assumed: FootTolerances) -> ExpectedCapacitance:
    """Return the expected capacitance reading of an unloaded element with its limits.

    Args:
        design: The foot.
        assumed: Rms deviations that the design assumed.
    """
    capacitor = design.capacitor
    distance_um = design.gap_um + capacitor.film_equivalent_um
    limits_um = LIMIT_OVER_RMS * assumed.gap_um, LIMIT_OVER_RMS * assumed.film_um / design.film_eps_r
    spacing_um = np.full(CELLS_PER_ELEMENT, design.gap_um + design.film_um)
    plate_pf, edge_pf = capacitor.unloaded_pf, float(fringe_pf(capacitor, spacing_um)[0])
    by_area = math.hypot(*area_deviations_rel(design.electrode_mm))
    plate_rel = math.hypot(math.hypot(*limits_um) / distance_um, by_area)
    stray_pf, unloaded_pf = LIMIT_OVER_RMS * assumed.stray_pf, plate_pf + edge_pf
    low_pf = unloaded_pf - plate_pf * plate_rel - stray_pf
    high_pf = unloaded_pf + plate_pf * plate_rel + stray_pf
    return ExpectedCapacitance(plate_pf, edge_pf, stray_pf, unloaded_pf, low_pf, high_pf)


def manufacturing_problems(design: FootDesign, assumed: AssumedProcess, board: Board) -> Iterator[str]:
    """Yield the reasons why a foot cannot be made, each with its key first and a remedy last.

    Args:
        design: The foot.
        assumed: What its design assumed.
        board: Its board.
    """
    pitch, needs = design.pitch_mm, f"process {assumed.process_name} needs"
    bar = max(assumed.process.bar_mm, dimensions.MIN_NET_CLEARANCE_MM)
    if board == "ad7147" and bar < dimensions.MIN_TRACED_BAR_MM:
        bar, needs = dimensions.MIN_TRACED_BAR_MM, f"the traces of board {board} between two columns need"
    if design.bar_mm < bar - _ROUNDING_TOLERANCE_MM:
        yield (
            f"electrode_mm: electrodes of {design.electrode_mm:g} mm at a pitch of {pitch:g} mm leave bars of "
            f"{design.bar_mm:.3g} mm in the spacer, {needs} {bar:g}; use at most {pitch - bar:g}"
        )
    yield from _layer_and_hardness_problems(design, assumed)
    n_contacts = max(len(flex.contacts) for flex in flexes(design, board))
    least = dimensions.least_ball_radius_mm(n_contacts)
    if design.ball_radius_mm < least:
        yield (
            f"ball_radius_mm: the tail of {2.0 * dimensions.tail_half_width_mm(n_contacts):g} mm of board {board} does "
            f"not fit on the socket of a ball of {design.ball_radius_mm:g} mm; use at least {least:g}"
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
        overlap_rel = math.hypot(*area_deviations_rel(design.electrode_mm))
        least = design.electrode_mm * overlap_rel / _SUGGESTED_AREA_DEVIATION_REL
        yield (
            f"electrode_mm: an offset of {dimensions.FLEX_OFFSET_TOLERANCE_MM:g} mm of electrodes of "
            f"{design.electrode_mm:g} mm changes their overlap by "
            f"{overlap_rel:.0%}, more than the design assumes; "
            f"use at least {math.ceil(100.0 * least) / 100.0:g}"
        )
