"""A server of the live page, in a process of its own."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def serving(*words: str) -> Iterator[str]:
    """Run ``trailmark live`` on a free port, and yield the address that it prints; Ctrl-C ends it."""
    command = [sys.executable, "-m", "trailmark.cli", "live", *words, "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            found = re.search(r"http://\S+", line)
            assert found is not None, (line, process.poll())
            yield found[0]
        finally:
            process.send_signal(signal.SIGINT)
            _, complaints = process.communicate(timeout=30.0)
    assert "Traceback" not in complaints
    assert process.returncode == 0


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Return where the office is shown."""
    with serving("office") as found:
        yield found
