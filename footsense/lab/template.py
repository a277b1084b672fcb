"""Rendering of the report's Markdown pages from Jinja templates."""

from collections.abc import Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape


def render(module: str, names: Mapping[str, Any]) -> str:
    """Return the text rendered from the template `<module>.md.j2` beside a module.

    Args:
        module: The module's dotted name.
        names: Values of the template's variables; the template fails on any other variable.
    """
    path = module.removeprefix("footsense.").replace(".", "/")
    return _environment().get_template(f"{path}.md.j2").render(names).strip()


@cache
def _environment() -> Environment:
    """Return the Jinja environment with the filter `fmt`: `{{ 0.5|fmt(".0%") }}` is `50%`."""
    environment = Environment(
        loader=PackageLoader("footsense", ""),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=select_autoescape(),
    )
    environment.filters["fmt"] = format
    return environment
