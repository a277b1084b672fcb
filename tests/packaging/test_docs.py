"""What the documentation names exists."""

import re
import subprocess
import sys
from pathlib import Path

import click
import msgspec
import pytest

from footsense import strict_yaml
from footsense.cli import main
from footsense.config import Config
from footsense.sim.scene import Scene

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path.relative_to(ROOT)
    for pattern in (
        "*.md",
        "deploy/*.md",
        "docs/*.md",
        "docs/[!r]*/*.md",
        "docs/reference/*.md",
        "firmware_interface/**/*.md",
    )
    for path in ROOT.glob(pattern)
    if path.name != "CHANGELOG.md"
    # A decision that was replaced names what there was.
    if not re.search(r"^Status: (?:superseded|replaced)", path.read_text(encoding="utf-8"), re.MULTILINE)
)
_LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")
_PATH = re.compile(
    r"`((?:[\w.-]+/)+[\w.-]*\.(?:py|md|yaml|c|h|dbc|toml|csv|onnx|npz|network|service|rules))`"
)
_BLOCK = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
#: Folders that a path in the text may start from, beside the page's own.
_STARTS = (
    "",
    "footsense",
    "footsense/acquisition",
    "footsense/estimation",
    "footsense/sim",
    "footsense/lab",
    "firmware_interface",
)


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_links_and_paths_of_a_page_exist(page: Path) -> None:
    """A link leads to a file of the checkout, and a path in backticks is one of it."""
    text = (ROOT / page).read_text(encoding="utf-8")
    here = (ROOT / page).parent
    missing = [link for link in _LINK.findall(text) if not (here / link).exists()]
    for path in _PATH.findall(text):
        found = (here / path).exists() or any((ROOT / start / path).exists() for start in _STARTS)
        if not found and not path.startswith(("my-", "walk", "/")):
            missing.append(path)
    assert not missing


def test_the_reference_is_what_the_code_says() -> None:
    """The generated parts of the pages are committed; `make docs` writes them anew."""
    checked = subprocess.run(
        [sys.executable, ROOT / "docs/site/reference.py", "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stderr


#: What a generator leaves of a text that it did not take apart rightly.
_TORN = {
    "a sentence as a parameter": r"^- `[^`]*\s[^`]*`:",
    "a word at a name": r"\w`\w+`[.,;]? \|",
    "a code without its number": r"^\| `[A-Z_0-9]+` \| (?!\d|0x)",
    "help without -h": r"^  --help ",
}


@pytest.mark.parametrize("torn", _TORN)
def test_the_reference_has_whole_names_and_sentences(torn: str) -> None:
    pages = (ROOT / "docs/reference").glob("*.md")
    found = [
        line
        for page in pages
        for line in re.findall(f"{_TORN[torn]}.*", page.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert not found


def test_a_method_of_the_reference_has_all_its_parameters() -> None:
    assert "Feet.tare(*legs: str)" in (ROOT / "docs/reference/python.md").read_text(encoding="utf-8")


def test_the_scene_on_the_page_of_scenes_is_one() -> None:
    page = (ROOT / "docs/reference/scenes.md").read_text(encoding="utf-8")
    text = page.split("```yaml\n")[1].split("```")[0]
    assert [type(fault).__name__ for fault in strict_yaml.load(text, Scene).faults] == ["BrokenColumn"]


def test_documents_that_code_refers_to_exist() -> None:
    """Docstrings and comments name documents by path, decisions by number."""
    missing = []
    for path in (*ROOT.glob("footsense/**/*.py"), *ROOT.glob("firmware_interface/**/*.[pch]*")):
        for named in re.findall(r"\bdocs/[\w./-]*\w", path.read_text(encoding="utf-8", errors="ignore")):
            made_by_a_command = named.startswith("docs/report-quick")
            if not made_by_a_command and not (ROOT / named).exists() and not list(ROOT.glob(f"{named}*")):
                missing.append(f"{path.relative_to(ROOT)}: {named}")
    assert not missing


def commands(text: str) -> list[list[str]]:
    """Return the words behind `footsense` of every command line in a page, in blocks and within lines."""
    lines = "\n".join(_BLOCK.findall(text)).replace("\\\n", " ").splitlines()
    lines += [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", _BLOCK.sub("", text))]
    found = (re.match(r"(?:\S*/)?footsense (?=\S)([^#]*)", line) for line in lines)
    return [match[1].split() for match in found if match]


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_commands_and_options_of_a_page_exist(page: Path) -> None:
    """Each command of a page is one of the command line's, and so is each of its options."""
    wrong = []
    for words in commands((ROOT / page).read_text(encoding="utf-8")):
        command: click.Command | None = main
        rest = [word for word in words if word != "-v"]
        while isinstance(command, click.Group) and rest:
            command = command.get_command(click.Context(command), rest.pop(0))
        known = (
            {option for param in command.params for option in param.opts + param.secondary_opts}
            if command
            else set()
        )
        named = {word for word in rest if word.startswith("--")}
        if command is None or named - known:
            wrong.append(" ".join(words))
    assert not wrong


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_keys_and_metrics_of_a_page_exist(page: Path) -> None:
    """`section.key` is one of the configuration, and `footsense_...` a metric or a name of the C header files."""
    text = (ROOT / page).read_text(encoding="utf-8")
    schema = msgspec.json.schema(Config)
    keys = {key for one in schema["$defs"].values() for key in one.get("properties", ())}
    dotted = [
        name.replace("[]", "").split(".") for name in re.findall(r"`([a-z_]+(?:\[\])?(?:\.[a-z_]+)+)`", text)
    ]
    wrong = [
        ".".join(parts)
        for parts in dotted
        if parts[0] in Config.__struct_fields__ and parts[-1] != "py" and set(parts) - keys
    ]
    sources = (*ROOT.glob("footsense/telemetry/*.py"), *ROOT.glob("firmware_interface/[cm]*/*.h"))
    names = {
        name for path in sources for name in re.findall(r"footsense_\w+", path.read_text(encoding="utf-8"))
    }
    named = set(re.findall(r"\bfootsense_\w+", text)) - {
        path.stem for path in ROOT.glob("firmware_interface/[cm]*/*")
    }
    assert wrong + sorted(named - names) == []
