from __future__ import annotations

import pytest

from trailmark.live.server import is_loopback, refusal


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST", "::1", "[::1]", "127.8.8.8"])
def test_loopback(host: str) -> None:
    assert is_loopback(host)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.0.2", "localhost.example.org", "127.0.0.1.example.org", ""])  # noqa: S104
def test_not_loopback(host: str) -> None:
    assert not is_loopback(host)


ORIGINS = {
    "its own page": ("127.0.0.1:8765", "http://127.0.0.1:8765", None),
    "a program": ("127.0.0.1:8765", None, None),
    "its own page by name": ("localhost:8765", "http://localhost:8765", None),
    "another page": ("127.0.0.1:8765", "http://evil.example", "expected a page of 127.0.0.1:8765"),
    "another port": ("127.0.0.1:8765", "http://127.0.0.1:8000", "expected a page of"),
    "a sandboxed page": ("127.0.0.1:8765", "null", "expected a page of"),
    "an origin that goes on": ("127.0.0.1:8765", "http://127.0.0.1:8765.evil.example", "expected a page of"),
    "a rebound name": ("evil.example:8765", "http://evil.example:8765", "loopback address"),
    "no host": ("", None, "Host header"),
}


@pytest.mark.parametrize("name", ORIGINS)
def test_origin_and_host(name: str) -> None:
    host, origin, problem = ORIGINS[name]
    headers = {"host": host} | ({} if origin is None else {"origin": origin})
    found = refusal(headers, None, None)
    assert (found is None) == (problem is None)
    assert problem is None or problem in str(found)


def test_the_token_has_to_be_known() -> None:
    headers = {"host": "robot.example:8765", "origin": "http://robot.example:8765"}
    assert refusal(headers, "a secret", "a secret") is None
    for given in (None, "", "a secre", "a secret ", "é"):
        assert "token" in str(refusal(headers, "a secret", given))
    assert "expected a page" in str(refusal(headers | {"origin": "http://evil.example"}, "a secret", "a secret"))
