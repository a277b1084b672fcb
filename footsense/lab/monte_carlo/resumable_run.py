"""Monte Carlo run over many fabricated feet that resumes from its result file.

Each finished foot is appended to a file at once, so an interrupted run continues with the missing feet. The first line
describes the run; a file of another run is refused. An unfinished last line, left by a killed writer, is cut off.
`specimens` evaluates a foot, `workers` distributes the jobs.
"""

import json
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self, TextIO

import msgspec

from footsense.errors import FootsenseError
from footsense.progress import progress_bar
from footsense.sim.fabrication import FootTolerances


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerances(FootTolerances):
    """Rms deviations of fabricated feet and of the calibrating test stand; all zero means as designed.

    Attributes:
        reading_noise_pf: Noise of each capacitance reading [pF].
        repeatability_rel: Rms scatter of each repeated capacitance change, relative to it [1].
        reference_error_resolutions: Rms error of each force component of the reference sensor, in its resolutions [1].
        press_lean_deg: Angle between contact normal and force of a load that was meant to be centred [deg].
    """

    reading_noise_pf: float = 0.0
    repeatability_rel: float = 0.0
    reference_error_resolutions: float = 0.0
    press_lean_deg: float = 0.0

    def plus_scaled(self, other: "Tolerances", factor: float) -> Self:
        """Return these tolerances plus a factor times the given ones.

        Example:
            >>> Tolerances(gap_um=1.0).plus_scaled(Tolerances(gap_um=0.5), 4.0).gap_um
            3.0
        """
        added = {name: mine + factor * getattr(other, name) for name, mine in asdict(self).items()}
        return type(self)(**added)


@dataclass(frozen=True, slots=True)
class Job:
    """One evaluation of one fabricated foot: its tolerances, number and case.

    Attributes:
        tolerances: The rms values of its distribution.
        foot: Number of the foot: the same number is the same foot, at other tolerances with the same pattern.
        with_network: Whether to train a network on its own cases, which takes longer than all the rest.
        case: What else distinguishes it, by name.
    """

    tolerances: Tolerances
    foot: int
    with_network: bool = False
    case: str = ""


#: Errors of the estimators on one foot, by name such as `network_deg`.
JobMetrics = dict[str, float]


@dataclass(frozen=True, slots=True)
class _JobResult:
    """Result of one job, one line of the result file."""

    job: Job
    figures: JobMetrics


#: Evaluates one foot; picklable, the same result each time.
JobFunction = Callable[[Job], JobMetrics]
#: Runs the jobs, and yields each as it is finished.
JobRunner = Callable[[JobFunction, Sequence[Job]], Generator[tuple[Job, JobMetrics], None, None]]


def run_resumable(
    run_description: Mapping[str, str | int],
    jobs: Sequence[Job],
    work: JobFunction,
    *,
    workers: JobRunner,
    file: Path | None = None,
) -> dict[Job, JobMetrics]:
    """Evaluate the jobs missing in the result file and append them; return the figures of all jobs.

    Args:
        run_description: Description of the run, equal for results that belong together: seed, models.
        jobs: The feet; one that comes twice is evaluated once.
        work: Evaluates one.
        workers: Run the jobs.
        file: Where results are kept (JSON lines), made if missing; None keeps none.

    Returns:
        The figures of every foot, in the order of the jobs.

    Raises:
        FootsenseError: The file holds another run, cannot be read or written, or there are no workers.
    """
    finished = {} if file is None else _prepare_and_read_results(file, run_description)
    missing = [job for job in dict.fromkeys(jobs) if job not in finished]
    if missing:
        try:
            with nullcontext() if file is None else file.open("a", encoding="utf-8") as ledger:
                _evaluate_unfinished(missing, work, workers, finished, ledger)
        except OSError as error:
            raise FootsenseError(f"the run ended early: {error}") from error
    return {job: finished[job] for job in jobs}


def _evaluate_unfinished(
    missing: Sequence[Job],
    work: JobFunction,
    workers: JobRunner,
    finished: dict[Job, JobMetrics],
    ledger: TextIO | None,
) -> None:
    """Evaluate jobs and append each result to the file, with a progress bar on a terminal."""
    with (
        progress_bar("feet", len(finished) + len(missing)) as feet_done,
        closing(workers(work, missing)) as finishing,
    ):
        feet_done(len(finished))
        for job, figures in finishing:
            finished[job] = figures
            if ledger is not None:
                ledger.write(msgspec.json.encode(_JobResult(job, figures)).decode() + "\n")
                ledger.flush()
            feet_done(len(finished))


def _prepare_and_read_results(file: Path, run_description: Mapping[str, str | int]) -> dict[Job, JobMetrics]:
    """Return the figures of finished jobs from a result file; create or repair the file for appending.

    Raises:
        FootsenseError: It holds another run, or cannot be read or written.
    """
    header = json.dumps({"run": dict(run_description)}, sort_keys=True).encode()
    try:
        content = file.read_bytes() if file.exists() else b""
        whole, _, torn = content.rpartition(b"\n")
        if not whole and header.startswith(torn):
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(header + b"\n")
            return {}
        first, *lines = whole.split(b"\n")
        if first != header:
            raise FootsenseError(
                f"{file} is of another run: it starts with {first[:200].decode(errors='replace') or 'none'}, "
                f"this one is {header.decode()}; name another file"
            )
        if torn:
            with file.open("r+b") as stream:
                stream.truncate(len(content) - len(torn))
    except OSError as error:
        raise FootsenseError(f"{file}: cannot keep results: {error.strerror}") from error
    finished = {}
    for number, line in enumerate(lines, start=2):
        try:
            result = msgspec.json.decode(line, type=_JobResult)
        except msgspec.MsgspecError as error:
            raise FootsenseError(f"{file}, line {number}: not the result of a foot ({error})") from error
        finished[result.job] = result.figures
    return finished
