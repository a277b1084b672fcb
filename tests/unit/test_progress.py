"""Progress is shown on a terminal, with the time left, and nowhere else."""

import io
import sys

import pytest

from footsense import progress


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal_of(monkeypatch: pytest.MonkeyPatch) -> _Terminal:
    """Let standard error be a terminal, within the test: around it pytest has one of its own."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal := _Terminal())
    return terminal


def test_a_terminal_shows_the_part_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bar names its task, and is taken away at the end."""
    terminal = terminal_of(monkeypatch)
    with progress.progress_bar("walk.csv", 200) as done_so_far:
        done_so_far(100)
    assert "walk.csv" in terminal.getvalue()
    assert "50%" in terminal.getvalue()
    assert terminal.getvalue().endswith("\x1b[2K")  # the line is erased


@pytest.mark.parametrize(("usual_s", "says"), [(3605.0, "of usually 60:05"), (0.0, "")])
def test_a_timed_task_says_the_usual_time_if_it_is_known(
    monkeypatch: pytest.MonkeyPatch, usual_s: float, says: str
) -> None:
    terminal = terminal_of(monkeypatch)
    with progress.timed_bar("film", usual_s):
        pass
    assert says in terminal.getvalue()
    assert bool(says) == bool(terminal.getvalue())


def test_a_file_or_a_pipe_gets_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress.progress_bar("walk.csv", 200) as done_so_far, progress.timed_bar("film", 60.0):
        done_so_far(100)
    assert capsys.readouterr() == ("", "")
