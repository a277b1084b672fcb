"""Progress is shown on a terminal, with the time left, and nowhere else."""

import io
import sys

import pytest

from footsense import progress


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_the_part_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bar names its task, and is taken away at the end."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal := _Terminal())
    with progress.progress_bar("walk.csv", 200) as done_so_far:
        done_so_far(100)
    assert "walk.csv" in terminal.getvalue()
    assert "50%" in terminal.getvalue()
    assert terminal.getvalue().endswith("\x1b[2K")  # the line is erased


def test_a_timed_task_says_the_usual_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal := _Terminal())
    with progress.timed_bar("film", 3605.0):
        pass
    assert "of usually 60:05" in terminal.getvalue()


def test_a_file_or_a_pipe_gets_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress.progress_bar("walk.csv", 200) as done_so_far, progress.timed_bar("film", 60.0):
        done_so_far(100)
    assert capsys.readouterr() == ("", "")


def test_a_task_of_unknown_duration_has_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", terminal := _Terminal())
    with progress.timed_bar("film", 0.0):
        pass
    assert terminal.getvalue() == ""
