"""Debian's chromium without a window, for tests that look at a page."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import pytest
from tests.helpers.chromium import OPTIONS, program

__all__ = ["browse", "require_chromium"]


def require_chromium() -> str:
    """Return the program, or skip the test."""
    found = program()
    if found is None:
        pytest.skip("Debian's chromium is not installed")
    return found


def browse(page: Path, *options: str, width: int = 1280, height: int = 900) -> subprocess.CompletedProcess[str]:
    """Open a page with a profile that nobody has used, and wait until the browser is done with it."""
    program = require_chromium()
    # Chromium's helpers may write into the profile while it goes.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = [
            program,
            *OPTIONS,
            f"--user-data-dir={profile}",
            f"--window-size={width},{height}",
            *options,
            page.as_uri(),
        ]
        return subprocess.run(words, capture_output=True, text=True, check=True, timeout=120)
