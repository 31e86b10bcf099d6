"""Who may use the live page: browsers that show this page itself, and whoever knows the token."""

from __future__ import annotations

import ipaddress
import secrets
from collections.abc import Mapping
from urllib.parse import urlsplit

__all__ = ["is_loopback", "refusal"]


def is_loopback(host: str) -> bool:
    """Return whether a host is this machine alone."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def refusal(headers: Mapping[str, str], token: str | None, given: str | None) -> str | None:
    """Return why a request is refused; None if it is not.

    A page of another origin, to which a browser would hand what is told here, is refused by its Origin. A name that was
    made to lead to this machine (DNS rebinding) is refused where no token is asked for.

    Args:
        headers: of the request, names in small letters.
        token: that has to be known; None if none.
        given: the request's own.
    """
    host, origin = headers.get("host", ""), headers.get("origin")
    name = urlsplit(f"//{host}").hostname
    if name is None:
        return "expected a Host header"
    if token is None and not is_loopback(name):
        return f"expected this machine by its loopback address, got the host {name!r}"
    if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
        return f"expected a page of {host}, got one of {origin}"
    if token is not None and not secrets.compare_digest(token.encode(), (given or "").encode()):
        return "expected the token (?token=...)"
    return None
