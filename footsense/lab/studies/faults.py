"""Page `faults`: every fault that a scene can have, one walk each, and what CAN says of it."""

from collections.abc import Callable, Mapping
from typing import Any

from msgspec.structs import replace

from footsense.config import DEFAULT
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.type_folders import released_names
from footsense.frames import ELEMENTS
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.report import StudyContext, Values
from footsense.lab.studies.boards.robots import robot_of
from footsense.validation import converter_kinds, disturbance_table, fault_trial
from footsense.validation.converter_kinds import simulate_converter_kinds
from footsense.validation.disturbance_table import DisturbanceFigures, simulate_disturbances
from footsense.validation.fault_table import ROBOTS, simulate_can_faults, simulate_leg_faults
from footsense.validation.fault_trial import LOAD, FaultFigures

TITLE = "Effect of every fault, and of disturbances"


#: Of each foot what was found, and the peak of its loads [N].
_OfFeet = Mapping[str, tuple[Values, float]]


def compute(context: StudyContext) -> Values:
    """Walk once with each fault on each released foot, or on the studied one if that is another; break CAN."""
    context.scene("measured_walk")
    for board in ROBOTS:
        robot_of(context, board)
    feet = [context]
    if context.foot_design.foot_type == DEFAULT.foot_type and not context.quick:
        feet += [context.foot(name) for name in released_names() if name != DEFAULT.foot_type]
    kinds = simulate_converter_kinds(context.report_progress, quick=context.quick)
    can = simulate_can_faults(context.report_progress, quick=context.quick)
    return {
        "feet": {foot.foot_design.foot_type: _of_foot(foot) for foot in feet},
        "converter_kinds": {
            kind: {clock: figures._asdict() for clock, figures in by_clock.items()}
            for kind, by_clock in kinds.items()
        },
        "can_faults": {fault: found._asdict() for fault, found in can.items()},
    }


def _of_foot(context: StudyContext) -> Values:
    """Return what faults and disturbances do to robots on one foot type."""
    foot = context.foot_design
    folder = context.files(FOOT_FILE, RESPONSE_FILE, NETWORK_FILE)
    load = replace(LOAD, peak_force_n=0.5 * foot.loads.max_n)
    foot_type = DEFAULT.foot_type if foot.foot_type == DEFAULT.foot_type else str(folder.resolve())
    legs, small = (
        simulate_leg_faults(
            context.report_progress, board, quick=context.quick, foot_type=foot_type, load=load
        )
        for board in ROBOTS
    )
    disturbed = simulate_disturbances(
        context.report_progress, quick=context.quick, foot_type=foot_type, max_n=foot.loads.max_n
    )
    return {
        "peak_vertical_force_n": load.peak_force_n,
        "leg_faults": {fault: _named(found) for fault, found in legs.items()},
        "small_board": {fault: _named(found) for fault, found in small.items()},
        "disturbances": {
            words: {scene: _named(found) for scene, found in of_scenes.items()}
            for words, of_scenes in disturbed.items()
        },
    }


def _named(found: FaultFigures | DisturbanceFigures) -> Values:
    return found._asdict() | {"state": found.state.name.lower(), "cause": found.cause.name.lower()}


def shown(values: Values) -> Values:
    """Return the rows of the tables: of each fault the worst of the feet, and what another foot says otherwise."""
    feet, first = values["feet"], next(iter(values["feet"].values()))
    cells = [cell for by_clock in values["converter_kinds"].values() for cell in by_clock.values()]
    times = ("longest_silence_s", "recovery_s", "longest_frame_delay_s", "max_age_on_arrival_s")

    def rows(table: str, row: Callable[[str, _OfFeet], tuple[str, ...]]) -> list[tuple[str, ...]]:
        return [
            row(
                words,
                {name: (foot[table][words], foot["peak_vertical_force_n"]) for name, foot in feet.items()},
            )
            for words in first[table]
        ]

    return {
        "converter": converter_kinds,
        "disturbance": disturbance_table,
        "trial": fault_trial,
        "leg_faults": rows("leg_faults", _leg_row),
        "small_board": rows("small_board", _leg_row),
        "disturbances": rows("disturbances", _disturbed_row),
        "converters": {
            key: (min(cell[key] for cell in cells), max(cell[key] for cell in cells))
            for key in ("ok_rel", "n_wrong", "scan_ms")
        },
        "can": {
            name: found | {time: _ms(found[time]) for time in times}
            for name, found in values["can_faults"].items()
        },
    }


def _leg_row(fault: str, of_feet: _OfFeet) -> tuple[str, ...]:
    found = [one for one, _ in of_feet.values()]

    def worst(key: str) -> Any:
        return max((one[key] for one in found if one[key] is not None), default=None)

    sigmas = worst("max_error_sigmas")
    return (
        fault,
        _said({name: _words(one) for name, (one, _) in of_feet.items()}),
        _ms(worst("detection_s")),
        _ms(worst("recovery_s")) if all(one["recovery_s"] is not None for one in found) else "-",
        _ms(worst("longest_gap_s")),
        str(worst("n_other_legs_lost_frames")),
        "-" if sigmas is None else f"{sigmas:.1f}",
        f"{100 * max(one['other_legs_max_error_n'] / peak_n for one, peak_n in of_feet.values()):.0f}",
    )


def _words(found: Values) -> str:
    """Return state, cause and elements of a leg."""
    if found["detection_s"] is None:
        return "-"
    named = [str(element) for element in range(ELEMENTS) if found["fault_mask"] >> element & 1]
    elements = "all" if len(named) == ELEMENTS else " ".join(named)
    return ", ".join(word for word in (_camel(found["state"]), _camel(found["cause"]), elements) if word)


def _said(of_feet: Mapping[str, str]) -> str:
    """Return what the first foot says, and what others say otherwise."""
    first, *others = of_feet.values()
    names = list(of_feet)[1:]
    return "; ".join(
        [first, *(f"{name}: {one}" for name, one in zip(names, others, strict=True) if one != first)]
    )


def _disturbed_row(words: str, of_feet: _OfFeet) -> tuple[str, ...]:
    def beside(cell: Callable[[list[Values], float], str]) -> str:
        return " / ".join(cell(list(of_scenes.values()), peak_n) for of_scenes, peak_n in of_feet.values())

    def least_within(scenes: list[Values], _: float) -> str:
        missed = any(
            one["within"] < disturbance_table.WANTED_WITHIN_REL and one["state"] == "valid" for one in scenes
        )
        return f"{min(one['within'] for one in scenes):.1%}" + (", **missed**" if missed else "")

    states = [
        ", ".join(filter(None, (_camel(one["state"]), _camel(one["cause"]))))
        for of_scenes, _ in of_feet.values()
        for one in of_scenes.values()
    ]
    return (
        words,
        beside(lambda scenes, peak_n: f"{100 * max(one['error_n'] for one in scenes) / peak_n:.1f}"),
        beside(least_within),
        beside(lambda scenes, _: f"{min(one['usable'] for one in scenes):.0%}"),
        "; ".join(dict.fromkeys(states)),
    )


def _ms(time_s: float | None) -> str:
    return "-" if time_s is None else f"{1e3 * time_s:.0f}"


def _camel(name: str) -> str:
    return "" if name == "none" else name.title().replace("_", "")
