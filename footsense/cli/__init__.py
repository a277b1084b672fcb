"""Command line of footsense; the only package that prints, and that turns errors into exit codes.

Commands are imported when they are called: `footsense --help` needs no network runtime.
"""

import contextlib
import errno
import importlib
import logging
import os
import sys
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import click

import footsense
from footsense.errors import FootsenseError
from footsense.telemetry.log_lines import NonBlockingLogHandler

#: Exit code of a command that Ctrl-C ended, as shells have it: 128 + SIGINT. `run` ends well, with 0.
_EXIT_CODE_INTERRUPTED = 130

#: Module and help line of each command, in the order of use; `footsense --help` imports none of them.
_COMMANDS = {
    "run": ("run", "Read the feet, estimate their forces, publish them on CAN."),
    "monitor": ("monitor", "Show the legs on CAN, as a consumer of their forces sees them."),
    "tare": ("can.tare", "Zero the forces of legs whose feet hang free."),
    "view": ("view", "Serve the page of a running service to browsers."),
    "ros2": ("can.ros2", "Publish the legs on CAN to ROS 2 (extra ros2)."),
    "exporter": ("exporter", "Serve the metrics of a running service to Prometheus."),
    "snapshot": ("recordings", "Record the last 30 s or more of a running service."),
    "replay": ("recordings", "Run a recording through the pipeline again, or check it."),
    "export": ("recordings", "Convert a recording: ROS 2 bag, CSV."),
    "info": ("info", "Say what a file of footsense holds, or what is installed here."),
    "init": ("setup.init", "Find a robot's adapters and feet, and write its file."),
    "install": ("setup.install", "Make this computer a robot's, or take that back."),
    "check-config": ("setup.check_config", "Say what a robot file means, or its first error."),
    "probe": ("setup.probe", "Check buses and feet, and name what to check."),
    "selfcal": ("calibration.selfcal", "Watch the electrodes of the feet while the robot walks."),
    "calibration": ("calibration", "Take a proposed calibration into use, or the former one."),
    "test-stand": ("test_stand", "Record a foot beside a force sensor, and calibrate it."),
    "dev": ("dev", "Measure and test footsense itself: benchmark, soak, trace."),
    "lab": ("lab.group", "From rubber to network: design and build a foot (extra lab)."),
}


def _log_all(ctx: click.Context, param: click.Parameter, value: bool) -> None:  # noqa: FBT001 - click's signature
    del ctx, param
    if value:
        logging.getLogger().setLevel(logging.INFO)


_VERBOSE = click.Option(
    ["--verbose", "-v"],
    is_flag=True,
    expose_value=False,
    callback=_log_all,
    help="Log what is found and done, not only faults.",
)


def _take_verbose(command: click.Command) -> None:
    """Let a command, and the commands of a group, take -v behind their names as well."""
    if _VERBOSE not in command.params:
        command.params.append(_VERBOSE)
    for inner in command.commands.values() if isinstance(command, click.Group) else ():
        _take_verbose(inner)


class LazyGroup(click.Group):
    """Click command group that imports a command's module only when the command is used.

    Args:
        args: What click gives a group.
        modules: Module and help line of each command by its name, in the order of use.
        extra: What click gives a group by name.
    """

    def __init__(self, *args: Any, modules: dict[str, tuple[str, str]], **extra: Any) -> None:  # noqa: ANN401 - click's
        super().__init__(*args, **extra)
        self.modules = modules

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the command names, in the order in which they are usually needed."""
        del ctx
        return list(self.modules)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command; None for an unknown name.

        Raises:
            UsageError: There is none of this name, but one of nearly this name.
        """
        if cmd_name not in self.modules:
            paths = self._paths(ctx)
            if near := get_close_matches(cmd_name, paths, n=1):
                ctx.fail(f"No such command {cmd_name!r}. Did you mean {paths[near[0]]}?")
            return None
        module = importlib.import_module(f"footsense.cli.{self.modules[cmd_name][0]}")
        command: click.Command = getattr(module, cmd_name.replace("-", "_"))
        _take_verbose(command)
        return command

    def _paths(self, ctx: click.Context) -> dict[str, str]:
        """Return what to type for each command by its name, those of the groups as well."""
        paths = {name: name for name in self.modules}
        for name in self.modules:
            command = self.get_command(ctx, name)
            if isinstance(command, click.Group):
                paths |= {inner: f"{name} {inner}" for inner in command.list_commands(ctx)}
        return paths

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands for `--help`."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in self.modules.items()])

    def invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401 - click's signature
        """Run a command; print an expected error as one line, and exit with its exit code."""
        try:
            return super().invoke(ctx)
        except FootsenseError as error:
            click.echo(f"footsense: {error}", err=True)
            sys.exit(error.exit_code)
        except KeyboardInterrupt:
            sys.exit(_EXIT_CODE_INTERRUPTED)

    def main(self, *args: Any, **extra: Any) -> Any:  # noqa: ANN401 - click's signature
        """Run the command line; print errors of the output stream (such as a closed pipe) as one line, too."""
        try:
            try:
                return super().main(*args, **extra)
            finally:
                if sys.stdout is not None:  # closed by the parent process
                    sys.stdout.flush()
        except OSError as error:
            _redirect_output_to_null()
            if error.errno != errno.EPIPE:  # a reader that has closed the pipe gets no message
                where = error.filename or "the output"
                click.echo(f"footsense: {where}: {error.strerror or error}", err=True)
            sys.exit(FootsenseError.exit_code)


def _redirect_output_to_null() -> None:
    """Redirect standard output to /dev/null, so that Python's flush at exit does not fail again."""
    with contextlib.suppress(OSError, ValueError, AttributeError), Path(os.devnull).open("wb") as devnull:
        os.dup2(devnull.fileno(), sys.stdout.fileno())


def _log_handler() -> logging.Handler:
    try:
        return NonBlockingLogHandler(sys.stderr.fileno())
    except (AttributeError, OSError):  # closed, or replaced by something without a descriptor
        return logging.StreamHandler()


@click.group(cls=LazyGroup, modules=_COMMANDS, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(footsense.__version__)
def main() -> None:
    """Contact forces of a legged robot's soft capacitive feet."""
    # journald adds time and unit, and takes the level from the line.
    logging.basicConfig(format="%(levelname)s: %(message)s", handlers=[_log_handler()])


main.params.append(_VERBOSE)
