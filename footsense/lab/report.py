"""Pages of the report: what a study is given, how its page is written, and all of them in turn.

A study is one module of `footsense.lab.studies` with `TITLE` and `compute(context)`, beside the template of its page,
`<module>.md.j2`. `compute` returns its figures as a dictionary of numbers, lists and texts, and puts what it draws into
the context; its `quick` form answers in seconds. The template gets these figures by name, the module as `study`, and
what `shown(values)` of the module derives of them, if it has that; `table` and `spread` write tables. What the report's
first page shows of a study is in `targets.yaml`.
"""

import json
import os
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from pkgutil import iter_modules
from timeit import default_timer
from types import ModuleType
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from footsense import sim
from footsense.errors import FootsenseError
from footsense.foot.network_card import NETWORK_FILE, TrainedInputs, read_card
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import released_folder
from footsense.lab import studies
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE, open_models
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.geometry import FootDesign
from footsense.lab.page_inputs import changed_inputs, digest_of, model_name, table_name
from footsense.lab.targets import rows_of_targets
from footsense.lab.template import render
from footsense.lab.training.export import OnnxNetwork
from footsense.sim.scene import Scene, load_scene

Values = dict[str, Any]

README = "README.md"
_QUICK_NOTICE = "**Quick form: coarse steps, few cases and seeds. Its figures are no results.**"


@dataclass(frozen=True)
class StudyContext:
    """What a study is given. What it opens of it becomes an input of the page.

    Attributes:
        folder: Folder of a foot type: its description, response table and networks; a study takes `files` of it.
        quick: Whether to answer in seconds, with coarse steps and few seeds.
        data: Folder of measured data of others, which do not come with footsense; None without.
        report_progress: Receives a line after each step.
        drawings: What a study draws, by file name.
        inputs: Digest of each model file, table and robot that was used so far, by its name (`page_inputs`).
    """

    folder: Path
    quick: bool = False
    data: Path | None = None
    report_progress: Callable[[str], None] = print
    drawings: dict[str, Figure] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)

    def add_input(self, name: str, content: bytes) -> None:
        """Note what is used, by its name in `page_inputs`."""
        self.inputs[name] = digest_of(content)

    def files(self, *names: str) -> Path:
        """Return the folder of the foot type, of which files of these names are used."""
        for name in names:
            self.add_input(model_name(self.folder / name), (self.folder / name).read_bytes())
        return self.folder

    def table_file(self, file: Path) -> Path:
        """Return the path of a table that comes with footsense, which is used."""
        self.add_input(table_name(file), file.read_bytes())
        return file

    def scene(self, name: str) -> Scene:
        """Return a scene that comes with footsense, which is used."""
        self.table_file(Path(sim.__file__).parent / "scenes" / f"{name}.yaml")
        return load_scene(name)

    def data_folder(self, sources: Mapping[str, str]) -> Path:
        """Return the folder of measured data.

        Args:
            sources: Where the content of its subfolders is to be had.

        Raises:
            FootsenseError: There is none.
        """
        if self.data is None:
            folders = "; ".join(f"{name}/: {source}" for name, source in sources.items())
            raise FootsenseError(f"this page needs --data, a folder with {folders}")
        return self.data

    def foot(self, foot_type: str) -> "StudyContext":
        """Return the context of another released foot, for the same page."""
        return replace(self, folder=released_folder(foot_type))

    @cached_property
    def foot_design(self) -> FootDesign:
        """Geometry, materials and load range of the studied foot."""
        return load_foot(self.files(FOOT_FILE) / FOOT_FILE)

    @cached_property
    def response(self) -> FootResponse:
        """Response table of the studied foot."""
        return FootResponse.load(self.files(RESPONSE_FILE) / RESPONSE_FILE)

    @cached_property
    def network(self) -> OnnxNetwork:
        """The studied network, run by ONNX Runtime."""
        return open_models(self.files(FOOT_FILE, RESPONSE_FILE, NETWORK_FILE))[1]

    @cached_property
    def trained_inputs(self) -> TrainedInputs:
        """Capacitor model, input range and input moments of the network."""
        return read_card(json.dumps(self.network.card), str(self.folder)).trained_inputs


#: Mark of a table in whose figures one response table made the readings and trained what is judged.
SAME_TABLE = "*same table*"


