"""HTTP side of the page: its files, and which hosts and origins are answered."""

import ipaddress
import os
import socket
from collections.abc import Iterable, Mapping
from contextlib import suppress
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
from websockets.datastructures import Headers
from websockets.http11 import Response

from footsense.recording.fault_recordings import fault_recordings
from footsense.regular_file import open_regular

_CONTENT_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".json": "application/json",
    ".mcap": "application/octet-stream",
}

#: Path of the list of fault recordings; below it `/NAME/K` is the k-th part of one.
FAULTS_PATH = "/faults"
#: Bytes of a part: a whole recording would be cut off where the network is slow, and its memory is the robot's.
PART_BYTES = 1 << 16

#: The page loads nothing from elsewhere, and no other page may embed it.
_SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}


def page_files() -> dict[str, tuple[str, bytes]]:
    """Return content type and content of the files of the web page, by path."""
    found = {}
    for entry in files(__package__).joinpath("assets").iterdir():
        suffix = entry.name[entry.name.rfind(".") :]
        if entry.is_file() and suffix in _CONTENT_TYPES:
            found[f"/{entry.name}"] = (_CONTENT_TYPES[suffix], entry.read_bytes())
    return {**found, "/": found["/index.html"]}


def file_response(known: Mapping[str, tuple[str, bytes]], faults: Path, path: str) -> Response:
    """Return the HTTP response to a request for a path: the file of those known, a fault recording, or 404."""
    path = path.partition("?")[0]
    if path.startswith(FAULTS_PATH):
        return _fault_response(faults, path)
    if path not in known:
        return text_response(HTTPStatus.NOT_FOUND, "no such file; the page is /")
    return _response(HTTPStatus.OK, *known[path])


def _fault_response(folder: Path, path: str) -> Response:
    """Return the HTTP response to a request for the fault recordings in a folder: their list, or a part of one."""
    by_name = {recording.name: recording for recording in fault_recordings(folder)}
    _, _, *names = path.split("/")
    if not names:
        sizes = []
        for name, recording in by_name.items():
            with suppress(OSError):  # it has just been removed
                sizes.append({"name": name, "bytes": recording.stat().st_size})
        content = msgspec.json.encode({"part_bytes": PART_BYTES, "recordings": sizes})
        return _response(HTTPStatus.OK, _CONTENT_TYPES[".json"], content)
    name, part = names[0], names[-1]
    if len(names) == 2 and name in by_name and part.isascii() and part.isdecimal() and len(part) < 6:
        with suppress(OSError), os.fdopen(open_regular(by_name[name], os.O_NOFOLLOW), "rb") as file:
            file.seek(int(part) * PART_BYTES)
            return _response(HTTPStatus.OK, _CONTENT_TYPES[".mcap"], file.read(PART_BYTES))
    return text_response(HTTPStatus.NOT_FOUND, f"no such recording; {FAULTS_PATH} lists them")


def text_response(status: HTTPStatus, text: str) -> Response:
    """Return an HTTP response with one line of text."""
    return _response(status, _CONTENT_TYPES[".txt"], f"footsense view: {text}\n".encode())


def _response(status: HTTPStatus, content_type: str, content: bytes) -> Response:
    headers = Headers(_SECURITY_HEADERS)
    headers["Content-Type"] = content_type
    headers["Content-Length"] = str(len(content))
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, content)


def own_host_names() -> frozenset[str]:
    """Return the host names by which this computer may be addressed."""
    name = socket.gethostname().lower()
    return frozenset({"localhost", name, f"{name}.local", name.partition(".")[0] + ".local"})


def is_own_host(host: str | None, names: Iterable[str]) -> bool:
    """Return whether a Host header names this computer, by IP address or host name.

    Another name would be that of a web site whose owner points it at this address, to read the page with the scripts of
    the site (DNS rebinding).

    Example:
        >>> is_own_host("127.0.0.1:8765", []), is_own_host("[::1]", []), is_own_host("evil.example:8765", ["robot"])
        (True, True, False)
    """
    try:
        name = urlsplit(f"//{host or ''}").hostname or ""
    except ValueError:
        return False
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name in names
    return True


def is_allowed_origin(origin: str | None, host: str | None, allowed: Iterable[str] = ()) -> bool:
    """Return whether a web page of this origin may connect: own or allowed; clients without origin may.

    Args:
        origin: The Origin header.
        host: The Host header.
        allowed: Other origins.

    Example:
        >>> is_allowed_origin("http://127.0.0.1:8765", "127.0.0.1:8765")
        True
        >>> is_allowed_origin("https://evil.example", "127.0.0.1:8765")
        False
    """
    return origin is None or origin in allowed or origin in {f"http://{host}", f"https://{host}"}
