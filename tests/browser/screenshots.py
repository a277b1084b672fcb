"""Make the screenshots of the documentation: `python -m tests.browser.screenshots`.

view-live.png      six legs walk in simulation
view-fault.png     a leg has lost a row, another does not answer
view-replay.png    the golden recording
view-phone.png     the walk on a phone
terminal.png       `footsense run` in a terminal
"""

import os
import pty
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tests.browser.chromium import MISSING, Browser

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs/images"
GOLDEN = ROOT / "tests/golden/measured_walk.mcap"
SCENE = """\
description: Six legs walk, one has lost a column, another does not answer.
load: {kind: tripod, period_s: 1.2, duty_rel: 0.6, peak_force_n: 1.0, friction_rel: 0.15, pitch_deg: 10}
host_cost_us: 40
effects: {converter_noise: true, converter_clock_rel: 0.01, gap_contact: true}
faults:
  - {at_s: 2.0, leg: lm, fault: broken_column, column: 0}
  - {at_s: 3.0, leg: rr, fault: absent}
"""
#: The terminal in a page of its own: a dark window with the text that rich has drawn.
TERMINAL = """<!doctype html><meta charset="utf-8"><style>body { margin: 0; background: #16191a; color: #e3e6e5;
padding: 18px 22px; width: max-content } pre { font: 15px/1.35 "DejaVu Sans Mono", monospace; margin: 0 }</style>"""


@contextmanager
def footsense(*arguments: str | Path) -> Iterator[str]:
    """Run a command that prints the address of its page; yield the address."""
    with subprocess.Popen(
        [sys.executable, "-m", "footsense", *arguments], stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().split()[-1]
        finally:
            process.terminate()


def pause(browser: Browser) -> None:
    """Pause the page, and wait until its slower texts are of the same time."""
    browser.js("document.querySelector('#pause').click()")
    drawn = browser.js("return footsense.frames")
    browser.wait(f"footsense.frames > {drawn + 20}")


def walk(browser: Browser) -> None:
    """Draw a walk, on a screen and on a phone."""
    with footsense("run", "--scene", "measured_walk", "--realtime") as url:
        browser.look(1280, 800)
        browser.open(url)
        browser.wait("footsense.store?.end > 9 && document.querySelectorAll('#robot .contact').length === 3")
        pause(browser)
        browser.picture(FOLDER / "view-live.png")
        browser.look(390, 844, dark=True)
        browser.wait("innerWidth === 390 && footsense.frames > 10")
        browser.picture(FOLDER / "view-phone.png")


def fault(browser: Browser, folder: Path) -> None:
    """Draw two broken legs."""
    (folder / "scene.yaml").write_text(SCENE)
    with footsense("run", "--scene", folder / "scene.yaml", "--realtime") as url:
        browser.look(1280, 800)
        browser.open(url)
        browser.wait("footsense.store?.end > 9 && document.querySelectorAll('#problems li').length === 2")
        browser.wait("document.querySelector('[data-leg=lm].contact')")
        pause(browser)
        browser.picture(FOLDER / "view-fault.png")


def replay(browser: Browser) -> None:
    """Draw the golden recording, paused at a heel strike."""
    with footsense("view", GOLDEN, "--port", "0") as url:
        browser.look(1280, 800, dark=True)
        browser.open(url)
        browser.wait("footsense.replay?.done && footsense.replay.t > 0.3")
        browser.js("document.querySelector('#play').click(); footsense.replay.seek(2.36)")
        browser.js("document.querySelector('[data-signal=fx]').click()")
        browser.wait("Math.abs(footsense.drawn - 2.36) < 0.01 && footsense.frames > 30")
        browser.picture(FOLDER / "view-replay.png")


def terminal(browser: Browser, folder: Path) -> None:
    """Draw the last picture of `footsense run` on a terminal of 80 columns."""
    from rich.console import Console
    from rich.text import Text

    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "footsense", "run", "--scene", "measured_walk", "--duration", "3.6"]
    environment = {**os.environ, "COLUMNS": "80", "TERM": "xterm-256color", "COLORTERM": "truecolor"}
    written = b""
    with subprocess.Popen(command, stdout=theirs, stdin=theirs, cwd=ROOT, env=environment):
        os.close(theirs)
        with suppress(OSError):  # the other end is closed at the end of the process
            while data := os.read(ours, 65_536):
                written += data
    os.close(ours)
    last = written.decode().split("footsense  ")[-1].split("cycles")[0]
    console = Console(record=True, width=80, file=Path(os.devnull).open("w"))  # noqa: SIM115 - for this process
    console.print(
        Text.from_ansi("\x1b[1mfootsense  " + last.replace("\r", "").split("\x1b[?25h")[0].rstrip())
    )
    page = folder / "terminal.html"
    page.write_text(TERMINAL + console.export_html(inline_styles=True, code_format="<pre>{code}</pre>"))
    browser.open(page.as_uri())
    width, height = browser.js("return [document.body.offsetWidth, document.body.offsetHeight]")
    browser.look(width, height)
    browser.picture(FOLDER / "terminal.png")


def main() -> None:
    """Make all screenshots."""
    if MISSING:
        sys.exit(f"screenshots: {MISSING}")
    FOLDER.mkdir(exist_ok=True)
    with Browser() as browser, tempfile.TemporaryDirectory() as folder:
        walk(browser)
        fault(browser, Path(folder))
        replay(browser)
        terminal(browser, Path(folder))


if __name__ == "__main__":
    main()
