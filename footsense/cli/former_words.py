"""Commands, options and values that were renamed: an error message names the present word."""

import re

import click

_PRESENT_WORDS = {
    "bench": "benchmark",
    "ladder": "fidelity",
    "limit": "cramer-rao",
    "quiet": "low-noise",
    "steady": "default",
    "fresh": "low-latency",
    "--packs": "--calibrations",
    "--pack": "--calibration",
    "--pokes": "--loads",
    "--feet": "--calibrations",
    "--rung": "--level",
}

#: How click's messages begin: "No such command 'bench'", "No such option: --packs", "'quiet' is not one of".
_REFUSED_WORD_PATTERN = re.compile(r"(?:No such (?:command|option):? )?'?(?P<word>[\w-]+)")


def with_present_word(error: click.UsageError) -> click.UsageError:
    """Return a usage error, with the present word added if it is about a renamed one."""
    refused = _REFUSED_WORD_PATTERN.match(error.message)
    if not refused or refused["word"] not in _PRESENT_WORDS:
        return error
    return click.UsageError(
        f"{error.format_message()} It is now called {_PRESENT_WORDS[refused['word']]}.", error.ctx
    )
