"""Two lock files hold all that a robot, or a developer, installs: with hashes, for each computer and Python."""

import re
import tomllib
from functools import cache
from itertools import product
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import footsense

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
GROUPS = PROJECT["dependency-groups"]
CLIENT = tomllib.loads((ROOT / "deploy/client/pyproject.toml").read_text(encoding="utf-8"))["project"]
OURS = f"footsense-client=={footsense.__version__}"
ROBOT = [*PROJECT["project"]["dependencies"], *CLIENT["dependencies"], *GROUPS["build"]]
DIRECT = {
    "deploy": ROBOT,
    "tests": [*ROBOT, *PROJECT["project"]["optional-dependencies"]["lab"], *GROUPS["dev"], *GROUPS["docs"]],
}
ENVIRONMENTS = [
    {"platform_machine": machine, "python_version": version, "python_full_version": f"{version}.2"}
    for machine, version in product(("x86_64", "aarch64"), ("3.11", "3.12", "3.13"))
]


def entries(lock: str) -> list[list[str]]:
    text = re.sub(r"#.*", "", (ROOT / lock / "requirements.lock").read_text(encoding="utf-8"))
    return [line.split() for line in text.replace("\\\n", " ").splitlines() if line.strip()]


@cache
def requirements(lock: str) -> list[Requirement]:
    return [
        Requirement(" ".join(word for word in words if not word.startswith("--hash=")))
        for words in entries(lock)[1:]
    ]


def applies(requirement: Requirement, environment: dict[str, str]) -> bool:
    return requirement.marker is None or requirement.marker.evaluate(environment)


def pinned(lock: str, environment: dict[str, str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for requirement in requirements(lock):
        if applies(requirement, environment):
            (pin,) = requirement.specifier
            assert pin.operator == "=="
            assert requirement.name not in found
            found[canonicalize_name(requirement.name)] = pin.version
    return found


@pytest.mark.parametrize("environment", ENVIRONMENTS, ids=lambda each: "-".join(each.values()))
def test_the_locks_satisfy_what_the_project_asks_for(environment: dict[str, str]) -> None:
    """Each package in a version that is asked for; a developer runs the same versions as a robot."""
    for lock, direct in DIRECT.items():
        versions = pinned(lock, environment)
        for requirement in (Requirement(text) for text in direct if isinstance(text, str) and text != OURS):
            if applies(requirement, environment):
                found = versions.get(canonicalize_name(requirement.name), "0")
                assert requirement.specifier.contains(found), f"{requirement}: `make lock` renews the lock"
    assert pinned("deploy", environment).items() <= pinned("tests", environment).items()


@pytest.mark.parametrize("lock", DIRECT)
def test_every_package_has_hashes_and_none_is_built(lock: str) -> None:
    """SHA-256 of its files, wheels alone, and no host to take them from."""
    options, *packages = entries(lock)
    assert options == ["--only-binary", ":all:"]
    for words in packages:
        hashes = [word for word in words if word.startswith("--")]
        assert hashes, words[0]
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", word) for word in hashes), words[0]
    assert "//" not in (ROOT / lock / "requirements.lock").read_text(encoding="utf-8")


def test_the_page_installs_nothing_without_a_hash() -> None:
    """Each `pip install` of the page takes the lock, or looks nowhere."""
    page = (ROOT / "deploy/README.md").read_text(encoding="utf-8")
    installs = re.findall(r"^/opt/footsense/bin/pip install (.*)$", page, re.MULTILINE)
    assert "--require-hashes -r requirements.lock" in installs
    for options in set(installs) - {"--require-hashes -r requirements.lock"}:
        assert {"--no-index", "--no-deps"} <= set(options.split())
