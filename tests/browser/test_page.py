"""What somebody sees: six feet, a pressed one at once, a broken leg with its remedy, a restart, a recording."""

import asyncio
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from queue import Queue
from threading import Thread

import numpy as np
import pytest
from selenium.webdriver.support.ui import WebDriverWait

from footsense.clock import MonotonicClock
from footsense.frames import Cause, Flag, State
from tests.browser.chromium import MISSING, Browser
from tests.support.viewed_service import LEGS, ViewedService, served
from tests.system.command import serving

GOLDEN = Path(__file__).parents[1] / "golden/measured_walk.mcap"
SIX_FEET = "window.footsense?.robot && document.querySelectorAll('#robot .foot').length === 6"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(MISSING), reason=MISSING)]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as browser:
        yield browser


@pytest.fixture(scope="module")
def cycles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shared") / "cycles"


@pytest.fixture(scope="module")
def url(cycles: Path) -> Iterator[str]:
    with serving("view", "--port", "0", "--ring", cycles) as (_, url):
        yield url


def cell_colour(browser: Browser, leg: str, element: int) -> str:
    return str(
        browser.js(
            "return getComputedStyle(document.querySelectorAll(`[data-leg=${arguments[0]}] .cell`)[arguments[1]]).fill",
            leg,
            element,
        )
    )


def test_six_feet_and_the_pressed_one(browser: Browser, cycles: Path, url: str) -> None:
    """With its closures, arrow, bar, cone, the numbers beside it, and its cells."""
    with ViewedService(cycles) as service:
        service.force_n[4] = 0.2, 0.1, 1.2
        browser.look()
        browser.open(url)
        browser.wait(
            f"{SIX_FEET} && document.querySelector('[data-leg=rm].contact')", lambda: service.publish(5)
        )
        assert browser.text("#title") == "six feet under a thumb"
        assert browser.text("[data-leg=rm] .fz") == "1.20 N"
        assert browser.text("tr[data-leg=rm]").startswith("RMvalidcontact+0.200+0.100+1.20020")
        assert browser.text("[data-leg=lf] .fz") == "0.00 N"
        assert cell_colour(browser, "rm", 8) != cell_colour(browser, "rm", 0) != cell_colour(browser, "lf", 0)
        # Forward is up and left is left: the arrow of a force forwards and to the left.
        arrow = browser.js(
            "const a = document.querySelector('[data-leg=rm] .arrow').attributes;"
            "return ['x1', 'x2', 'y1', 'y2'].map((name) => Number(a[name].value))"
        )
        assert arrow[1] < arrow[0]
        assert arrow[3] < arrow[2]
        cone, tip = browser.js(
            "const foot = document.querySelector('[data-leg=rm]');"
            "const [cone, sigma] = [foot.querySelector('.cone'), foot.querySelector('.sigma')];"
            "return [cone.r.baseVal.value, Math.hypot(sigma.cx.baseVal.value - cone.cx.baseVal.value,"
            "sigma.cy.baseVal.value - cone.cy.baseVal.value)]"
        )
        assert tip / cone == pytest.approx(np.hypot(0.2, 0.1) / (0.4 * 1.2), rel=1e-3)
        browser.wait(
            "document.querySelector('#problems .fine')?.textContent === 'Nothing is wrong.'",
            lambda: service.publish(5),
        )
        # Its cells: row by row in a frame, the crossed one in its place, and a line in the plot.
        service.fault_mask[4] = 1 << 8
        browser.wait("document.querySelector('[data-leg=rm] .dead.on')", lambda: service.publish(5))
        first, second, fourth, last, frame, cross = browser.js(
            "const foot = document.querySelector('[data-leg=rm]');"
            "const cells = foot.querySelectorAll('.cell');"
            "return [cells[0], cells[1], cells[3], cells[8], foot.querySelector('.frame'),"
            "foot.querySelector('.dead.on')].map((node) => { const box = node.getBBox();"
            "return [box.x, box.y, box.x + box.width, box.y + box.height] })"
        )
        assert (second[0] - first[2], second[1]) == (3.0, first[1])
        assert (fourth[1] - first[3], fourth[0]) == (3.0, first[0])
        assert np.subtract(frame[2:], last[2:]) == pytest.approx(np.subtract(first[:2], frame[:2]))
        assert np.add(last[:2], last[2:]) == pytest.approx(np.add(cross[:2], cross[2:]))
        assert cell_colour(browser, "rm", 7) != cell_colour(browser, "rm", 0)
        assert browser.errors() == []


