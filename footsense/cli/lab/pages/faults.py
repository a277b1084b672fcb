"""Study `faults`: every fault that a simulated scene can contain, one run each; page of `footsense lab faults`."""

from dataclasses import dataclass
from typing import Any

from msgspec.structs import replace

from footsense.config import DEFAULT
from footsense.frames import ELEMENTS
from footsense.lab.studies.page import Plots, Study, StudyContext
from footsense.validation.faults.fault_table import simulate_can_faults, simulate_leg_faults
from footsense.validation.faults.fault_trial import BREAKS_AT_S, DURATION_S, LOAD, PASSES_AT_S


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultResults:
    """Results of the study `faults`: figures of a walk with each fault, by the fault's description.

    Attributes:
        foot_type: Name of the feet.
        peak_vertical_force_n: Largest vertical force on a foot [N]: half of that of its training.
        leg_faults: `FaultFigures` of each fault of legs, buses and feet.
        can_faults: `CanFigures` of each fault of CAN; empty for other feet than the paper's, as they do not matter
            there.
    """

    foot_type: str
    peak_vertical_force_n: float
    leg_faults: dict[str, dict[str, Any]]
    can_faults: dict[str, dict[str, Any]]


def compute(context: StudyContext) -> tuple[FaultResults, Plots]:
    """Simulate one walk per fault; return its figures by the fault's description."""
    foot = context.foot_design
    own = foot.foot_type != DEFAULT.foot_type
    load = replace(LOAD, peak_force_n=0.5 * foot.loads.max_n)
    foot_type = str(context.models.resolve()) if own else DEFAULT.foot_type
    rows = simulate_leg_faults(context.report_progress, quick=context.quick, foot_type=foot_type, load=load)
    legs = {
        words: f._asdict() | {"state": f.state.name.lower(), "cause": f.cause.name.lower()}
        for words, f in rows.items()
    }
    can = {} if own else simulate_can_faults(context.report_progress, quick=context.quick)
    return FaultResults(
        foot_type=foot.foot_type,
        peak_vertical_force_n=load.peak_force_n,
        leg_faults=legs,
        can_faults={words: f._asdict() for words, f in can.items()},
    ), {}


def _element_numbers_text(mask: int) -> str:
    """Return the element numbers of a mask as text."""
    named = [str(element) for element in range(ELEMENTS) if mask >> element & 1]
    return "all" if len(named) == ELEMENTS else " ".join(named) or "-"


def _milliseconds_text(time_s: float | None) -> str:
    """Return a time [s] as text in ms."""
    return "-" if time_s is None else f"{1e3 * time_s:.0f}"


def _camel(name: str) -> str:
    """Return a snake_case name in CamelCase."""
    return name.title().replace("_", "")


STUDY = Study(
    name="faults",
    title="Effect of every fault",
    compute=compute,
    template_names={
        "BREAKS_AT_S": f"{BREAKS_AT_S:g}",
        "DURATION_S": f"{DURATION_S:g}",
        "PASSES_AT_S": f"{PASSES_AT_S:g}",
        "camel": _camel,
        "elements": _element_numbers_text,
        "ms": _milliseconds_text,
    },
    command="faults",
)
