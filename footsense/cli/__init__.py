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

#: Where each command is, and its line in the help, so that help imports none of them.
_COMMANDS = {
    "run": ("footsense.cli.run:run", "Read the feet, estimate their forces, publish them on CAN."),
    "replay": ("footsense.cli.replay:replay", "Run a recording through the pipeline again, or check it."),
    "recover": ("footsense.cli.recover:recover", "Rewrite a recording that was cut short."),
    "check-config": ("footsense.cli.check_config:check_config", "Say what a configuration file means."),
    "bench": ("footsense.cli.bench:bench", "Measure scan, cycle and start beside their limits."),
    "lab": ("footsense.cli.lab:lab", "From rubber to network (needs footsense[lab])."),
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
        module, _, name = _COMMANDS[cmd_name][0].partition(":")
        command: click.Command = getattr(importlib.import_module(module), name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of commands."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in _COMMANDS.items()])

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
