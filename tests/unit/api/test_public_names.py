"""The public interface: what is named is there, and costs nothing before it is used."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import footsense

#: What `import footsense` may load besides the interpreter's own: nothing of ours, and no library.
_IMPORT = "import sys; before = set(sys.modules); import footsense; print(*sorted(set(sys.modules) - before))"


def test_every_public_name_is_there_and_listed_once_everywhere() -> None:
    """`__all__`, the table of modules, and what type checkers see name the same."""
    assert footsense.__all__ == sorted(footsense._MODULES)
    assert {*dir(footsense)} == {*footsense.__all__, "__version__"}
    tree = ast.parse(Path(footsense.__file__).read_text())
    shown = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        and (node.module or "").startswith(("footsense.", "firmware_interface."))
        for alias in node.names
    }
    assert shown == footsense._MODULES
    for name in footsense.__all__:
        assert getattr(footsense, name).__doc__, name


def test_an_unknown_name_is_answered_with_those_there_are() -> None:
    with pytest.raises(AttributeError, match=r"'conect'; it has .* connect, read, simulate"):
        footsense.conect  # type: ignore[attr-defined]  # noqa: B018


def test_importing_the_package_loads_nothing_else() -> None:
    loaded = subprocess.run([sys.executable, "-c", _IMPORT], capture_output=True, text=True, check=True)
    assert loaded.stdout.split() == ["footsense"]
