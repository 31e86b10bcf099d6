"""Servers of the live page, each in a process of its own, and a browser, for all tests of this process."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from tests.helpers.chromium import Browser, browser, program


@contextmanager
def serving(*words: str) -> Iterator[str]:
    """Run ``trailmark live`` on a free port, and yield the address that it prints; Ctrl-C ends it."""
    command = [sys.executable, "-m", "trailmark.cli", "live", *words, "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            line = process.stdout.readline()
            found = re.search(r"http://\S+", line)
            assert found is not None, (line, process.poll())
            yield found[0]
        finally:
            process.send_signal(signal.SIGINT)
            _, complaints = process.communicate(timeout=30.0)
    assert "Traceback" not in complaints
    assert process.returncode == 0


@pytest.fixture(scope="session")
def address() -> Iterator[str]:
    """Return where the office is shown."""
    with serving("office") as found:
        yield found


@pytest.fixture(scope="session")
def guarded() -> Iterator[str]:
    """Return where the office is shown to those who know the token."""
    with serving("office", "--token", "a secret word", "--host", "127.0.0.1") as found:
        yield found


@pytest.fixture(scope="session")
def tab() -> Iterator[Browser]:
    """Return a browser."""
    if program() is None:
        pytest.skip("Debian's chromium is not installed")
    with browser() as found:
        yield found