def test_a_press_is_seen_within_a_tenth_of_a_second(browser: Browser, cycles: Path, url: str) -> None:
    """From the cycle in shared memory to the picture, Selenium's part included; three of ten, on a busy machine too.

    The foot is looked up anew each time: the page is built again when it learns of a new service.
    """
    clock = MonotonicClock()
    with ViewedService(cycles) as service:
        browser.open(url)
        browser.wait(SIX_FEET, service.publish)
        took_ms = []
        for press in range(10):
            service.force_n[press % 6, 2] = force_n = 0.3 + 0.1 * press
            start_ns = clock.now_ns()
            service.publish()
            browser.driver.execute_async_script(
                "const [leg, wanted, done] = arguments;"
                "const force = () => document.querySelector(`[data-leg=${leg}] .fz`).textContent;"
                "const look = () => force() === wanted ? done() : requestAnimationFrame(look); look()",
                LEGS[press % 6],
                f"{force_n:.2f} N",
            )
            took_ms.append((clock.now_ns() - start_ns) * 1e-6)
        assert sorted(took_ms)[2] < 100.0


def test_a_picture_costs_less_than_a_sixtieth_of_a_second(browser: Browser, cycles: Path, url: str) -> None:
    """Of the time of the page's own thread, with new cycles in each picture and five seconds in the plot."""
    with ViewedService(cycles) as service:
        browser.open(url)
        browser.wait(f"{SIX_FEET} && footsense.n > 1800", lambda: service.publish(250))
        before_s, frames = browser.cpu_s(), browser.js("return footsense.frames")
        service.force_n[:, 2] = 0.5

        def walk() -> None:
            service.force_n += 0.01
            service.publish(12)

        browser.wait(f"footsense.frames > {frames + 20}", walk)
        spent_s = browser.cpu_s() - before_s
        assert spent_s / (browser.js("return footsense.frames") - frames) < 1 / 60


def test_a_broken_leg_says_what_to_do(browser: Browser, cycles: Path, url: str) -> None:
    """An open row is crossed out, a silent leg is empty; both have a cause and a remedy; the others go on."""
    with ViewedService(cycles) as service:
        service.force_n[:, 2] = 0.5
        browser.open(url)
        browser.wait(SIX_FEET, service.publish)
        service.state[0], service.cause[0], service.fault_mask[0] = State.DEGRADED, Cause.ROW_OPEN, 0b111
        service.state[5], service.cause[5] = State.ABSENT, Cause.NO_ANSWER
        browser.wait("document.querySelectorAll('#problems li').length === 2", service.publish)
        first, second = (browser.text(f"#problems li:nth-child({n})") for n in (1, 2))
        assert first.startswith("LFdegraded: row open — the line of a row is interrupted. Check the plug")
        assert second == (
            "RRabsent: no answer — its chips do not answer. "
            "Check its plug, its supply, its address straps, and whether this is its channel."
        )
        assert browser.js("return document.querySelectorAll('[data-leg=lf] .dead.on').length") == 3
        assert browser.text("[data-leg=rr] .fz") == "\N{EN DASH} N"
        assert browser.text("[data-leg=lm] .fz") == "0.50 N"
        assert "absent: no answer" in browser.text("#events")
        assert browser.errors() == []


def test_refused_tares_are_one_line(browser: Browser, cycles: Path, url: str) -> None:
    """With the command to try as code; a single leg is named like any other."""
    with ViewedService(cycles) as service:
        service.flags[:] = Flag.TARE_REFUSED
        browser.open(url)
        browser.wait(f"{SIX_FEET} && document.querySelector('#problems li')", service.publish)
        assert browser.text("#problems ul") == (
            "tare refused of LF, LM, LR, RF, RM, RR \N{EM DASH} the older baseline is in use. "
            "Check that nothing presses the foot and it hangs still; then footsense tare LEG."
        )
        assert browser.text("#problems code") == "footsense tare LEG"
        service.flags[1:] = 0
        browser.wait(
            "document.querySelector('#problems ul').textContent.startsWith('LFtare refused')", service.publish
        )