def table(headings: str, rows: Iterable[Any] | Mapping[str, Values], cells: str = "") -> str:
    """Return a Markdown table; its first column is text, the others are numbers.

    Args:
        headings: Of the columns, separated by ` | `; the first ends with `SAME_TABLE` where that is so.
        rows: Cells of each row, formatted by the caller; with `cells`, the values of each row by key, and in a mapping
            each row's key as `name`.
        cells: Formats of a row's cells, separated by ` | `, such as `{mesh} | {wall_s:.1f}`.
    """
    written = (cells.format(**row) if cells else " | ".join(map(str, row)) for row in _named(rows))
    head = [f"| {headings} |", "|---|" + "---:|" * headings.count(" | ")]
    return "\n".join([*head, *(f"| {row} |" for row in written)])


def _named(rows: Iterable[Any] | Mapping[str, Values]) -> Iterable[Any]:
    return [{"name": name} | row for name, row in rows.items()] if isinstance(rows, Mapping) else rows


def table_by_board(
    first: str, rows: Mapping[str, Sequence[Values] | Mapping[str, Values]], cells: Mapping[str, str]
) -> str:
    """Return a Markdown table with the same rows of some boards, and of each quantity a column a board, side by side.

    Args:
        first: Format of the first column, after its heading and a colon; of the first board's row.
        rows: Values of each row by board, of a mapping with its keys as `name`.
        cells: Format of a cell by the heading of its quantity.
    """
    heading, _, first_cell = first.partition(": ")
    names = " | ".join(
        f"{quantity}, `{board}`" if n == 0 else f"`{board}`"
        for quantity in cells
        for n, board in enumerate(rows)
    )
    lines = [
        (
            first_cell.format(**of_boards[0]),
            *(cell.format(**row) for cell in cells.values() for row in of_boards),
        )
        for of_boards in zip(*map(_named, rows.values()), strict=True)
    ]
    return table(f"{heading} | {names}", lines)


def spread(values: ArrayLike, digits: int = 2) -> str:
    """Return the mean, the standard deviation (of a sample) and the largest of values over seeds or feet as text.

    Example:
        >>> spread([1.0, 2.0, 6.0])
        '3.00 +- 2.65, worst 6.00'
    """
    given = np.asarray(values, float)
    return (
        f"{given.mean():.{digits}f} +- {given.std(ddof=1):.{digits}f}, worst {np.abs(given).max():.{digits}f}"
    )


def of_each(parts: Mapping[str, Values], key: str) -> dict[str, Any]:
    """Return the values of one key of some parts, by the parts' names."""
    return {name: part[key] for name, part in parts.items()}


#: What templates of pages may use besides the figures.
_IN_TEMPLATES: dict[str, Any] = {
    "same_table": SAME_TABLE,
    "table": table,
    "table_by_board": table_by_board,
    "of_each": of_each,
    "spread": spread,
    "mean": np.mean,
    "median": np.median,
    "deviation": partial(np.std, ddof=1),
}


def study_names() -> tuple[str, ...]:
    """Return the names of all studies: the modules of `footsense.lab.studies`, with hyphens."""
    return tuple(
        module.name.replace("_", "-") for module in iter_modules(studies.__path__) if not module.ispkg
    )


def _study(name: str) -> ModuleType:
    return import_module(f"{studies.__name__}.{name.replace('-', '_')}")


def make_page(name: str, context: StudyContext, folder: Path) -> tuple[str, Values]:
    """Run a study; write `<name>.md`, `<name>.json` and its drawings.

    Args:
        name: The study's, such as `speed-error`.
        context: What it is given.
        folder: Where the page goes; created if missing.

    Returns:
        Markdown of the page, and its figures as JSON values.

    Raises:
        FootsenseError: There is no such study, or files of this checkout are not those of its commit, which a page
            names; not of a quick one.
    """
    if name not in study_names():
        raise FootsenseError(f"no study {name!r}: there are {', '.join(study_names())}")
    study = _study(name)
    commit = _commit(allow_changes=context.quick)
    started, load = default_timer(), os.getloadavg()[0]
    computed = study.compute(context)
    made = {
        "study": name,
        "title": study.TITLE,
        "quick": context.quick,
        "foot": context.foot_design.foot_type,
        "commit": commit,
        "date": time.strftime("%Y-%m-%d"),
        "seconds": round(default_timer() - started, 1),
        "load": round(load, 1),
        "n_processors": os.cpu_count(),
        "inputs": dict(sorted(context.inputs.items())),
    }
    values: Values = json.loads(json.dumps(made | computed, default=_as_builtin))
    folder.mkdir(parents=True, exist_ok=True)
    for file, figure in context.drawings.items():
        figure.savefig(folder / file, dpi=110, bbox_inches="tight", metadata={"Software": None})
    markdown = page_text(values)
    (folder / f"{name}.md").write_text(markdown, encoding="utf-8")
    (folder / f"{name}.json").write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    return markdown, values


