"""The report: every study's page, bound into one document, each with the command that makes it.

A page is written as soon as it is made, with the hash of the network that it is about; a report that was interrupted
goes on with the pages that are missing. Each study has a process of its own: what one leaves behind in the libraries'
threads made the next one's small matrix products fifteen times as slow.
"""

import json
import os
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from timeit import default_timer

from footsense.errors import FootsenseError
from footsense.foot.checksum_trailer import unsealed_sha256
from footsense.lab.evaluation.evaluate_models import NETWORK_FILE
from footsense.lab.studies.page import Page, Workbench
from footsense.lab.targets import targets

_LAB_STUDIES = {
    "shipped": "accuracy.released",
    "sensors": "accuracy.sensors",
    "paper-way": "networks.paper_procedure",
    "hidden-layers": "networks.hidden_layers",
    "rprop-speed": "networks.rprop_speed",
    "pattern": "mechanics.pattern",
    "error-map": "accuracy.error_map",
    "beyond": "mechanics.beyond",
    "film": "mechanics.film",
    "tolerance": "accuracy.tolerance",
    "solid": "mechanics.solid",
    "floor": "mechanics.floor",
    "ladder": "mechanics.fidelity",
    "limit": "accuracy.cramer_rao",
    "network-size": "networks.network_size",
    "history": "networks.history",
    "hard-cases": "accuracy.hard_cases",
}
#: The studies in the order of the report, each with its module.
STUDIES = {name: f"footsense.lab.studies.{module}" for name, module in _LAB_STUDIES.items()}
#: Pages about the daemon, which the lab does not import: `footsense.cli.lab` makes them.
OTHERS = ("tradeoff", "touchdown", "faults", "experiment")
README, BUILD = "README.md", "build.json"


def make_page(name: str, bench: Workbench, studies: Mapping[str, str] = STUDIES) -> Page:
    """Run one study.

    Args:
        name: Key of `studies`.
        bench: What it works on.
        studies: Module of each study; its function `page` makes the page.

    Raises:
        FootsenseError: There is no such study.
    """
    if name not in studies:
        raise FootsenseError(f"no study {name!r}: there are {', '.join(studies)}")
    return timed_page(import_module(studies[name]).page, bench)


def timed_page(study: Callable[[Workbench], Page], bench: Workbench) -> Page:
    """Return a study's page with what it took and which network it is about."""
    started = default_timer()
    page = study(bench)
    about = {"network_sha256": _network_hash(bench), "quick": bench.quick}
    return replace(page, seconds=default_timer() - started, values={**page.values, **about})


def _network_hash(bench: Workbench) -> str:
    """Return the hash of the network that the studies are about."""
    path = bench.models / NETWORK_FILE
    return unsealed_sha256(path.read_bytes(), str(path))


def is_made(name: str, folder: Path, bench: Workbench) -> bool:
    """Tell whether a folder holds a study's page about this very network."""
    try:
        values = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        (folder / f"{name}.md").stat()
    except (OSError, json.JSONDecodeError):
        return False
    return bool(values.get("network_sha256") == _network_hash(bench) and values.get("quick") == bench.quick)


def make_report(
    folder: Path,
    bench: Workbench,
    studies: Mapping[str, str] = STUDIES,
    *,
    build_s: float | None,
    resume: bool,
    report: Callable[[str], None],
) -> Path:
    """Run the studies and bind their pages.

    Args:
        folder: Where the pages go.
        bench: What the studies work on.
        studies: Module of each study.
        build_s: What building the models took [s]; None if they were there.
        resume: Whether pages that are there already, about this very network, are kept.
        report: Told what has just been done, one line each.

    Returns:
        The bound document.
    """
    if build_s is not None:
        folder.mkdir(parents=True, exist_ok=True)
        built = {"seconds": round(build_s, 1), "network_sha256": _network_hash(bench), "quick": bench.quick}
        (folder / BUILD).write_text(json.dumps(built, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    for name in studies:
        if resume and is_made(name, folder, bench):
            report(f"{name}: kept")
            continue
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            seconds = process.submit(
                _write_page, name, studies, bench.models, folder, quick=bench.quick
            ).result()
        report(f"{name}: {seconds:.0f} s")
    return bind(folder, bench)


def _write_page(name: str, studies: Mapping[str, str], models: Path, folder: Path, *, quick: bool) -> float:
    """Run one study in this process, write its page, and return what it took [s]."""
    page = make_page(name, Workbench(models=models, quick=quick, say=_say), studies)
    page.write(folder)
    return page.seconds


def _say(line: str) -> None:
    """Pass on what a study has just done."""
    sys.stdout.write(f"    {line}\n")
    sys.stdout.flush()


def bind(folder: Path, bench: Workbench) -> Path:
    """Write the document of all pages about one network, the targets on top, and return its path.

    Args:
        folder: Where the pages are.
        bench: Tells the network; pages about another one, or of the other form, are left out and named.
    """
    made = [name for name in (*STUDIES, *OTHERS) if is_made(name, folder, bench)]
    left_out = [name for name in (*STUDIES, *OTHERS) if name not in made]
    values = {name: json.loads((folder / f"{name}.json").read_text(encoding="utf-8")) for name in made}
    pages = [(folder / f"{name}.md").read_text(encoding="utf-8").strip() for name in made]
    titles = [page.partition("\n")[0].removeprefix("## ") for page in pages]
    contents = "\n".join(f"- [{title}](#{_anchor(title)})" for title in titles)
    studies_s = sum(value["seconds"] for value in values.values())
    build_s = _build_s(folder, bench)
    taken = f"the studies took {studies_s / 60.0:.0f} min"
    if build_s is not None:
        taken = f"the models took {build_s / 60.0:.0f} min and " + taken
        if not left_out:
            values["report"] = {"minutes": (build_s + studies_s) / 60.0}
    notes = ""
    if bench.quick:
        notes += "\n\n**A quick form: few steps, seeds and cases. Its numbers say nothing.**"
    if left_out:
        notes += f"\n\nNot made about this network yet: {', '.join(left_out)}."
    text = f"""# The lab's report

From rubber to network: every result of Aoyagi et al. with its command, its figure and its number beside the paper's,
and what the paper could not say. All of it is made by `footsense lab report`; {taken}
on {os.cpu_count()} cores. Nothing here is edited by hand.{notes}

{targets(values)}

{contents}

"""
    path = folder / README
    path.write_text(text + "\n\n".join(pages) + "\n", encoding="utf-8")
    return path


def _build_s(folder: Path, bench: Workbench) -> float | None:
    """Return what building this very network took [s], None if nobody knows."""
    try:
        built = json.loads((folder / BUILD).read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError):
        return None
    return float(built["seconds"]) if built["network_sha256"] == _network_hash(bench) else None


def _anchor(title: str) -> str:
    """Return the anchor that a heading gets.

    Example:
        >>> _anchor("The limit: Cramer-Rao, 20 to 150 gf")
        'the-limit-cramer-rao-20-to-150-gf'
    """
    kept = "".join(letter for letter in title.lower() if letter.isalnum() or letter in " -_")
    return kept.replace(" ", "-")
