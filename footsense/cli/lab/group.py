"""`footsense lab`: from rubber to network, and the paper's results measured again. Needs the extra `lab`."""

import importlib.util

import click

from footsense.cli.lab import experiment, faults, models, study
from footsense.errors import FootsenseError

#: Libraries of the extra.
_EXTRA = ("ngsolve", "jax", "joblib", "optax", "onnx", "scipy")
#: Former names of commands.
_RENAMED = {"ladder": "fidelity", "limit": "cramer-rao"}


def _require_extra() -> None:
    """Check that the libraries of the lab are installed.

    Raises:
        FootsenseError: One is not.
    """
    missing = [name for name in _EXTRA if importlib.util.find_spec(name) is None]
    if missing:
        raise FootsenseError(
            f"the lab needs {', '.join(missing)}: pip install 'footsense[lab]', "
            "or in a checkout .venv/bin/pip install -e '.[lab]'"
        )


class _LabGroup(click.Group):
    """A group that answers a former name with the new one."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command.

        Raises:
            FootsenseError: The command has another name now.
        """
        if cmd_name in _RENAMED:
            raise FootsenseError(f"`lab {cmd_name}` is now `lab {_RENAMED[cmd_name]}`")
        return super().get_command(ctx, cmd_name)


@click.group(cls=_LabGroup)
def lab() -> None:
    """From rubber to network: build, judge and compare the models, and study the foot."""
    _require_extra()


for _command in (
    models.build,
    models.evaluate,
    models.compare,
    study.response,
    study.study,
    study.fidelity,
    study.cramer_rao,
    study.tradeoff,
    study.tolerance,
    faults.faults,
    experiment.experiment,
    study.report,
):
    lab.add_command(_command)
