"""The commands of deploy/README.md, taken from the page itself."""

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "deploy" / "README.md"

#: What is done before a command, by its first words: the other way to install, at the top of the checkout, where the
#: first way has put nothing.
BEFORE = {
    "pip wheel": "cd ..; PATH=/opt/footsense/bin:$PATH; pip uninstall --quiet --yes footsense footsense-client",
    "/opt/footsense/bin/pip install --no-index --no-deps footsense": "cd dist",
}
#: Commands that show something until they are interrupted.
ENDLESS = ("candump ", "journalctl -u footsense -f", "/opt/footsense/bin/footsense monitor")

_SECTION = re.compile(r"^## (.+)$", re.MULTILINE)
_BLOCK = re.compile(r"^```sh\n(.*?)^```", re.DOTALL | re.MULTILINE)


class Command(NamedTuple):
    """A command of the page.

    Attributes:
        section: Title of its section.
        text: The command as printed, its comment included.
    """

    section: str
    text: str

    @property
    def before(self) -> str:
        """Commands to execute before it."""
        return "; ".join(done for words, done in BEFORE.items() if self.text.startswith(words))

    @property
    def is_endless(self) -> bool:
        """Whether somebody has to interrupt it."""
        return self.text.startswith(ENDLESS)


def commands(page: Path = PAGE) -> list[Command]:
    """Return the commands of all blocks, in the order of the page."""
    _, *parts = _SECTION.split(page.read_text(encoding="utf-8"))
    return [
        Command(title, text)
        for title, body in zip(parts[::2], parts[1::2], strict=True)
        for block in _BLOCK.findall(body)
        for text in _complete(block)
    ]


def _complete(block: str) -> Iterator[str]:
    """Yield the commands of a block: lines up to where bash can read them, as a loop has several."""
    text = ""
    for line in block.splitlines():
        text += line
        if subprocess.run(["bash", "-n", "-c", text], capture_output=True, check=False).returncode:
            text += "\n"
        elif not text.endswith("\\"):
            if text and not text.startswith("#"):
                yield text
            text = ""
        else:
            text += "\n"


def section(number: int) -> list[Command]:
    """Return the commands of a numbered section."""
    return [command for command in commands() if command.section.startswith(f"{number}. ")]


def packages() -> list[str]:
    """Return the Debian packages that the page installs."""
    lines = [command.text.partition("#")[0] for command in commands() if "apt-get install" in command.text]
    words = [word for line in lines for word in line.split("install", 1)[1].split()]
    return sorted({word for word in words if not word.startswith("-")})
