"""`deploy/requirements.lock` holds all that a robot installs, with hashes, for both kinds of computer."""

import re
import tomllib
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
LOCK = (ROOT / "deploy/requirements.lock").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
DIRECT = [*PROJECT["project"]["dependencies"], *PROJECT["build-system"]["requires"]]
ENTRIES = [
    entry.split() for entry in re.sub(r"#.*", "", LOCK).replace("\\\n", " ").splitlines() if entry.strip()
]


def environment(machine: str) -> dict[str, str]:
    """Return what markers see on a robot: Debian 12, or Raspberry Pi OS 12."""
    return {
        "platform_machine": machine,
        "python_version": "3.11",
        "python_full_version": "3.11.2",
        "extra": "",
    }


def pinned(machine: str) -> dict[str, str]:
    """Return the version of every package that a robot of this kind installs."""
    found: dict[str, str] = {}
    for words in ENTRIES[1:]:
        requirement = Requirement(" ".join(word for word in words if not word.startswith("--hash=")))
        if requirement.marker is None or requirement.marker.evaluate(environment(machine)):
            (pin,) = requirement.specifier
            assert pin.operator == "=="
            assert requirement.name not in found
            found[canonicalize_name(requirement.name)] = pin.version
    return found


def closure(machine: str, wanted: list[str]) -> Iterator[Requirement]:
    """Yield requirements, and what the packages installed here require in turn."""
    for text in wanted:
        requirement = Requirement(text)
        if requirement.marker is None or requirement.marker.evaluate(environment(machine)):
            yield requirement
            yield from closure(machine, metadata.requires(requirement.name) or [])


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_the_lock_satisfies_all_dependencies(machine: str) -> None:
    """Those of footsense and of its build in the versions asked for, and whatever they need in turn."""
    versions = pinned(machine)
    for requirement in map(Requirement, DIRECT):
        found = versions.get(canonicalize_name(requirement.name), "0")
        assert requirement.specifier.contains(found), f"{requirement}: `make lock` renews the lock"
    needed = {canonicalize_name(each.name) for each in closure(machine, PROJECT["project"]["dependencies"])}
    assert needed <= set(versions)


def test_every_package_has_hashes_and_none_is_built() -> None:
    """One version each, SHA-256 of its files, wheels alone, and no host to take them from."""
    assert ENTRIES[0] == ["--only-binary", ":all:"]
    for words in ENTRIES[1:]:
        hashes = [word for word in words if word.startswith("--")]
        assert hashes, words[0]
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", word) for word in hashes), words[0]
    assert "//" not in LOCK


def test_the_page_installs_nothing_without_a_hash() -> None:
    """Each `pip install` of the page takes the lock, or looks nowhere."""
    page = (ROOT / "deploy/README.md").read_text(encoding="utf-8")
    installs = re.findall(r"^/opt/footsense/bin/pip install (.*)$", page, re.MULTILINE)
    assert "--require-hashes -r requirements.lock" in installs
    for options in set(installs) - {"--require-hashes -r requirements.lock"}:
        assert {"--no-index", "--no-deps"} <= set(options.split())