def page_text(values: Values) -> str:
    """Return the Markdown of a page from its JSON values, and a line on top if its inputs are others today."""
    study = _study(values["study"])
    quick = " --quick" if values["quick"] else ""
    made_by = (
        f"`footsense lab study {values['study']}{quick}` of commit {values['commit']}, {values['date']}: "
        f"{values['seconds']:.0f} s on {values['n_processors']} processors, load {values['load']:g} before."
    )
    changed = changed_inputs(values["inputs"])
    notices = [
        *(
            [f"**Out of date: {', '.join(changed)} changed since. Its figures are no results.**"]
            if changed
            else ()
        ),
        *([_QUICK_NOTICE] if values["quick"] else ()),
    ]
    template = study.__name__.removeprefix("footsense.").replace(".", "/")
    figures = _with_derived(values)
    targets = table("figure | wanted | measured", targets_of(values), "{figure} | {target} | {told}")
    text = render(f"{template}.md", {**_IN_TEMPLATES, **figures, "study": study, "targets": targets})
    return "\n\n".join([f"# {study.TITLE}", made_by, *notices, text])


def targets_of(values: Values) -> list[Values]:
    """Return the rows of `targets.yaml` of a page, from its JSON values."""
    return list(rows_of_targets(_with_derived(values)))


def _with_derived(values: Values) -> Values:
    study = _study(values["study"])
    return values | (study.shown(values) if hasattr(study, "shown") else {})


def make_report(folder: Path, context: StudyContext, report: Callable[[str], None]) -> Path:
    """Make all pages anew, one after the other, and the page with their list; return the path of that.

    A page from data of others stays as it is without them.

    Each study runs in a process of its own: library threads that one leaves behind slow the next one's small matrix
    products down.

    Args:
        folder: Where the pages go.
        context: What the studies are given.
        report: Receives a line after each page.
    """
    for name in study_names():
        needs_data = hasattr(_study(name), "DATA")
        if needs_data and context.data is None:
            report(f"{name}: kept, since its data were not given")
            continue
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            quiet = replace(context, report_progress=_report_nothing)
            _, values = process.submit(make_page, name, quiet, folder).result()
            report(f"{name}: {values['seconds']:.0f} s")
    return write_list_of_pages(folder)


def write_texts(folder: Path) -> list[Path]:
    """Write the Markdown of each page in a folder anew from its figures; return the files that were others."""
    changed = []
    for file in sorted(folder.glob("*.json")):
        markdown, path = page_text(json.loads(file.read_text("utf-8"))), file.with_suffix(".md")
        if not path.exists() or path.read_text("utf-8") != markdown:
            path.write_text(markdown, encoding="utf-8")
            changed.append(path)
    return changed


def _report_nothing(_: str) -> None:
    """Report nothing, where a lambda could not be pickled."""


def write_list_of_pages(folder: Path) -> Path:
    """Write the report's first page, from the pages in a folder; return its path."""
    files = [folder / f"{name}.json" for name in study_names()]
    pages = {file.stem: json.loads(file.read_text("utf-8")) for file in files if file.exists()}
    path = folder / README
    rows = [
        row | {"page": f"[{name}]({name}.md)"} for name, page in pages.items() for row in targets_of(page)
    ]
    targets = table("figure | target | measured | page", rows, "{figure} | {target} | {told} | {page}")
    text = render(
        "lab/report.md",
        {**_IN_TEMPLATES, "pages": pages, "targets": targets, "quick_notice": _QUICK_NOTICE},
    )
    path.write_text(text, encoding="utf-8")
    return path


def _as_builtin(value: Any) -> Any:
    """Return what JSON can hold, for NumPy's arrays and scalars.

    Raises:
        TypeError: It is neither.
    """
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"a study returned {type(value).__name__}, which JSON cannot hold")


#: What a page depends on, in a checkout.
_SOURCES = (
    "footsense",
    "firmware_interface",
    "examples/odometry.py",
    "models/*/*.onnx",
    "models/*/*.npz",
    "models/*/*.yaml",
)


def _commit(*, allow_changes: bool) -> str:
    """Return the commit of this code, with `+` if its files differ from it; `unknown` outside a checkout.

    Raises:
        FootsenseError: They differ, and may not.
    """
    try:
        # Pages that a report has made already are no code.
        changed = _git("status", "--porcelain", "--", *_SOURCES)
        commit = _git("rev-parse", "--short=8", "HEAD")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    if changed and not allow_changes:
        raise FootsenseError(
            f"{changed.splitlines()[0].split()[-1]}: differs from the commit, which a page names; commit first, or ask "
            "for a quick page"
        )
    return commit + ("+" if changed else "")


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(Path(__file__).parents[2]), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603
