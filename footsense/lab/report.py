"""Report: all study pages in one document, each with the command that remakes it.

A page is written as soon as it is made; an interrupted report goes on with the missing and stale pages. Each study runs
in a process of its own: library threads left by one study made the next one's small matrix products fifteen times as
slow.
"""

import json
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from footsense.errors import FootsenseError
from footsense.lab.code_hash import compute_function_sha256
from footsense.lab.studies.page import Page, Study, StudyContext
from footsense.lab.targets import targets_markdown
from footsense.lab.template import render
from footsense.progress import progress_bar, stderr_is_terminal

_LAB_STUDY_MODULES = {
    "released": "accuracy.released",
    "gaits": "accuracy.gaits",
    "tracker": "accuracy.tracker",
    "gait-semantics": "accuracy.gait_semantics",
    "paper-procedure": "networks.paper_procedure",
    "hidden-layers": "networks.hidden_layers",
    "rprop-speed": "networks.rprop_speed",
    "pattern": "mechanics.pattern",
    "error-map": "accuracy.error_map",
    "beyond": "mechanics.beyond",
    "film": "mechanics.film",
    "force-range": "accuracy.force_range",
    "error-causes": "accuracy.error_causes",
    "cavity": "mechanics.cavity",
    "tolerance": "accuracy.tolerance",
    "solid": "mechanics.solid",
    "floor": "mechanics.floor",
    "fidelity": "mechanics.fidelity",
    "cramer-rao": "accuracy.cramer_rao",
    "network-size": "networks.network_size",
    "hard-cases": "accuracy.hard_cases",
    "sensors": "accuracy.sensors",
}
#: The studies in the order of the report, each with its module.
STUDY_MODULES = {name: f"footsense.lab.studies.{module}" for name, module in _LAB_STUDY_MODULES.items()}
#: Pages about the daemon or its scan, which the lab does not import: `footsense.cli.lab` makes them.
DAEMON_PAGES = ("tradeoff", "touchdown", "faults", "experiment", "mismatch")
README, BUILD = "README.md", "build.json"
#: Stale pages that are kept, with the reason of each, as JSON.
STALE_PAGES_FILE = "stale.json"


def make_page(name: str, context: StudyContext, studies: Mapping[str, str] = STUDY_MODULES) -> Page:
    """Run one study by name and return its page.

    Args:
        name: Key of `studies`.
        context: The models.
        studies: Module of each study, with a `STUDY`.

    Raises:
        FootsenseError: There is no such study.
    """
    if name not in studies:
        raise FootsenseError(f"no study {name!r}: there are {', '.join(studies)}")
    study: Study = import_module(studies[name]).STUDY
    return study.compute_page(context)


