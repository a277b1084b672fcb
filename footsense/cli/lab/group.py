"""Command group `footsense lab`: foot model, network training, studies. Needs the extra `lab`."""

import click

from footsense.cli.lab import design, fabricate, models, response, study
from footsense.errors import require

#: Libraries of the extra.
_REQUIRED_PACKAGES = ("ngsolve", "jax", "jinja2", "joblib", "optax", "onnx", "scipy")


def _require_lab_packages() -> None:
    """Raise FootsenseError unless the libraries of the extra `lab` are installed.

    Raises:
        FootsenseError: One is not.
    """
    note = ", or in a checkout .venv/bin/pip install -e '.[lab]' (there is no ngsolve for ARM)"
    require("the lab", "lab", *_REQUIRED_PACKAGES, note=note)


@click.group(
    commands=[
        design.design,
        models.build,
        models.evaluate,
        models.compare,
        fabricate.fabricate,
        response.response,
        study.study,
        study.report,
    ]
)
def lab() -> None:
    """From rubber to network: build, judge and compare the models, and study the foot."""
    _require_lab_packages()
