"""The house that one person can know: its measures, and that what its docstrings name exists."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import msgspec

from footsense.config import Config

ROOT = Path(__file__).parents[1]
MODULES = {
    path.relative_to(ROOT): path.read_text(encoding="utf-8")
    for package in ("firmware_interface", "footsense")
    for path in sorted((ROOT / package).rglob("*.py"))
}
TREES = {path: ast.parse(text) for path, text in MODULES.items()}
Definition = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef

#: Keys of a configuration that are a quantity of feet or buses, whoever sets it.
QUANTITIES = {"rate_hz", "stray_pf", "unloaded_pf", "foot_type"}
#: Words in backticks that are names of other programs, or parts of names.
WORDS_OF_OTHERS = {
    "cell0",
    "gpioinfo",
    "metadata_props",
    "pfifo",
    "pfifo_head_drop",
}


def definitions() -> Iterator[tuple[Path, Definition]]:
    for path, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, Definition):
                yield path, node


def test_no_two_classes_have_one_name() -> None:
    names = Counter(node.name for _, node in definitions() if isinstance(node, ast.ClassDef))
    assert [name for name, n in names.items() if n > 1] == []


def test_rooms_can_be_seen_at_once() -> None:
    """No module is longer than 500 lines, and no folder has more than a dozen beside its __init__."""
    assert [str(path) for path, text in MODULES.items() if text.count("\n") > 500] == []
    folders = Counter(path.parent for path in MODULES if path.name != "__init__.py")
    assert [str(folder) for folder, n in folders.items() if n > 12] == []


def keys_of(hint: Any) -> Iterator[str]:
    for field in msgspec.structs.fields(hint) if hasattr(hint, "__struct_fields__") else ():
        yield field.encode_name
        yield from keys_of(field.type)
    for part in get_args(hint):
        yield from keys_of(part)


def test_a_key_of_the_configuration_is_in_three_files() -> None:
    """Of what a robot runs; a key of one word may mean something else elsewhere."""
    served = [
        text for path, text in MODULES.items() if not {"lab", "benchmarks", "validation"} & {*path.parts}
    ]
    keys = {key for key in keys_of(Config) if "_" in key} - QUANTITIES
    files = {key: sum(re.search(rf"\b{key}\b", text) is not None for text in served) for key in keys}
    assert {key: n for key, n in files.items() if n > 3} == {}


def names_of(node: Definition) -> set[str]:
    """Return what a docstring may name: parameters of a function or a constructor, and what a class has."""
    names = set()
    for inner in ast.walk(node):
        match inner:
            case ast.arg(arg=name) | ast.FunctionDef(name=name) | ast.Name(id=name, ctx=ast.Store()):
                names.add(name)
            case ast.Attribute(attr=name, ctx=ast.Store()):
                names.add(name)
    return names


def test_documented_arguments_exist() -> None:
    """Every name of a section Args or Attributes is one of the function, or of the class."""
    classes = {node.name: node for _, node in definitions() if isinstance(node, ast.ClassDef)}
    wrong = []
    for path, node in definitions():
        known = names_of(node)
        for base in getattr(node, "bases", ()):
            known |= (
                names_of(classes[base.id]) if isinstance(base, ast.Name) and base.id in classes else set()
            )
        for section in re.findall(
            r"^(?:Args|Attributes):\n((?:    .*\n?|\n)+)",
            (ast.get_docstring(node) or "") + "\n",
            re.MULTILINE,
        ):
            named = re.findall(r"^    \*{0,2}(\w+)(?:,[\w, ]+)?:", section, re.MULTILINE)
            wrong += [f"{path}:{node.lineno}: {name}" for name in named if name not in known]
    assert not wrong, "\n".join(wrong)


def test_names_in_backticks_exist() -> None:
    """A word of code in a docstring or a comment is somewhere in the code, outside of backticks."""
    patterns = ("footsense/**/*.[yjc]*", "firmware_interface/**/*.[chd]*", "deploy/*", "models/**/*.yaml")
    others = [path for pattern in patterns for path in ROOT.glob(pattern) if path.is_file()]
    texts = [*MODULES.values(), *(path.read_text(encoding="utf-8", errors="ignore") for path in others)]
    known = {word for text in texts for word in re.findall(r"\w+", re.sub(r"`[^`\n]*`", "", text))}
    wrong = [
        f"{path}: {name}"
        for path, text in MODULES.items()
        for name in re.findall(r"`([A-Za-z_]\w*)(?:\(\))?`", text)
        if name not in known | WORDS_OF_OTHERS
    ]
    assert not wrong, "\n".join(wrong)
