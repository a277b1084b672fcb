"""Static files of the web page, and the HTTP responses that serve them."""

import json
from http import HTTPStatus
from importlib.resources import files

from websockets.datastructures import Headers
from websockets.http11 import Response

_CONTENT_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}

#: The page loads nothing from elsewhere, and no other page may embed it.
_SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


class PageFiles:
    """Static files of the web page, by path."""

    def __init__(self) -> None:
        self._files: dict[str, tuple[str, bytes]] = {}
        for entry in files(__package__).joinpath("assets").iterdir():
            suffix = entry.name[entry.name.rfind(".") :]
            if entry.is_file() and suffix in _CONTENT_TYPES:
                self._files[f"/{entry.name}"] = (_CONTENT_TYPES[suffix], entry.read_bytes())
        self._files["/"] = self._files["/index.html"]

    def response(self, path: str) -> Response:
        """Return the HTTP response to a request for a path: the file, or 404."""
        path = path.partition("?")[0]
        if path not in self._files:
            return text_response(HTTPStatus.NOT_FOUND, "footsense view: no such file; the page is /")
        content_type, content = self._files[path]
        return _response(HTTPStatus.OK, content_type, content)


def text_response(status: HTTPStatus, text: str) -> Response:
    """Return an HTTP response with one line of text."""
    return _response(status, _CONTENT_TYPES[".txt"], f"{text}\n".encode())


def json_response(values: object) -> Response:
    """Return an HTTP response with a JSON value."""
    return _response(HTTPStatus.OK, "application/json", json.dumps(values).encode())


def _response(status: HTTPStatus, content_type: str, content: bytes) -> Response:
    headers = Headers(_SECURITY_HEADERS)
    headers["Content-Type"] = content_type
    headers["Content-Length"] = str(len(content))
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, content)
