"""What every study hands in: a page of the report, and the figures drawn for it.

A study is a function `page(bench: Workbench) -> Page`. It prints and writes nothing itself; `footsense lab study NAME`
writes its page, and `footsense lab report` binds all pages into one.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from footsense.foot.response_table import FootResponse
from footsense.lab.evaluation.evaluate_models import open_models
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.geometry import SoleDesign
from footsense.lab.training.export import OnnxNetwork


@dataclass(frozen=True, kw_only=True)
class Workbench:
    """What the studies work on.

    Attributes:
        models: Folder of a foot type: its description, response table and network.
        quick: Whether to answer in seconds, with coarse steps and few seeds; such a page says so.
        say: Told what has just been done, one line each.
    """

    models: Path
    quick: bool = False
    say: Callable[[str], None] = print

    @cached_property
    def _released(self) -> tuple[FootResponse, OnnxNetwork]:
        return open_models(self.models)

    @cached_property
    def sole(self) -> SoleDesign:
        """The foot as it is described."""
        return load_foot(self.models / FOOT_FILE)

    @property
    def response(self) -> FootResponse:
        """The foot's response table."""
        return self._released[0]

    @property
    def network(self) -> OnnxNetwork:
        """The shipped network."""
        return self._released[1]


@dataclass(frozen=True, kw_only=True)
class Page:
    """One page of the report.

    Attributes:
        name: The study's name, which also names its files.
        title: Heading.
        body: Markdown below the heading: what was asked, the tables, what they say. A figure is shown by `![](x.png)`.
        figures: Drawings by file name, such as `sensors.png`.
        values: The measured numbers, as JSON values.
        seconds: What it took [s], filled in by whoever ran it.
        command: Of `footsense lab` that makes it; empty for `study`.
    """

    name: str
    title: str
    body: str
    figures: dict[str, Figure] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    command: str = ""

    def write(self, folder: Path) -> None:
        """Write `<name>.md`, `<name>.json` and the figures into a folder, made if missing."""
        folder.mkdir(parents=True, exist_ok=True)
        for file, figure in self.figures.items():
            figure.savefig(folder / file, dpi=110, bbox_inches="tight", metadata={"Software": None})
        (folder / f"{self.name}.md").write_text(self.markdown, encoding="utf-8")
        record = {"study": self.name, "seconds": round(self.seconds, 1), **self.values}
        text = json.dumps(record, indent=2, sort_keys=True) + "\n"
        (folder / f"{self.name}.json").write_text(text, encoding="utf-8")

    @property
    def markdown(self) -> str:
        """The page as it stands in the report."""
        made_by = f"`footsense lab {self.command or 'study ' + self.name}`, {self.seconds:.0f} s"
        return f"## {self.title}\n\n{made_by}\n\n{self.body.strip()}\n"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table, the first column to the left and the others to the right.

    Example:
        >>> print(table(["read-out", "deg"], [["ours", "0.2"]]))
        | read-out | deg |
        |---|---:|
        | ours | 0.2 |
    """
    rule = "|" + "|".join(["---", *["---:"] * (len(header) - 1)]) + "|"
    lines = ["| " + " | ".join(row) + " |" for row in [header, *rows]]
    return "\n".join([lines[0], rule, *lines[1:]])