def test_the_service_and_the_viewer_start_again(browser: Browser, cycles: Path, tmp_path: Path) -> None:
    """The page says what is missing and what to do, keeps the last values, and goes on by itself."""
    with serving("view", "--port", "0", "--ring", cycles) as (viewer, url):
        browser.open(url)
        assert (
            browser.js("return fetch('/').then((page) => page.text())").count('<section id="empty" hidden>')
            == 1
        )
        browser.wait("document.querySelector('#banner')?.textContent.includes('No service runs')")
        assert "start footsense run" in browser.text("#banner")
        assert not browser.js("return document.querySelector('#empty').hidden")
        with ViewedService(cycles) as service:
            service.force_n[:, 2] = 0.4
            browser.wait(f"{SIX_FEET} && document.body.dataset.link === 'live'", service.publish)
            assert browser.js("return document.querySelector('#banner').hidden")
        browser.wait("document.body.dataset.link === 'ended'")
        assert "The service has ended" in browser.text("#banner")
        assert browser.js("return document.querySelector('#empty').hidden")
        assert browser.text("[data-leg=lm] .fz") == "0.40 N"
        with ViewedService(cycles) as service:
            service.force_n[:, 2] = 0.6
            browser.wait(
                "document.body.dataset.link === 'live'"
                " && document.querySelector('[data-leg=lm] .fz').textContent === '0.60 N'",
                service.publish,
            )
            viewer.terminate()
            browser.wait("document.body.dataset.link === 'lost'", service.publish)
            assert "The viewer does not answer" in browser.text("#banner")


def test_a_run_ends_its_first_line_with_the_page(browser: Browser) -> None:
    """The page shows that run, and both end together."""
    with serving("run", "--realtime", "--duration", "60") as (run, first):
        assert re.match(r"footsense  tripod, simulated  http://127\.0\.0\.1:\d+$", first)
        browser.open(first.split()[-1])
        browser.wait(f"{SIX_FEET} && document.querySelectorAll('#robot .valid').length === 6")
        run.kill()
        browser.wait("document.body.dataset.link === 'lost'")


def test_a_recording_is_played_and_stepped(browser: Browser) -> None:
    """The golden walk: time bar, speed, events, keys."""
    with serving("view", "--port", "0", GOLDEN) as (_, url):
        browser.open(url)
        browser.wait(f"{SIX_FEET} && window.footsense.replay?.t > 0.5 && footsense.replay.done")
        assert browser.text("#title") == "measured_walk.mcap"
        assert not browser.js("return document.querySelector('#replay').hidden")
        browser.js("document.querySelector('#play').click(); footsense.replay.seek(0)")
        browser.keys("nnnn")
        browser.wait("footsense.drawn > 0.1")
        t = browser.js("return footsense.replay.t")
        assert browser.js("return footsense.replay.events.all.some((event) => event.t === arguments[0])", t)
        assert not browser.js("return footsense.replay.playing")
        browser.js("window.footsense.replay.seek(2.0)")
        browser.wait("Math.abs(window.footsense.drawn - 2.0) < 0.007")
        browser.wait("document.querySelectorAll('#robot .contact').length >= 3")
        assert re.match(r"2\.00 / 3\.9 s", browser.text("#time"))
        assert t < 2.0
        browser.point("[data-leg=rr] .u-over", 0.999)
        browser.wait("document.querySelector('.at').textContent.startsWith('3.9')")
        assert browser.errors() == []


def test_a_cut_recording_is_told_by_its_name(browser: Browser, tmp_path: Path) -> None:
    """As it is written; and what is wrong with the legs does not deny it."""
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(GOLDEN.read_bytes()[:400_000])
    with serving("view", "--port", "0", cut) as (viewer, url):
        browser.open(url)
        browser.wait(f"{SIX_FEET} && document.querySelector('#banner').textContent")
        assert browser.text("#banner").startswith(f"{cut}: ")
        browser.wait("document.querySelector('#problems .fine').textContent === 'Nothing else is wrong.'")
        viewer.terminate()
        assert viewer.stderr is not None
        assert viewer.stderr.read().startswith(f"footsense: {cut}: ")


#: The texts that are drawn on the plots, with their places [px]; and the lines, with colour and dashes.
WATCH_CANVAS = """
const drawing = CanvasRenderingContext2D.prototype, { fillText, stroke } = drawing;
Object.assign(footsense, { texts: [], lines: new Set() });
drawing.fillText = function (text, x, y) {
  const half = this.measureText(text).width / 2, place = this.canvas.getBoundingClientRect();
  footsense.texts.push([text, x - half, x + half, y + 12, place.width, place.height]);
  fillText.apply(this, arguments);
};
drawing.stroke = function () {
  footsense.lines.add(`${this.strokeStyle} ${this.getLineDash()}`);
  stroke.apply(this, arguments);
};"""


