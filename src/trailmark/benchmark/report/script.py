"""The page's script: files of ``explorer/`` one after the other, and the policy that lets this script alone run."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

import base64
import hashlib
from functools import cache
from pathlib import Path

__all__ = ["policy", "script"]

FILES = ("numbers", "charts", "figures", "controls")


@cache
def script() -> str:
    """Return the script; names in it are known to it alone."""
    folder = Path(__file__).with_name("explorer")
    parts = [folder.joinpath(f"{name}.js").read_text(encoding="utf-8") for name in FILES]
    return "(() => {\n'use strict';\n" + "\n".join(parts) + "})();\n"


def policy() -> str:
    """Return the content security policy: whatever a database holds, the page asks for nothing and runs this alone."""
    digest = base64.b64encode(hashlib.sha256(script().encode()).digest()).decode()
    return f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'"
