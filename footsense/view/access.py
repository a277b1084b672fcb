"""Access rules of the page's server: Host names, origins, number of connections."""

import ipaddress
import socket
from collections.abc import Iterable
from urllib.parse import urlsplit

#: Origins of Foxglove's and Lichtblick's own pages and desktop applications, which may read by Foxglove's protocol.
FOXGLOVE_ORIGINS = frozenset(
    {"https://app.foxglove.dev", "https://studio.foxglove.dev", "http://localhost:8080", "file://"}
)

#: Connections at most: pages and Foxglove clients together.
MAX_CLIENTS = 16


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
