"""Every command, as its option `--help` shows it."""

from collections.abc import Iterator

import click

from footsense.cli import main

_WIDTH = 100


def markdown() -> str:
    """Return a section for each command that is no group, in the order of `footsense --help`."""
    return "\n".join(
        f"## `{context.command_path}`\n\n```text\n{context.get_help()}\n```\n" for context in _contexts(main)
    )


def _contexts(command: click.Command, parent: click.Context | None = None) -> Iterator[click.Context]:
    name = None if parent else "footsense"
    context = click.Context(
        command,
        parent,
        name or command.name,
        terminal_width=_WIDTH,
        max_content_width=_WIDTH,
        **command.context_settings,
    )
    yield context
    if isinstance(command, click.Group):
        for inner in command.list_commands(context):
            found = command.get_command(context, inner)
            assert found is not None
            yield from _contexts(found, context)
