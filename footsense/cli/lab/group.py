"""Command group `footsense lab`: foot model, network training, studies. Needs the extra `lab`."""

import importlib.util

import click

from footsense.cli.lab import design, experiment, fabricate, models, report, response, study
from footsense.errors import FootsenseError

#: Libraries of the extra.
_REQUIRED_PACKAGES = ("ngsolve", "jax", "jinja2", "joblib", "optax", "onnx", "scipy")


def _require_lab_packages() -> None:
    """Raise FootsenseError unless the libraries of the extra `lab` are installed.

    Raises:
        FootsenseError: One is not.
    """
    missing = [name for name in _REQUIRED_PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise FootsenseError(
            f"the lab needs {', '.join(missing)}: pip install 'footsense[lab]', "
            "or in a checkout .venv/bin/pip install -e '.[lab]' (there is no ngsolve for ARM)"
        )


@click.group(
    commands=[
        design.design,
        design.shapes,
        models.build,
        models.evaluate,
        models.compare,
        fabricate.fabricate,
        response.response,
        study.study,
        study.fidelity,
        study.cramer_rao,
        study.gaits,
        study.tradeoff,
        study.tolerance,
        study.mismatch,
        study.faults,
        experiment.experiment,
        report.report,
    ]
)
def lab() -> None:
    """From rubber to network: build, judge and compare the models, and study the foot."""
    _require_lab_packages()
