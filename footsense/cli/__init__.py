"""The command line; the only place that prints and that turns errors into exit codes.

Commands are imported when they are called: `footsense --help` needs no network runtime.
"""

import importlib
import logging
import sys
from typing import Any

import click

import footsense
from footsense.errors import FootsenseError

_COMMANDS = {
    "run": "footsense.cli.run:run",
    "replay": "footsense.cli.replay:replay",
    "recover": "footsense.cli.recover:recover",
    "check-config": "footsense.cli.check_config:check_config",
    "bench": "footsense.cli.bench:bench",
    "lab": "footsense.cli.lab:lab",
}


class LazyGroup(click.Group):
    """A group that imports a command's module only when it is needed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the table, which is the order of use."""
        del ctx
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command."""
        del ctx
        if cmd_name not in _COMMANDS:
            return None
        module, _, name = _COMMANDS[cmd_name].partition(":")
        command: click.Command = getattr(importlib.import_module(module), name)
        return command

    def invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401 - click's signature
        """Run a command; an error of footsense is one line and its exit code, never a traceback."""
        try:
            return super().invoke(ctx)
        except FootsenseError as error:
            click.echo(f"footsense: {error}", err=True)
            sys.exit(error.exit_code)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(footsense.__version__)
@click.option("--verbose", "-v", is_flag=True, help="Say what is found and done, not only what is wrong.")
def main(*, verbose: bool) -> None:
    """Contact forces of a legged robot's soft capacitive feet."""
    # journald adds time and unit; the level is what it needs of us.
    logging.basicConfig(
        level=logging.INFO if verbose else logging.WARNING,
        format="%(levelname)s: %(message)s",
        stream=sys.stderr,
    )
