"""Frame of the studies that are not yet a page of the report in its present form."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from footsense.lab.report import Figures, StudyContext

Plots = Figures

__all__ = ["Plots", "Study", "StudyContext"]


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study, its title, and the names that its template uses."""

    name: str
    title: str
    compute: Callable[[StudyContext], tuple[Any, Plots]]
    template_names: dict[str, Any] = field(default_factory=dict)
    command: str = ""
    uses_network: bool = True
