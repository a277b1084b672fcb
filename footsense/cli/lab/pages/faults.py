"""Study `faults`: every fault that a scene can have, once each; the page of `footsense lab faults`."""

from dataclasses import dataclass
from typing import Any

from footsense.frames import ELEMENTS
from footsense.lab.studies.page import Plots, Study, StudyContext
from footsense.validation.faults.fault_table import can_rows, fault_rows
from footsense.validation.faults.fault_trial import BREAKS_AT_S, DURATION_S, PASSES_AT_S


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultResults:
    """Figures of every fault, by the description of the fault.

    Attributes:
        legs: `FaultFigures` of each fault of legs, buses and feet.
        can: `CanFigures` of each fault of CAN.
    """

    legs: dict[str, dict[str, Any]]
    can: dict[str, dict[str, Any]]


def compute(context: StudyContext) -> tuple[FaultResults, Plots]:
    """Simulate a walk for every fault; return the figures of each, by the description of the fault."""
    legs = {
        words: f._asdict() | {"state": f.state.name.lower(), "cause": f.cause.name.lower()}
        for words, f in fault_rows(context.report_progress, quick=context.quick).items()
    }
    can = {words: f._asdict() for words, f in can_rows(context.report_progress, quick=context.quick).items()}
    return FaultResults(legs=legs, can=can), {}


def _elements(mask: int) -> str:
    """Return the numbers of the elements in a mask."""
    named = [str(element) for element in range(ELEMENTS) if mask >> element & 1]
    return "all" if len(named) == ELEMENTS else " ".join(named) or "-"


def _ms(time_s: float | None) -> str:
    return "-" if time_s is None else f"{1e3 * time_s:.0f}"


def _camel(name: str) -> str:
    return name.title().replace("_", "")


STUDY = Study(
    name="faults",
    title="Effect of every fault",
    compute=compute,
    names={
        "BREAKS_AT_S": f"{BREAKS_AT_S:g}",
        "DURATION_S": f"{DURATION_S:g}",
        "PASSES_AT_S": f"{PASSES_AT_S:g}",
        "camel": _camel,
        "elements": _elements,
        "ms": _ms,
    },
    command="faults",
)
