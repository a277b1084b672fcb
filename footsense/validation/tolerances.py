"""What is tolerated of a walk with faults: no more than the fault table of its feet has measured, leg by leg.

A leg that lost its baseline is tared in its next swing. The table's robot always has one ahead; here the swings are
those of the walk, so that a leg is given the table's longest recovery, and from there the end of a swing that is long
enough for a tare.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from footsense.config import Config
from footsense.errors import ModelError
from footsense.estimation.tare import SETTLING_SCANS
from footsense.frames import Vector
from footsense.regular_file import read_regular
from footsense.sim.faults.scene_faults import (
    BrokenColumn,
    BrokenRow,
    CanFault,
    Disturbance,
    ElementOpen,
    ElementShorted,
    Fault,
    FootDamage,
    GapClosed,
    StuckSda,
    StuckUpstreamBus,
    WireFault,
)
from footsense.validation.disturbance_table import DISTURBANCES, WANTED_WITHIN_REL

#: Fault tables of all feet, of the page of the report, and their entries by board.
_TABLE_FILE = Path(__file__).parents[2] / "docs" / "report" / "faults.json"
_BOARD_ENTRIES = {"ad7147": "leg_faults", "fdc1004": "small_board"}
#: Rows of the table that are no measure of the others: they stop a bus, which costs its other legs a time of its own,
#: or turn the forces of all legs.
_STOPS_BUS = ("SDA held low", "the same", "mux keeps")
#: Damage that is found whatever the foot carries.
BROKEN_ELEMENT_TYPES = (ElementOpen, ElementShorted, GapClosed, BrokenRow, BrokenColumn)
#: Rows of it.
_BROKEN_ROWS = ("element open", "element shorted", "gap full", "row line", "column line")
#: Row of a leg whose converter is configured anew.
_STARTED_ROW = "supply dips: all settings lost"
#: Step in which the truth is searched for swings [s].
_SWING_STEP_S = 5e-3
_NS_PER_S = 1_000_000_000


class MeasuredWorst(NamedTuple):
    """The worst of the rows of a fault table, of one board.

    Attributes:
        detection_s: Until a broken element is found [s].
        recovery_s: From the end of a fault until the leg has forces again [s].
        gap_s: Longest time between two forces of another leg [s], and where a bus is stopped.
        stopped_bus_gap_s: The same where a bus is stopped [s].
        error_n: Largest error of a leg without a fault [N].
        unseen: Kinds of disturbances, as of `_kind`, that sigma does not cover on the page while they last.
        frame_s: Longest time between two frames while a leg is started, as where an element needs another range [s].
    """

    detection_s: float
    recovery_s: float
    gap_s: float
    stopped_bus_gap_s: float
    error_n: float
    unseen: frozenset[tuple[type[Fault], float]]
    frame_s: float

    @classmethod
    def of(cls, config: Config) -> "MeasuredWorst":
        """Return the worst of the table of a robot's feet and board.

        Raises:
            ModelError: Its foot type has no fault table.
        """
        try:
            feet: dict[str, Any] = msgspec.json.decode(read_regular(_TABLE_FILE))["feet"]
        except OSError:
            raise ModelError(f"{_TABLE_FILE}: no such file; the soak needs a clone of footsense") from None
        rows: dict[str, dict[str, Any]] = feet[config.foot_type][_BOARD_ENTRIES[config.board]]
        stopping = {words: row for words, row in rows.items() if words.startswith(_STOPS_BUS)}
        others = [row for words, row in rows.items() if words not in stopping]
        broken = [row for words, row in rows.items() if words.startswith(_BROKEN_ROWS)]
        return cls(
            detection_s=max(row["detection_s"] for row in broken),
            recovery_s=max(row["recovery_s"] or 0.0 for row in rows.values()),
            gap_s=max(row["longest_gap_s"] for row in others),
            stopped_bus_gap_s=max(row["longest_gap_s"] for row in stopping.values()),
            error_n=max(row["other_legs_max_error_n"] for row in others),
            unseen=frozenset(
                _kind(DISTURBANCES[words][0])
                for words, of_scenes in feet[config.foot_type]["disturbances"].items()
                if min(one["within"] for one in of_scenes.values()) < WANTED_WITHIN_REL
                and DISTURBANCES[words]
            ),
            frame_s=rows[_STARTED_ROW]["longest_gap_s"],
        )


class WalkLimits(NamedTuple):
    """Limits of the checks of a walk.

    Attributes:
        legs: Names of the legs.
        buses: Names of the legs of each bus.
        cycle_period_s: Period of the cycles without faults [s].
        scan_s: Time of a scan [s].
        max_age_s: Age limit of a force [s].
        cycles_per_can_force: Cycles for each force on CAN.
        bit_s: Duration of a bit on CAN [s].
        worst: What the fault table has measured.
        swings_s: Begin and end of the swings of each leg that are long enough for a tare [s].
        largest_n: Largest force along a leg [N].
    """

    legs: tuple[str, ...]
    buses: tuple[tuple[str, ...], ...]
    cycle_period_s: float
    scan_s: float
    max_age_s: float
    cycles_per_can_force: int
    bit_s: float
    worst: MeasuredWorst
    swings_s: tuple[tuple[tuple[float, float], ...], ...]
    largest_n: float

    @classmethod
    def of(cls, config: Config, true_force_n_at: Callable[[int], Vector], until_s: float) -> "WalkLimits":
        """Return the limits of the walk of a robot.

        Args:
            config: The robot.
            true_force_n_at: Returns the true force on every foot at a time [ns -> N, shape (legs, 3)].
            until_s: End of the walk [s].

        Raises:
            ModelError: Its foot type has no fault table.
        """
        scan_s = config.shortest_scan_ms * 1e-3
        t_s = np.arange(0.0, until_s, _SWING_STEP_S)
        true_n = np.array([true_force_n_at(round(at_s * _NS_PER_S)) for at_s in t_s.tolist()])
        shortest_s = scan_s * (config.tare.window_scans + SETTLING_SCANS)
        return cls(
            legs=config.legs,
            buses=tuple(tuple(bus.channels) for bus in config.buses),
            cycle_period_s=1.0 / config.frames_hz,
            scan_s=scan_s,
            max_age_s=config.effective_max_age_ms * 1e-3,
            cycles_per_can_force=config.effective_publish_every,
            bit_s=config.can.bit_ns * 1e-9,
            worst=MeasuredWorst.of(config),
            swings_s=tuple(_swings_s(true_n[:, leg], shortest_s) for leg in range(len(config.legs))),
            largest_n=float(true_n.max()),
        )

    def ready_s(self, leg: str, t_s: float) -> float:
        """Return when a leg has been tared that lost its baseline until a time [s]; infinite for never."""
        swings_s = self.swings_s[self.legs.index(leg)]
        return next((end_s for start_s, end_s in swings_s if start_s >= t_s), math.inf)


def _kind(fault: Fault) -> tuple[type[Fault], float]:
    return type(fault), getattr(fault, "amplitude_ff", 0.0)


def _swings_s(force_n: Vector, shortest_s: float) -> tuple[tuple[float, float], ...]:
    """Return begin and end of the spans of at least a length in which a foot has no force, shape (n, 3) [s]."""
    is_free = (force_n == 0.0).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], is_free, [False])).astype(int)))
    spans_s = _SWING_STEP_S * edges.reshape(-1, 2)
    long_s = spans_s[spans_s[:, 1] - spans_s[:, 0] >= shortest_s]
    return tuple((start_s, last_s) for start_s, last_s in long_s.tolist())


def end_s(fault: Fault) -> float:
    """Return the end of a fault [s]: its start, where it happens once."""
    return getattr(fault, "until_s", None) or fault.at_s


def acts_on(rules: WalkLimits, fault: Fault, leg: str) -> bool:
    """Return whether a fault is of a leg or its bus."""
    if isinstance(fault, Disturbance):
        return leg in fault.legs
    if isinstance(fault, StuckSda):
        return any(leg in bus and fault.leg in bus for bus in rules.buses)
    if isinstance(fault, WireFault):
        return leg in rules.buses[fault.bus]
    return getattr(fault, "leg", None) == leg


def tolerated_spans_s(rules: WalkLimits, script: Sequence[Fault], leg: str) -> list[tuple[float, float]]:
    """Return the time spans [s] in which a leg may lack a force: before its first tare, its faults and recoveries.

    Faults that overlap have one recovery each.
    """
    spans = [(0.0, rules.ready_s(leg, 0.0))]
    last_s, recovery_s = 0.0, 0.0
    own = [fault for fault in script if not isinstance(fault, CanFault) and acts_on(rules, fault, leg)]
    for fault in sorted(own, key=lambda fault: fault.at_s):
        if fault.at_s > last_s + recovery_s:
            recovery_s = 0.0
        recovery_s += rules.worst.recovery_s
        last_s = max(last_s, end_s(fault))
        spans.append((fault.at_s, rules.ready_s(leg, last_s + recovery_s)))
    return spans


def tolerated_gaps_s(rules: WalkLimits, script: Sequence[Fault]) -> list[tuple[float, float, float]]:
    """Return start, end and length [s] of the gaps that each fault of the I2C may make between two frames or forces."""
    gaps = []
    for fault in script:
        if isinstance(fault, CanFault | Disturbance | FootDamage):
            continue
        stops = isinstance(fault, StuckSda | StuckUpstreamBus)
        gap_s = rules.worst.stopped_bus_gap_s if stops else rules.worst.gap_s
        gaps.append((fault.at_s, end_s(fault) + rules.worst.recovery_s, gap_s))
    return gaps


def broken_spans_s(rules: WalkLimits, script: Sequence[Fault], leg: str) -> list[tuple[float, float]]:
    """Return the time spans [s] in which a leg must not be `Valid`: a broken element of it has been found."""
    found_s = rules.worst.detection_s + rules.scan_s
    return [
        (fault.at_s + found_s, end_s(fault))
        for fault in script
        if isinstance(fault, BROKEN_ELEMENT_TYPES)
        and fault.leg == leg
        and end_s(fault) > fault.at_s + found_s
    ]


def wrong_force_spans_s(rules: WalkLimits, script: Sequence[Fault], leg: str) -> list[tuple[float, float]]:
    """Return the time spans [s] in which the force of a leg may be wrong: from a fault's begin, and end, to a swing.

    A shift of readings along a pattern that a load has too shows in the next swing, and is in sigma from then on,
    unless it is so large that a foot in the air seems to stand.
    """
    spans = []
    for fault in script:
        if isinstance(fault, Disturbance | FootDamage) and acts_on(rules, fault, leg):
            last_s = end_s(fault)
            shown_s = rules.ready_s(leg, last_s if _kind(fault) in rules.worst.unseen else fault.at_s)
            spans += [(fault.at_s, shown_s), (last_s, rules.ready_s(leg, last_s))]
    return spans


def wrong_contact_spans_s(rules: WalkLimits, script: Sequence[Fault], leg: str) -> list[tuple[float, float]]:
    """Return the time spans [s] in which the contact of a leg may be wrong: what moves its readings is a load to it."""
    return [
        (fault.at_s, rules.ready_s(leg, end_s(fault)))
        for fault in script
        if isinstance(fault, Disturbance | FootDamage) and acts_on(rules, fault, leg)
    ]
