"""`footsense lab faults`: detection and recovery of every fault on CAN, and its effect on the other legs."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense.cli.lab.options import released_folder, require_writable, stopwatch_report
from footsense.frames import ELEMENTS, Cause
from footsense.validation.can_trial import CanFigures
from footsense.validation.fault_table import can_rows, rows
from footsense.validation.fault_trial import BREAKS_AT_S, DURATION_S, PASSES_AT_S, FaultFigures

if TYPE_CHECKING:
    from footsense.lab.studies.page import Page, StudyContext

#: Faults around the process, their effects, and the tests that show them with a real process in real time.
_AROUND = (
    (
        "SIGKILL of loop and writer",
        "at most the last second of the recording; `recover` opens it",
        "test_process.py",
    ),
    ("disk full", "forces go on; reported at once; the recording up to then can be read", "test_process.py"),
    ("recorder or exporter killed", "forces go on", "test_process.py"),
    ("no reader of the log", "forces go on; lines are counted as lost", "test_process.py"),
    ("wall clock stepped", "no force and no stamp changes", "test_process.py"),
    ("model files replaced", "nothing: they are read once, at start", "test_process.py"),
    ("anything, for hours", "no memory grows", "test_process_memory.py, `footsense soak`"),
)


@click.command()
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the page; without it ./docs/report, a quick one ./docs/report-quick.",
)
@click.option("--quick", is_flag=True, help="A few faults, in seconds.")
def faults(*, output: Path | None, quick: bool) -> None:
    """Walk with every fault that a scene can have, and print detection, recovery and effect on the other legs."""
    folder = output or Path("docs") / ("report-quick" if quick else "report")
    require_writable(folder)
    from footsense.lab.report import bind
    from footsense.lab.studies.page import StudyContext

    bench = StudyContext(models=released_folder(), quick=quick, say=stopwatch_report())
    page = write_page_of_faults(folder, bench)
    bind(folder, bench)
    click.echo(page.markdown)
    click.echo(f"wrote {folder / page.name}.md, and bound it into {folder / 'README.md'}")


def write_page_of_faults(folder: Path, bench: "StudyContext") -> "Page":
    """Make the page, write it into a folder, and return it."""
    from footsense.lab.report import timed_page

    page = timed_page(page_of_faults, bench)
    page.write(folder)
    return page


def page_of_faults(bench: "StudyContext") -> "Page":
    """Walk with every fault, and return the page with the tables."""
    from footsense.lab.studies.page import Page, table

    of_legs = rows(bench.say, quick=bench.quick)
    of_can = can_rows(bench.say, quick=bench.quick)
    leg_cells = [[words, *(cell(f) for cell in _COLUMNS.values())] for words, f in of_legs.items()]
    can_cells = [[words, *(cell(f) for cell in _CAN_COLUMNS.values())] for words, f in of_can.items()]
    body = f"""
Each row is a walk of {DURATION_S:g} s in virtual time through the whole service, six legs on one bus, with a fault on
one leg from {BREAKS_AT_S:g} s, in the middle of its stance, to {PASSES_AT_S:g} s. *Detection* is the time from the
fault to the first frame that shows it, *recovery* the time from its end to the leg's next `Valid` force that stays.
*Others' gap* is the longest time between two forces of any other leg, and *lost* how many frames fewer they sent than
in a walk without a fault; a scan is 24 ms. *Error/sigma* is the leg's largest error over its own sigma while the fault
shows, *others' error* the largest of any other leg from the fault on.

{table(["fault", *_COLUMNS], leg_cells)}

The row *nothing* is a walk without a fault: its error, the largest of any leg, is that of a scan's parabolas at a hard
touchdown, with and without a fault. A leg whose cable was off is tared again in its next swing. A leg that held the bus
is tried again after a second at the earliest, because each try costs the others a timeout. An element that has drifted
has another baseline at the end of the drift, and is used again after a tare.

### Faults of CAN

Figures of a consumer at the other end, with the interface set up as by `deploy/80-can0.network`, and a fault from
{BREAKS_AT_S:g} s to {PASSES_AT_S:g} s. *Recovery* is the time from the end of the fault until a frame of every leg has
arrived, *oldest* the age of the oldest measurement on its arrival.

{table(["fault", *_CAN_COLUMNS], can_cells)}

### Faults around the process

{table(["fault", "effect", "shown by, in `tests/system/`"], [list(row) for row in _AROUND])}
"""
    values = {
        "legs": {
            words: f._asdict() | {"state": f.state.name.lower(), "cause": f.cause.name.lower()}
            for words, f in of_legs.items()
        },
        "can": {words: f._asdict() for words, f in of_can.items()},
    }
    return Page(name="faults", title="Effect of every fault", command="faults", body=body, values=values)


def _elements(mask: int) -> str:
    """Return the numbers of the elements in a mask."""
    named = [str(element) for element in range(ELEMENTS) if mask >> element & 1]
    return "all" if len(named) == ELEMENTS else " ".join(named) or "-"


def _camel(name: str) -> str:
    return name.title().replace("_", "")


def _ms(time_s: float | None) -> str:
    return "-" if time_s is None else f"{1e3 * time_s:.0f}"


#: Columns of the tables, and the text of each figure; a fault that never shows has no state.
_COLUMNS: dict[str, Callable[[FaultFigures], str]] = {
    "state": lambda f: "-" if f.detection_s is None else _camel(f.state.name),
    "cause": lambda f: "-" if f.cause is Cause.NONE else _camel(f.cause.name),
    "elements": lambda f: "-" if f.detection_s is None else _elements(f.fault_mask),
    "detection [ms]": lambda f: _ms(f.detection_s),
    "recovery [ms]": lambda f: _ms(f.recovery_s),
    "others' gap [ms]": lambda f: _ms(f.longest_gap_s),
    "lost": lambda f: str(f.lost_frames),
    "error/sigma": lambda f: "-" if f.worst_error_sigma is None else f"{f.worst_error_sigma:.1f}",
    "others' error [mN]": lambda f: f"{1e3 * f.others_error_n:.0f}",
}
_CAN_COLUMNS: dict[str, Callable[[CanFigures], str]] = {
    "received [%]": lambda f: f"{100.0 * f.received_rel:.1f}",
    "silence [ms]": lambda f: _ms(f.longest_silence_s),
    "recovery [ms]": lambda f: _ms(f.recovery_s),
    "delay [ms]": lambda f: _ms(f.longest_delay_s),
    "oldest [ms]": lambda f: _ms(f.oldest_s),
    "dropped": lambda f: str(f.n_dropped),
    "bus-off": lambda f: str(f.n_bus_off),
}
