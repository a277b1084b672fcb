"""A new file that is another one, such as a full disk: what may not be written through can still be tested."""

import os
from pathlib import Path

import pytest


def opens_instead(monkeypatch: pytest.MonkeyPatch, path: Path, instead: Path) -> None:
    """Let the opening of a new file open another one."""
    really = os.open

    def opened(file: str | Path, flags: int, mode: int = 0o777) -> int:
        return really(instead, os.O_WRONLY) if file == path else really(file, flags, mode)

    monkeypatch.setattr("os.open", opened)
