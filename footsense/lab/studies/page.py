"""Study and page of the report: `compute` returns figures, a Jinja template renders them as text.

A study module `x.py` ends with `STUDY = Study(...)`; its template is `x.md.j2` beside it. `compute` may take minutes
and returns results (a dataclass) and figures. The results are written as JSON. The template sees the fields of the
results and the names of the study module (its constants and functions), no more, so a committed page can be rendered
again from its JSON without computing anything; a test compares it with the committed text.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property
from importlib import import_module
from pathlib import Path
from timeit import default_timer
from typing import Any, get_args, get_type_hints

import msgspec
from matplotlib.figure import Figure

from footsense.foot.files.checksum_trailer import verified_sha256
from footsense.foot.files.network_card import TrainedInputs, read_card
from footsense.foot.response_table import FootResponse
from footsense.lab.code_hash import compute_function_sha256
from footsense.lab.evaluation.evaluate_models import NETWORK_FILE, open_models
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.geometry import FootDesign
from footsense.lab.template import render
from footsense.lab.training.export import OnnxNetwork

#: Figures of matplotlib by file name, such as `sensors.png`.
Plots = dict[str, Figure]


@dataclass(frozen=True, kw_only=True)
class StudyContext:
    """Inputs of a study: folder of the models, quick or full form, progress output.

    Attributes:
        models: Folder of a foot type: its description, response table and network.
        quick: Whether to answer in seconds, with coarse steps and few seeds; such a page says so.
        report_progress: Receives a line after each step.
    """

    models: Path
    quick: bool = False
    report_progress: Callable[[str], None] = print

    @cached_property
    def _released_models(self) -> tuple[FootResponse, OnnxNetwork]:
        """Return response table and network from the context's folder, loaded once."""
        return open_models(self.models)

    @cached_property
    def foot_design(self) -> FootDesign:
        """Geometry, materials and load range of the studied foot."""
        return load_foot(self.models / FOOT_FILE)

    @property
    def response(self) -> FootResponse:
        """Response table of the studied foot."""
        return self._released_models[0]

    @property
    def network(self) -> OnnxNetwork:
        """The studied network, run by ONNX Runtime."""
        return self._released_models[1]

    @cached_property
    def trained_inputs(self) -> TrainedInputs:
        """Capacitor model, input range and input moments of the network."""
        return read_card(json.dumps(self.network.card), str(self.models)).trained_inputs

    def model_hash_entry(self, *, uses_network: bool) -> dict[str, str]:
        """Return the hash that keys a page: of the network, or of the response table alone."""
        if uses_network:
            return {"network_sha256": self.network_sha256}
        return {"response_sha256": self.response.sha256}

    @cached_property
    def network_sha256(self) -> str:
        """SHA-256 of the network file, whose card holds the response table's hash."""
        path = self.models / NETWORK_FILE
        return verified_sha256(path.read_bytes(), str(path))


@dataclass(frozen=True, kw_only=True)
class Page:
    """One rendered page of the report: text, figures and JSON values.

    Attributes:
        name: The study's name, which also names its files.
        title: Heading.
        body: Markdown below the heading: question, tables, findings. `![](x.png)` shows a figure.
        figures: The drawings.
        values: The measured numbers, the time [s], and how they were made, as JSON values.
        command: Subcommand of `footsense lab` that makes the page; empty for `study`.
    """

    name: str
    title: str
    body: str
    figures: Plots
    values: dict[str, Any]
    command: str = ""

    @property
    def seconds(self) -> float:
        """Computing time of the study [s]."""
        return float(self.values["seconds"])

    def write(self, folder: Path) -> None:
        """Write `<name>.md`, `<name>.json` and the figures into a folder, created if missing."""
        folder.mkdir(parents=True, exist_ok=True)
        for file, figure in self.figures.items():
            figure.savefig(folder / file, dpi=110, bbox_inches="tight", metadata={"Software": None})
        (folder / f"{self.name}.md").write_text(self.markdown, encoding="utf-8")
        text = json.dumps({"study": self.name, **self.values}, indent=2) + "\n"
        (folder / f"{self.name}.json").write_text(text, encoding="utf-8")

    @property
    def markdown(self) -> str:
        """Full Markdown of the page: title, command, computing time, body."""
        made_by = f"`footsense lab {self.command or 'study ' + self.name}`, {self.seconds:.0f} s"
        return f"## {self.title}\n\n{made_by}\n\n{self.body.strip()}\n"


@dataclass(frozen=True, kw_only=True)
class Study:
    """One study of the report: name, title, `compute` and the names for its template.

    Attributes:
        name: Names its command and its files.
        title: Heading of its page.
        compute: Measures; its annotation names the type of the results, a dataclass that msgspec converts to and from
            JSON.
        template_names: Names that the template uses and that the module itself does not.
        command: Subcommand of `footsense lab`; empty for `study <name>`.
        uses_network: Whether the results depend on the released network; else on the foot's response alone.
    """

    name: str
    title: str
    compute: Callable[[StudyContext], tuple[Any, Plots]]
    template_names: dict[str, Any] = field(default_factory=dict)
    command: str = ""
    uses_network: bool = True

    def compute_page(self, context: StudyContext) -> Page:
        """Run `compute` and return the page, with the hashes that show later whether it is out of date."""
        started = default_timer()
        results, figures = self.compute(context)
        values = {
            "seconds": round(default_timer() - started, 1),
            "quick": context.quick,
            **context.model_hash_entry(uses_network=self.uses_network),
            "code_sha256": compute_function_sha256(self._compute_function.__module__),
            **msgspec.to_builtins(results, str_keys=True, enc_hook=lambda value: value.tolist()),
        }
        return self.rerender(json.loads(json.dumps(values)), figures)

    @property
    def _compute_function(self) -> Any:
        """The plain function behind `compute` (unwrapped from `functools.partial`)."""
        return getattr(self.compute, "func", self.compute)

    def rerender(self, values: dict[str, Any], figures: Plots | None = None) -> Page:
        """Return the page rendered from stored JSON values, without computing."""
        results_type, _ = get_args(get_type_hints(self._compute_function)["return"])
        results: Any = msgspec.convert(values, results_type, str_keys=True)
        numbers = {one.name: getattr(results, one.name) for one in fields(results)}
        module = self._compute_function.__module__
        names = vars(import_module(module)) | numbers | self.template_names | {"results": results}
        body = render(module, names)
        return Page(
            name=self.name,
            title=self.title,
            body=f"{_QUICK_NOTICE}\n\n{body}" if values["quick"] else body,
            figures=figures or {},
            values=values,
            command=self.command,
        )


_QUICK_NOTICE = "**Quick run: coarse steps, few cases and seeds. Its figures are no results.**"
