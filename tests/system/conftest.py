"""Whole robots and processes take seconds a test: a change waits for those of a walk alone; the others are `slow`."""

from pathlib import Path

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of this folder, but for `test_walk.py`, as slow."""
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent) and item.path.name != "test_walk.py":
            item.add_marker(pytest.mark.slow)
