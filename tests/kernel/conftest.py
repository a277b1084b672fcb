"""One machine for all trials: booted, deployed, and whole again before each."""

import contextlib
from collections.abc import Generator, Iterator

import pytest

from tests.kernel import table
from tests.kernel.image import image
from tests.kernel.machine import running
from tests.kernel.ports import GuestError
from tests.kernel.robot import Robot, Row, Trial

_rows: list[Row] = []
_kernel: list[str] = []
_passed = pytest.StashKey[bool]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--write-page", action="store_true", help="write the table to docs/report/kernel.md")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    del call
    report = yield
    trial = getattr(item, "funcargs", {}).get("trial")
    if report.failed and trial:
        with contextlib.suppress(GuestError):
            journal = trial.machine.run("journalctl --no-pager -o short-monotonic -u footsense -n 25")
            report.sections.append(("journal", journal))
    if report.when == "call":
        item.stash[_passed] = report.passed
    return report


@pytest.fixture(scope="session")
def robot() -> Iterator[Robot]:
    """Return the booted machine, on which nothing of deploy/README.md has been done but its installation."""
    with running(image()) as machine:
        _kernel.append(machine.run("uname -r").strip())
        yield Robot(machine)


@pytest.fixture(scope="session")
def deployed(robot: Robot) -> Robot:
    """Return the robot after sections 3 to 5 of deploy/README.md."""
    robot.deploy()
    return robot


@pytest.fixture
def trial(deployed: Robot, request: pytest.FixtureRequest) -> Iterator[Trial]:
    """Return a trial on the deployed robot, with all legs valid; its row is named by the test's docstring."""
    deployed.repair()
    yield from _rowed(deployed, request)


@pytest.fixture
def first_trial(robot: Robot, request: pytest.FixtureRequest) -> Iterator[Trial]:
    """Return a trial on the machine as it is."""
    yield from _rowed(robot, request)


def _rowed(robot: Robot, request: pytest.FixtureRequest) -> Iterator[Trial]:
    doc = str(request.function.__doc__).format(**getattr(request.node, "callspec", _NoParameters).params)
    trial = Trial(robot, doc.strip().splitlines()[0].rstrip("."))
    yield trial
    trial.end(passed=request.node.stash.get(_passed, False))
    _rows.append(trial.row)


class _NoParameters:
    params: dict[str, object] = {}  # noqa: RUF012


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, exitstatus: int, config: pytest.Config
) -> None:
    if not _rows:
        return
    terminalreporter.write("\n" + table.markdown(_rows))
    if config.getoption("--write-page") and exitstatus == pytest.ExitCode.OK:
        table.write(_rows, _kernel[0])
