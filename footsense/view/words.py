"""Texts for the page: meaning and remedy of each state and cause."""

from typing import Any

from footsense.frames import FAULT_FREE, BaselineStatus, Slip
from footsense.leg_words import CAUSE_WORDS, STATE_WORDS, phase_of, word_of


def code_texts() -> dict[str, Any]:
    """Return the texts of all codes: meaning and remedy of states and causes, names of baseline statuses and slips."""
    return {
        "states": [
            {
                "name": word_of(state),
                "phase": word_of(phase_of(state)),
                "fault_free": state in FAULT_FREE,
                "what": words.meaning,
                "check": words.remedy,
            }
            for state, words in sorted(STATE_WORDS.items())
        ],
        "causes": [
            {"name": word_of(cause), "what": words.meaning, "check": words.remedy}
            for cause, words in sorted(CAUSE_WORDS.items())
        ],
        "baselines": [word_of(status) for status in BaselineStatus],
        "slips": [word_of(slip) for slip in Slip],
    }
