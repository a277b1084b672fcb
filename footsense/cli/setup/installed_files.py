"""Files in a system that `footsense install` has written: what they were then, and what differs now.

The list of them, `/etc/footsense/installed`, is one that sha256sum --check reads. While files are written it names the
old content of each beside the new one, so that an installation that was cut short goes on where it ended.
"""

import contextlib
import hashlib
import re
from collections import defaultdict
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path

from footsense.errors import FootsenseError

LIST = "/etc/footsense/installed"
_HEADER = "# Written by `footsense install`; sha256sum --check /etc/footsense/installed\n"
#: The line of a list that says that systemd-networkd was not enabled before.
_NETWORKD = "# systemd-networkd was enabled for can0\n"


class InstalledFiles:
    """The files of footsense in a system, by their paths there.

    Args:
        root: Root directory of the system.

    Attributes:
        enabled_networkd: Whether systemd-networkd is enabled only since the installation.
        paths: Files of the list.

    Raises:
        OSError: The list cannot be read.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        text = self._content(LIST).decode(errors="replace")
        self.enabled_networkd = _NETWORKD in text
        self._hashes: defaultdict[str, set[str]] = defaultdict(set)
        for digest, path in re.findall(r"^([0-9a-f]{64})  (/.+)$", text, re.MULTILINE):
            self._hashes[path].add(digest)
        self.paths = [*self._hashes]

    def check_unedited(self, files: Mapping[str, bytes]) -> None:
        """Check that nobody but footsense has written a file that is to be replaced or removed.

        Args:
            files: New content by path.

        Raises:
            FootsenseError: Somebody has; the line names all such files.
        """
        edited = []
        for path in {**files, **self._hashes}:
            content, new = self._content(path), files.get(path, b"")
            if content and content != new and _digest(content) not in self._hashes[path]:
                lines = zip_longest(content.decode(errors="replace").splitlines(), new.decode().splitlines())
                first = next((number for number, (old, now) in enumerate(lines, 1) if old != now), 1)
                edited.append(f"{path}:{first}" if new else path)
        if edited:
            raise FootsenseError(
                f"{', '.join(edited)}: edited by hand; keep your lines in a drop-in (`systemctl edit UNIT`; of can0 "
                "/etc/systemd/network/80-can0.network.d/my.conf), remove the file, and repeat this"
            )

    def differing(self, files: Mapping[str, bytes]) -> list[str]:
        """Return the paths whose content is another than this, or missing."""
        return [path for path, content in files.items() if self._content(path) != content]

    def list_text(self, files: Mapping[str, bytes], *, is_complete: bool) -> bytes:
        """Return the list of these files, and, while it is not complete, of what there was."""
        known = {(path, _digest(content)) for path, content in files.items()}
        if not is_complete:
            known |= {(path, digest) for path, digests in self._hashes.items() for digest in digests}
        lines = "".join(f"{digest}  {path}\n" for path, digest in sorted(known))
        return (_HEADER + _NETWORKD * self.enabled_networkd + lines).encode()

    def write(self, path: str, content: bytes) -> None:
        """Write a file, which has its old or its new content whatever happens.

        Raises:
            OSError: It cannot be written.
        """
        target = self._target(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        new = target.with_name(f".{target.name}.new")
        try:
            new.write_bytes(content)
            new.chmod(0o644)
            new.replace(target)
        except OSError:
            new.unlink(missing_ok=True)
            raise

    def remove(self, path: str) -> None:
        """Remove a file, and its folder if that is empty then and of footsense or a unit's."""
        target = self._target(path)
        target.unlink(missing_ok=True)
        if path == LIST or len(target.parent.suffixes) > 1:  # such as footsense.service.d, and not rules.d
            with contextlib.suppress(OSError):
                target.parent.rmdir()

    def _target(self, path: str) -> Path:
        return self._root / path.removeprefix("/")

    def _content(self, path: str) -> bytes:
        try:
            return self._target(path).read_bytes()
        except FileNotFoundError:
            return b""


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
