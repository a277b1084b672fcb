"""Chromium without a window, driven by Selenium."""

import base64
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from selenium import webdriver
from selenium.common.exceptions import JavascriptException
from selenium.webdriver import ActionChains
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")

#: Why the tests in the browser cannot run here; empty if they can.
MISSING = "" if CHROMIUM and DRIVER else "no chromium and chromedriver: apt install chromium chromium-driver"

_TIMEOUT_S = 20.0
_ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--hide-scrollbars",
    "--disable-dev-shm-usage",
)


class Browser:
    """One window of Chromium.

    Attributes:
        driver: Selenium's driver.
    """

    def __init__(self) -> None:
        options = Options()
        options.binary_location = CHROMIUM or ""
        for argument in _ARGUMENTS:
            options.add_argument(argument)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service(DRIVER))
        self.driver.set_script_timeout(_TIMEOUT_S)
        self.look()

    def look(self, width: int = 1280, height: int = 860, *, dark: bool = False) -> None:
        """Set the size of the window [px], and light or dark."""
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600},
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})

    def open(self, url: str) -> None:
        """Open a page, and empty the log of the one before."""
        self.driver.get_log("browser")  # type: ignore[no-untyped-call]
        self.driver.get(url)

    def js(self, script: str, *arguments: object) -> Any:
        """Return the value of a script in the page."""
        return self.driver.execute_script(script, *arguments)

    def wait(self, condition: str, each: Callable[[], None] = lambda: None) -> Any:
        """Wait until an expression of the page is true, and return it.

        Args:
            condition: The expression.
            each: Called before each look.
        """

        def found(_: object) -> Any:
            each()
            return self.js(f"return {condition}")

        # A page that is not drawn yet has nothing that the expression asks.
        return WebDriverWait(self.driver, _TIMEOUT_S, 0.03, (JavascriptException,)).until(found, condition)

    def cpu_s(self) -> float:
        """Return the processor time that the page's thread has taken [s]: scripts, layout and painting."""
        self.driver.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})
        metrics = self.driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
        return float(next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration"))

    def keys(self, keys: str) -> None:
        """Press keys, one after the other."""
        pressed = (
            "for (const key of arguments[0]) document.body.dispatchEvent(new KeyboardEvent('keydown', {0}))"
        )
        self.js(pressed.replace("{0}", "{key, bubbles: true}"), keys)

    def point(self, selector: str, share: float) -> ActionChains:
        """Move the mouse over an element; `share` is the place over its width, from the left."""
        element = self.driver.find_element(By.CSS_SELECTOR, selector)
        actions = ActionChains(self.driver, duration=0)
        across = round((share - 0.5) * element.size["width"])
        actions.move_to_element_with_offset(element, across, 0).perform()
        return actions

    def drag(self, selector: str, first: float, last: float) -> None:
        """Drag the mouse over an element, from one share of its width to another."""
        self.point(selector, first).click_and_hold().perform()
        self.point(selector, last).release().perform()

    def double_click(self, selector: str) -> None:
        """Double-click in the middle of an element."""
        self.point(selector, 0.5).double_click().perform()

    def text(self, selector: str) -> str:
        """Return the text of the first element of a CSS selector."""
        return str(self.js("return document.querySelector(arguments[0])?.textContent ?? ''", selector))

    def errors(self) -> list[str]:
        """Return the errors in the console since the page was opened."""
        log = self.driver.get_log("browser")  # type: ignore[no-untyped-call]
        return [entry["message"] for entry in log if entry["level"] == "SEVERE"]

    def picture(self, path: Path, *, whole: bool = False) -> None:
        """Save the window as a PNG; `whole`: the page to its end."""
        answer = self.driver.execute_cdp_cmd(
            "Page.captureScreenshot", {"format": "png", "captureBeyondViewport": whole}
        )
        path.write_bytes(base64.b64decode(answer["data"]))

    def __enter__(self) -> Self:
        """Return the open browser."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the browser."""
        self.driver.quit()
