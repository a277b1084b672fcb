"""How hypothesis searches: without a deadline, because the machine may be busy; in CI the same examples each time."""

import os

from hypothesis import settings

import footsense  # noqa: F401 - before any test imports numpy: it limits numpy's threads

settings.register_profile("dev", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "dev")
