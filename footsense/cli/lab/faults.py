"""`footsense lab faults`: what every fault shows on CAN, how soon, what recovers, and what the other legs notice."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense.cli.lab.options import released_folder, require_writable, stopwatch_report
from footsense.frames import ELEMENTS, Cause
from footsense.validation.can_trial import CanFigures
from footsense.validation.fault_table import CanTrial, Trial, can_rows, rows
from footsense.validation.fault_trial import BREAKS_AT_S, DURATION_S, PASSES_AT_S, Figures

if TYPE_CHECKING:
    from footsense.lab.studies.page import Page, StudyContext

#: What breaks around the process, and the test that shows what becomes of it: these take a real process and real time.
_AROUND = (
    (
        "SIGKILL of loop and writer",
        "at most the last second of the recording; `recover` opens it",
        "test_process.py",
    ),
    ("disk full", "forces go on; said at once; what is written can be read", "test_process.py"),
    ("recorder or exporter killed", "forces go on", "test_process.py"),
    ("nobody reads the log", "forces go on; lines are counted as lost", "test_process.py"),
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
    """Break everything that a scene can break, once each, and print what became of it."""
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
    """Return the page with both tables."""
    from footsense.lab.studies.page import Page, table

    walked = rows(bench.say, quick=bench.quick)
    on_can = can_rows(bench.say, quick=bench.quick)
    body = f"""
Each row is a walk of {DURATION_S:g} s in virtual time through the whole service, six legs on one bus, in which
something breaks on one leg at {BREAKS_AT_S:g} s, in the middle of its stance, and is whole again at {PASSES_AT_S:g} s.
*Shown* is the time from the fault to the first frame that shows it, *recovered* that from its end to the leg's next
`Valid` force that stays. *Others' gap* is the longest time between two forces of any other leg, and *lost* how many
frames fewer they sent than in a walk in which nothing breaks; a scan is 24 ms. *Error/sigma* is the leg's largest error
over its own sigma while the fault shows, *others' error* the largest of any other leg from the fault on.

{table(_HEADER, [_row(trial, seen) for trial, seen in walked])}

The row *nothing* is the walk itself: what a scan's parabolas make of a hard touchdown, which is the largest error that
any leg has here, is there with and without a fault. A leg whose cable was off is tared anew, in its next swing; one
that held the bus is tried again after a second at the earliest, because each try costs the others a timeout. An element
that has drifted has another zero when the drift ends, and is trusted again after a tare.

### When CAN breaks

What a consumer at the other end notices, with the interface set up as `deploy/80-can0.network` does, from
{BREAKS_AT_S:g} s to {PASSES_AT_S:g} s. *Back* is the time from the end of the fault until every leg has been heard
again, *oldest* the age of the oldest measurement that arrived at all.

{table(_CAN_HEADER, [_can_row(trial, seen) for trial, seen in on_can])}

### When something breaks around the process

{table(["what", "what becomes of it", "shown by, in `tests/system/`"], [list(row) for row in _AROUND])}
"""
    values = {
        "legs": {trial.words: _plain(seen) for trial, seen in walked},
        "can": {trial.words: seen._asdict() for trial, seen in on_can},
    }
    return Page(name="faults", title="What becomes of a fault", command="faults", body=body, values=values)


_HEADER = [
    "fault",
    "state",
    "cause",
    "elements",
    "shown [ms]",
    "recovered [ms]",
    "others' gap [ms]",
    "lost",
    "error/sigma",
    "others' error [mN]",
]
_CAN_HEADER = [
    "fault",
    "heard [%]",
    "silence [ms]",
    "back [ms]",
    "under way [ms]",
    "oldest [ms]",
    "dropped",
    "bus-off",
]


def _row(trial: Trial, seen: Figures) -> list[str]:
    """Return one line of the table; a fault that nothing shows has no state."""
    shown = seen.shown_after_s is not None
    return [
        trial.words,
        seen.state.name.title().replace("_", "") if shown else "-",
        seen.cause.name.title().replace("_", "") if seen.cause is not Cause.NONE else "-",
        _elements(seen.fault_mask) if shown else "-",
        _ms(seen.shown_after_s),
        _ms(seen.recovered_after_s) if shown else "-",
        _ms(seen.worst_gap_s),
        str(seen.lost_frames),
        "-" if seen.worst_error_sigma is None else f"{seen.worst_error_sigma:.1f}",
        f"{1e3 * seen.others_worst_n:.0f}",
    ]


def _can_row(trial: CanTrial, seen: CanFigures) -> list[str]:
    return [
        trial.words,
        f"{100.0 * seen.heard_rel:.1f}",
        _ms(seen.longest_silence_s),
        _ms(seen.back_after_s),
        _ms(seen.worst_wait_s),
        _ms(seen.worst_age_s),
        str(seen.n_dropped),
        str(seen.n_bus_off),
    ]


def _plain(seen: Figures) -> dict[str, object]:
    return {**seen._asdict(), "state": seen.state.name.lower(), "cause": seen.cause.name.lower()}


def _elements(mask: int) -> str:
    """Return the elements of a mask."""
    named = [str(element) for element in range(ELEMENTS) if mask >> element & 1]
    return "all" if len(named) == ELEMENTS else " ".join(named) or "-"


def _ms(time_s: float | None) -> str:
    return "-" if time_s is None else f"{1e3 * time_s:.0f}"
