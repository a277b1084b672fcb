"""Text files from Jinja templates, which stand beside the code that fills them."""

from collections.abc import Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape


def render(file: str, names: Mapping[str, Any]) -> str:
    """Return the text rendered from the template of a file.

    Args:
        file: Folder of the template in the package and name of the file, such as `lab/model_card.md`.
        names: Values of the template's variables; the template fails on any other variable.
    """
    return _environment().get_template(f"{file}.j2").render(names).strip() + "\n"


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