@pytest.mark.parametrize("height", [720, 837])
def test_all_is_whole_with_six_faults(browser: Browser, cycles: Path, url: str, height: int) -> None:
    """Table, faults and times are in the window, and the lanes of six like legs do not touch."""
    with ViewedService(cycles) as service:
        service.state[:], service.cause[:] = State.DEGRADED, Cause.ROW_OPEN
        service.state[5], service.cause[5] = State.CONVERTER_FAULT, Cause.NEVER_FINISHES
        service.fault_mask[:] = 0b111
        service.force_n[:, 2] = 0.6
        browser.look(1280, height)
        browser.open(url)
        browser.wait(f"{SIX_FEET} && document.querySelectorAll('#problems li').length === 6", service.publish)
        browser.js(WATCH_CANVAS)
        browser.wait("footsense.texts.some(([text]) => / s$/.test(text))", service.publish)
        for room, parts in {"#legs": "tr", "#problems": "li", "#chart": ".lane canvas"}.items():
            top, bottom, *edges = browser.js(
                "const edges = (node) => { const box = node.getBoundingClientRect(); return [box.top, box.bottom] };"
                "const [room, parts] = [...arguments].map((text) => [...document.querySelectorAll(text)]);"
                "return [...edges(room[0]), ...parts.flatMap(edges)]",
                room,
                f"{room} {parts}",
            )
            assert len(edges) >= 12
            assert 0 < top <= edges[0]
            assert edges == sorted(edges)
            assert edges[-1] <= bottom <= height
        assert (
            browser.js(
                "const legs = document.querySelector('#legs'); return legs.scrollWidth - legs.clientWidth"
            )
            == 0
        )
        for text, left, right, under, width, depth in browser.js("return footsense.texts"):
            if text.endswith(" s"):
                assert 0 <= left < right <= width, text
                assert under <= depth, text
        browser.look()


def test_a_plot_is_pointed_at_and_zoomed(browser: Browser, cycles: Path, url: str) -> None:
    """It shows the values of each leg under the mouse; what is drawn over fills it until a double click."""
    with ViewedService(cycles) as service:
        browser.open(url)
        browser.wait(SIX_FEET, service.publish)

        def rise() -> None:
            for _ in range(20):
                service.force_n[:, 2] = 0.5 + 0.001 * service.n + 0.1 * np.arange(6)
                service.publish()

        browser.wait("footsense.store.end > 1", rise)
        browser.js("document.querySelector('#pause').click()")

        def point(share: float) -> tuple[float, float, float]:
            browser.point("[data-leg=lm] .u-over", share)
            drawn = browser.js("return footsense.frames")
            browser.wait(f"footsense.frames > {drawn + 10}")
            at = browser.text("#chart .at").removesuffix(" s")
            lf, rr = (browser.text(f".lane[data-leg={leg}] .values") for leg in ("lf", "rr"))
            return float(at), float(lf), float(rr)

        (t_0, _, _), (t_1, first, _), (t_2, second, last) = point(0.01), point(0.25), point(0.75)
        assert last - second == pytest.approx(0.5, abs=2e-3)
        assert second - first == pytest.approx(0.001 * (t_2 - t_1) / 2.7e-3, abs=3e-3)
        assert t_2 - t_1 == pytest.approx(0.5 * browser.js("return footsense.paused"), rel=0.05)
        browser.drag("[data-leg=lm] .u-over", 0.25, 0.75)
        browser.wait("footsense.plot.zoom")
        assert (point(0.01)[0], point(0.99)[0]) == pytest.approx((t_1, t_2), abs=0.03)
        browser.double_click("[data-leg=lm] .u-over")
        browser.wait("!footsense.plot.zoom")
        assert point(0.01)[0] == pytest.approx(t_0, abs=0.03)


