"""The states and causes of a leg, with their meaning and remedy."""

from collections.abc import Mapping

from docstrings import table

from footsense.frames import Cause, State
from footsense.leg_words import CAUSE_WORDS, STATE_WORDS, Words, word_of

#: What to check where the cause alone says it.
_CAUSE = "the cause"


def states() -> str:
    """Return a table of the states that are not as they should be."""
    return _table("state", STATE_WORDS)


def causes() -> str:
    """Return a table of the causes that anything sends."""
    return _table("cause", CAUSE_WORDS)


def _table(kind: str, words: Mapping[State, Words] | Mapping[Cause, Words]) -> str:
    rows = [
        [f"`{word_of(code)}`", told.meaning, told.remedy or _CAUSE]
        for code, told in words.items()
        if told.meaning
    ]
    return table([kind, "meaning, of the leg", "check"], rows)