def _read_json_or_empty(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file; empty if the file is missing or damaged."""
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, json.JSONDecodeError):
        return {}


def page_values(name: str, folder: Path) -> dict[str, Any]:
    """Return the JSON values of a stored page; empty if the page is missing or damaged."""
    return _read_json_or_empty(folder / f"{name}.json") if (folder / f"{name}.md").exists() else {}


def is_page_of_models(name: str, folder: Path, context: StudyContext) -> bool:
    """Tell whether a stored page belongs to the given models and form (quick or full)."""
    values = page_values(name, folder)
    if "response_sha256" in values:
        made = values["response_sha256"] == context.response.sha256
    else:
        made = values.get("network_sha256") == context.network_sha256
    return made and values.get("quick") == context.quick


def stale_reason(
    name: str, folder: Path, context: StudyContext, studies: Mapping[str, str] = STUDY_MODULES
) -> str:
    """Return why a page is out of date (other network, or changed study code); empty if it is current."""
    if not is_page_of_models(name, folder, context):
        return "missing, or made about another network or foot"
    if page_values(name, folder).get("code_sha256", "") != compute_function_sha256(studies[name]):
        return f"the code that measures its numbers has changed ({studies[name]})"
    return ""


def noted_stale_reasons(folder: Path) -> dict[str, str]:
    """Return the reasons noted in a folder for pages that are known to be out of date."""
    return _read_json_or_empty(folder / STALE_PAGES_FILE)


def make_report(
    folder: Path,
    context: StudyContext,
    studies: Mapping[str, str] = STUDY_MODULES,
    *,
    build_s: float | None,
    resume: bool,
    report: Callable[[str], None],
) -> Path:
    """Run the studies, bind their pages into one document, and return its path.

    Args:
        folder: Where the pages go.
        context: The models.
        studies: Module of each study.
        build_s: Build time of the models [s]; None if they existed.
        resume: Whether pages that are not stale are kept.
        report: Receives a line after each page.

    Returns:
        The bound document.
    """
    if build_s is not None:
        folder.mkdir(parents=True, exist_ok=True)
        built = {
            "seconds": round(build_s, 1),
            "network_sha256": context.network_sha256,
            "quick": context.quick,
        }
        (folder / BUILD).write_text(json.dumps(built, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    kept = [name for name in studies if resume and not stale_reason(name, folder, context, studies)]
    for name in kept:
        report(f"{name}: kept")
    missing = [name for name in studies if name not in kept]
    usual_s = {name: last_duration_s(name, folder, quick=context.quick) for name in missing}
    with progress_bar("pages", sum(usual_s.values()) or len(missing)) as done_so_far:
        for at, name in enumerate(missing, 1):
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
                made = process.submit(
                    _run_study_and_write_page, name, studies, context.models, folder, quick=context.quick
                )
                seconds = made.result()
            report(f"{name}: {seconds:.0f} s")
            done_so_far(sum(usual_s[one] for one in missing[:at]) or at)
    return bind_pages(folder, context)


def last_duration_s(name: str, folder: Path, *, quick: bool) -> float:
    """Return the stored computing time of a study's last run [s]; 0 if there is none of this form."""
    page = _read_json_or_empty(folder / f"{name}.json")
    return float(page["seconds"]) if page.get("quick") == quick else 0.0


def _run_study_and_write_page(
    name: str, studies: Mapping[str, str], models: Path, folder: Path, *, quick: bool
) -> float:
    """Run one study, write its page, and return the elapsed time [s]."""
    page = make_page(name, StudyContext(models=models, quick=quick, report_progress=_print_progress), studies)
    page.write(folder)
    return page.seconds


def _print_progress(line: str) -> None:
    """Print an indented progress line of a study, only in a process without a progress bar."""
    if stderr_is_terminal():
        return
    sys.stdout.write(f"    {line}\n")
    sys.stdout.flush()


def bind_pages(folder: Path, context: StudyContext) -> Path:
    """Write all current pages into one document, targets first, and return its path.

    Args:
        folder: Where the pages are.
        context: Tells the network; pages about another one, or of the other form, are left out and named.
    """
    made = [name for name in (*STUDY_MODULES, *DAEMON_PAGES) if is_page_of_models(name, folder, context)]
    left_out = [name for name in (*STUDY_MODULES, *DAEMON_PAGES) if name not in made]
    values = {name: page_values(name, folder) for name in made}
    pages = [(folder / f"{name}.md").read_text(encoding="utf-8").strip() for name in made]
    titles = [page.partition("\n")[0].removeprefix("## ") for page in pages]
    studies_s = sum(value["seconds"] for value in values.values())
    built = _read_json_or_empty(folder / BUILD)
    build_s = built["seconds"] if built.get("network_sha256") == context.network_sha256 else None
    if build_s is not None and not left_out:
        values["report"] = {"minutes": (build_s + studies_s) / 60.0}
    names = {
        "anchors": {title: _anchor(title) for title in titles},
        "build_s": build_s,
        "left_out": left_out,
        "pages": pages,
        "quick": context.quick,
        "stale": noted_stale_reasons(folder),
        "studies_s": studies_s,
        "targets": targets_markdown(values),
    }
    path = folder / README
    path.write_text(render(__name__, names) + "\n", encoding="utf-8")
    return path


def _anchor(title: str) -> str:
    """Return the Markdown anchor of a heading.

    Example:
        >>> _anchor("The limit: Cramer-Rao, 20 to 150 gf")
        'the-limit-cramer-rao-20-to-150-gf'
    """
    kept = "".join(letter for letter in title.lower() if letter.isalnum() or letter in " -_")
    return kept.replace(" ", "-")
