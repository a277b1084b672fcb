"""The table of trials, printed and as a page of Markdown."""

from pathlib import Path

from tests.kernel.machine import INSTRUCTIONS_PER_NS
from tests.kernel.robot import Row

PAGE = Path(__file__).parents[2] / "docs" / "report" / "kernel.md"

_HEAD = """# On a real kernel

Written by `make kernel-test`; not edited by hand.

footsense as `deploy/README.md` installs it, on Debian 12 with Linux {kernel}, in an emulator: systemd, i2c-dev and
SocketCAN are real, the chips behind the I2C adapters are simulated (`tests/kernel/README.md`). The machine has one
processor at {speed} instructions per nanosecond, and six legs of board `ad7147`, the default, three on each of two
buses; where a row says so, those of board `fdc1004`, on one bus at 100 samples/s. What CAN showed: the states of the
legs in turn, as a consumer of `candump` saw them. Recovered after: from the end of the disturbance, or from the kill,
until all legs were valid, in the machine's own time. In the journal of the trials no state of a leg changed to itself,
and none to `stale` without a cause.

"""


def markdown(rows: list[Row]) -> str:
    """Return the table."""
    lines = ["| done | CAN showed | recovered after |", "|---|---|---:|"]
    for row in rows:
        recovered = "" if row.recovered_s is None else f"{row.recovered_s:.1f} s"
        failed = "" if row.passed else "**failed** "
        lines.append(f"| {row.did} | {failed}{row.shown} | {recovered} |")
    return "\n".join(lines) + "\n"


def write(rows: list[Row], kernel: str) -> None:
    """Write the page."""
    PAGE.write_text(_HEAD.format(kernel=kernel, speed=INSTRUCTIONS_PER_NS) + markdown(rows), encoding="utf-8")
