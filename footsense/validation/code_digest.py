"""Hash of source code, by which cached results are discarded when the code changes."""

import hashlib
from pathlib import Path
from types import ModuleType


def code_digest(*packages: ModuleType) -> str:
    """Return a hash of all source files of some packages, 12 hexadecimal digits."""
    folders = [Path(str(room.__file__)).parent for room in packages]
    files = sorted(file for folder in folders for file in folder.rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]
