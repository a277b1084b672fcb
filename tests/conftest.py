"""How hypothesis searches: without a deadline, because the machine may be busy, and with the same examples each time.

A change is judged by what it changes; `pytest --hypothesis-profile random` tries other examples.
"""

from hypothesis import settings

import footsense  # noqa: F401 - before any test imports numpy: it limits numpy's threads

settings.register_profile("same", deadline=None, derandomize=True)
settings.register_profile("random", deadline=None)
settings.load_profile("same")
