"""One machine for the trials of a process: booted, deployed, and whole again before each trial."""

import contextlib
import re
from collections.abc import Generator, Iterator
from dataclasses import asdict
from operator import itemgetter

import pytest

from tests.kernel import table
from tests.kernel.image import image
from tests.kernel.machine import running
from tests.kernel.ports import GuestError
from tests.kernel.robot import Robot, Row, Trial

#: Rows of the table and the file of each trial; releases of the kernel.
_rows: list[tuple[str, Row]] = []
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
        yield Robot(machine)


@pytest.fixture(scope="session")
def deployed(robot: Robot) -> Iterator[Robot]:
    """Return the robot after sections 2 to 5 of deploy/README.md, and judge its journal after all trials."""
    robot.deploy()
    yield robot
    check_journal(robot.machine.run("journalctl -u footsense --no-pager -o cat").splitlines())


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
    request.node.user_properties += [
        ("row", asdict(trial.row)),
        ("kernel", robot.machine.run("uname -r").strip()),
    ]


def check_journal(lines: list[str]) -> None:
    """Check that no leg's state changed to itself, and none to `stale` without a cause."""
    found = (re.search(r"leg \w\w: (\w+) -> (\w+)(?: \((.+)\))?$", line) for line in lines)
    changes = [match.groups() for match in found if match]
    assert changes
    assert [change for change in changes if change[0] == change[1]] == []
    assert [change for change in changes if change[1] == "stale" and not change[2]] == []


class _NoParameters:
    params: dict[str, object] = {}  # noqa: RUF012


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Collect the rows, which trials in other processes send with their reports."""
    if report.when == "teardown":
        found = dict(report.user_properties)
        if isinstance(row := found.get("row"), dict):
            _rows.append((report.nodeid.partition("::")[0], Row(**row)))
            _kernel.append(str(found["kernel"]))


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, exitstatus: int, config: pytest.Config
) -> None:
    if not _rows or hasattr(config, "workerinput"):  # a process of some of the trials
        return
    rows = [
        row for _, row in sorted(_rows, key=itemgetter(0))
    ]  # files in turn, each in the order of its trials
    terminalreporter.write("\n" + table.markdown(rows))
    if config.getoption("--write-page") and exitstatus == pytest.ExitCode.OK:
        table.write(rows, _kernel[0])
