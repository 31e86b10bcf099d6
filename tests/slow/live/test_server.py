from __future__ import annotations

import json
import socket
import time
import urllib.error
import urllib.request
from contextlib import ExitStack
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from trailmark.cli import main
from trailmark.live.messages import MAX_BYTES
from trailmark.live.server import MAX_CLIENTS, is_loopback, page_of, refusal

START, GOAL = [1.0, 1.0, 0.0], [17.0, 10.0, 1.57]


def socket_of(address: str, **options: Any) -> Any:
    """Return a connection to the address's WebSocket."""
    place, _, query = address.partition("?")
    return connect(place.replace("http", "ws") + "ws" + (f"?{query}" if query else ""), max_size=None, **options)


def answers(client: ClientConnection, identity: Any) -> list[dict[str, Any]]:
    """Return what comes until the final answer to a message, or one that is an error."""
    found = []
    while True:
        answer = json.loads(client.recv(timeout=90.0))
        if answer["id"] == identity:
            found.append(answer)
            if answer.get("final", True):
                return found


def ask(client: ClientConnection, **message: Any) -> list[dict[str, Any]]:
    client.send(json.dumps(message))
    return answers(client, message["id"])


def test_the_page_asks_for_nothing_else(address: str) -> None:
    with urllib.request.urlopen(address, timeout=10.0) as answer:  # noqa: S310  # our own
        page, headers = answer.read().decode(), answer.headers
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "unsafe-eval" not in headers["Content-Security-Policy"]
    assert len(page) < 300_000
    assert "src=" not in page.replace("default-src=", "")
    assert "https://" not in page
    assert page == page_of("office")[0]
    for path in ("ws", "static/../page.js", "etc/passwd"):
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(address + path, timeout=10.0)  # noqa: S310


def test_messages_are_answered_and_bad_ones_refused_on_one_connection(address: str) -> None:
    with socket_of(address) as client, socket_of(address) as other:
        (hello,) = ask(client, type="hello", id=1)
        assert hello["world"]["name"] == "office"
        ask(other, type="edit", id=1, remove=[0, 1, 2])  # clients do not see each other
        assert ask(client, type="hello", id=1) == [hello]
        path = ask(client, type="plan", id=2, start=START, goal=GOAL, time_limit=0.5)
        assert path[-1]["status"] == "solved"
        for bad in ("{", "[]", '{"type": "fly"}', "x" * (MAX_BYTES + 1), b"{}"):
            client.send(bad)
            answer = json.loads(client.recv(timeout=10.0))
            assert (answer["type"], answer["id"]) == ("error", None)
        (error,) = ask(client, type="plan", id=3, start=[-5.0, 0.0, 0.0], goal=GOAL)
        assert error["type"] == "error"
        assert "left bound" in error["message"]
        (error,) = ask(client, type="plan", id="4", start=[1.0, 1.0], goal=GOAL)
        assert error["message"].startswith("plan: start: ")
        assert ask(client, type="edit", id=5, remove=["o3"])[0]["type"] == "world"
        assert ask(client, type="plan", id=6, start=START, goal=GOAL, time_limit=0.2)[-1]["final"]


def test_a_newer_plan_or_edit_ends_the_older(address: str) -> None:
    with socket_of(address) as client:
        for i in range(20):  # they ask for ten minutes, and recv fails after half of one
            client.send(json.dumps({"type": "plan", "id": i, "start": START, "goal": GOAL, "time_limit": 30.0}))
        client.send(json.dumps({"type": "edit", "id": "edit", "remove": ["o5"]}))
        told = [json.loads(client.recv(timeout=30.0))]
        while told[-1]["id"] != "edit":
            told.append(json.loads(client.recv(timeout=30.0)))
        assert told[-1]["obstacles"] > 10
        assert sorted(answer["id"] for answer in told[:-1] if answer["final"]) == list(range(20))
        assert ask(client, type="plan", id="last", start=START, goal=GOAL, time_limit=0.3)[-1]["status"] == "solved"


def test_there_is_a_most_of_messages_and_of_clients(address: str) -> None:
    with socket_of(address) as client:
        for i in range(1000):
            client.send(json.dumps({"type": "stop", "id": i}))
        assert "messages a second" in json.loads(client.recv(timeout=10.0))["message"]
        time.sleep(0.5)
        assert ask(client, type="plan", id="after", start=START, goal=GOAL, time_limit=0.2)
    codes = []
    with ExitStack() as open_ones:
        for _ in range(20):
            client = open_ones.enter_context(socket_of(address))
            try:
                client.send(json.dumps({"type": "hello", "id": 1}))
                client.recv(timeout=10.0)
            except ConnectionClosed as closed:
                codes.append(closed.rcvd and closed.rcvd.code)
    assert codes in ([1013] * 4, [1013] * 5)  # one that has just gone may still count


def test_pages_of_others_are_refused(address: str) -> None:
    for origin in ("http://evil.example", "null", address.replace("http", "https").rstrip("/")[:-1]):
        with pytest.raises(InvalidStatus) as refused:
            socket_of(address, additional_headers={"Origin": origin})
        assert refused.value.response.status_code == 403
    with socket_of(address, additional_headers={"Origin": address.rstrip("/")}) as client:
        assert ask(client, type="hello", id=1)
    request = urllib.request.Request(address, headers={"Host": "evil.example"})  # noqa: S310
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(request, timeout=10.0)  # noqa: S310


def test_a_token_is_asked_for(guarded: str) -> None:
    assert guarded.endswith("?token=a%20secret%20word")
    with socket_of(guarded) as client:
        assert ask(client, type="hello", id=1)
    for other in (guarded.partition("?")[0], guarded + "s"):
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(other, timeout=10.0)  # noqa: S310
        with pytest.raises(InvalidStatus):
            socket_of(other)


def test_bad_options_are_told_in_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        bad = {
            "taken": (["office", "--port", port], "expected an address that is free"),
            "open to all": (["office", "--host", "0.0.0.0"], "--host: expected a loopback address, or --token"),  # noqa: S104
            "no port": (["office", "--port", "http"], "--port: expected an integer from 0 to 65535, got 'http'"),
            "short token": (["office", "--token", "abc"], "--token: expected 8 to 200"),
            "no world": (["nowhere"], "nowhere"),
            "no host": (["office", "--host", "no.such.host.invalid", "--token", "12345678"], "expected an address"),
        }
        for words, problem in bad.values():
            assert main(["live", *words, "--no-browser"]) == 2
            assert problem in capsys.readouterr().err


def test_one_who_leaves_ends_what_was_under_way(address: str) -> None:
    for identity in range(MAX_CLIENTS + 1):  # the last would be too many, if one of the others were still there
        with socket_of(address) as client:
            client.send(json.dumps({"type": "plan", "id": identity, "start": START, "goal": GOAL, "time_limit": 60.0}))
            client.recv(timeout=10.0)
    with socket_of(address) as client:
        assert ask(client, type="plan", id=1, start=START, goal=GOAL, time_limit=0.2)


@pytest.mark.parametrize(
    ("hosts", "wanted"),
    [
        (["127.0.0.1", "localhost", "LOCALHOST", "::1", "[::1]", "127.8.8.8"], True),
        (["0.0.0.0", "::", "192.168.0.2", "localhost.example.org", "127.0.0.1.example.org", ""], False),  # noqa: S104
    ],
)
def test_loopback(hosts: list[str], wanted: bool) -> None:
    assert [is_loopback(host) for host in hosts] == [wanted] * 6


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