def test_the_plot_says_what_a_line_is_and_what_has_no_data(browser: Browser, cycles: Path, url: str) -> None:
    """The chosen signals have the colour and the dashes of their lines; a leg alone or a signal may have no data."""
    with ViewedService(cycles) as service:
        service.state[5], service.cause[5] = State.ABSENT, Cause.NO_ANSWER
        service.force_n[:] = 0.1, 0.2, 0.6
        browser.open(url)
        browser.wait(SIX_FEET, service.publish)
        for signal in ("fx", "fy", "temperature"):
            browser.js(f"document.querySelector('[data-signal={signal}]').click()")
        browser.wait("footsense.store.end > 0.5", lambda: service.publish(20))
        browser.js(WATCH_CANVAS)
        browser.wait("footsense.lines.size > 4", service.publish)
        legend = browser.js(
            "const any = document.createElement('canvas').getContext('2d');"
            "return ['fz', 'fx', 'fy'].map((name) => {"
            " const line = document.querySelector(`[data-signal=${name}] svg`);"
            " any.strokeStyle = getComputedStyle(line).color;"
            " return `${any.strokeStyle} ${line.firstChild.getAttribute('stroke-dasharray')}` })"
        )
        assert len(set(legend)) == 3
        assert set(legend) <= set(browser.js("return [...footsense.lines]"))
        assert browser.text(".lane[data-leg=lf] p") == "temperature: no data"
        assert (
            browser.text(".lane[data-leg=rr] p")
            == "fz: no data, fx: no data, fy: no data, temperature: no data"
        )
        browser.keys("6")
        assert browser.js("return document.querySelectorAll('#chart .uplot').length") == 5
        service.n += 100  # cycles that never come
        browser.wait("footsense.store.end > 1", lambda: service.publish(20))
        browser.wait("footsense.plot.shown[0].uplot.data[1].includes(null)")
        gaps_s = browser.js(
            "const [times, fz] = footsense.plot.shown[0].uplot.data;"
            "return times.map((t, k) => (fz[k] === null ? times[k + 1] - times[k - 1] : 0))"
        )
        assert max(gaps_s) >= 100 * 2.7e-3
        assert browser.errors() == []


def test_a_phone_and_a_hidden_page(browser: Browser, cycles: Path, url: str) -> None:
    """Nothing is wider than a phone; a page that does not draw is sent no more, and then the newest."""
    with ViewedService(cycles) as service:
        browser.look(390, 844, dark=True)
        browser.open(url)
        browser.wait(SIX_FEET, service.publish)
        assert browser.js("return document.documentElement.scrollWidth") <= 390
        hide = "footsense.kept = requestAnimationFrame; requestAnimationFrame = (next) => { footsense.next = next; }"
        browser.js(hide)
        browser.wait("Boolean(footsense.next)", service.publish)
        before = browser.js("return footsense.n")
        for _ in range(20):
            service.publish(20)
            browser.js("return 1")
        assert browser.js("return footsense.n") - before <= 2 * 256
        service.force_n[:, 2] = 0.9
        service.publish()
        browser.js("window.requestAnimationFrame = footsense.kept; requestAnimationFrame(footsense.next)")
        browser.wait("document.querySelector('[data-leg=lm] .fz').textContent === '0.90 N'")
        browser.look()


def test_recordings_of_faults_are_there_when_the_service_is_gone(browser: Browser, tmp_path: Path) -> None:
    """Time, leg and cause of each, and what is downloaded is the file."""
    faults, downloads = tmp_path / "faults", tmp_path / "downloads"
    faults.mkdir()
    name = "2026-11-29T12-00-05Z-lf-element-drifts.mcap"
    shutil.copy(GOLDEN, faults / name)
    hosts: Queue[str] = Queue()
    loop, stop = asyncio.new_event_loop(), asyncio.Event()

    async def serve() -> None:
        async with served(tmp_path / "cycles") as host:
            hosts.put(host)
            await stop.wait()

    server = Thread(target=loop.run_until_complete, args=(serve(),))
    server.start()
    try:
        browser.look()
        to_folder = {"behavior": "allow", "downloadPath": str(downloads)}
        browser.driver.execute_cdp_cmd("Browser.setDownloadBehavior", to_folder)
        browser.open(f"http://{hosts.get(timeout=20)}")
        browser.wait("document.querySelector('#recordings li button')")
        assert browser.text("#recordings summary") == "Recordings of faults (1)"
        browser.js("document.querySelector('#recordings summary').click()")
        assert browser.text("#recordings li") == "2026-11-29 12:00:05 UTC LF element drifts download 0.8 MB"
        browser.js("document.querySelector('#recordings li button').click()")
        WebDriverWait(browser.driver, 20.0, 0.03).until(lambda _: (downloads / name).exists())
        assert (downloads / name).read_bytes() == GOLDEN.read_bytes()
        assert browser.errors() == []
    finally:
        loop.call_soon_threadsafe(stop.set)
        server.join()
        loop.close()
