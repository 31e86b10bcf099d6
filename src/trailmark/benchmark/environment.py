"""What a result depends on besides the planner: versions, source code, processor."""

from __future__ import annotations

import hashlib
import os
import platform
import re
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

__all__ = ["cpu_name", "source_digest", "versions"]

PACKAGES = ("trailmark", "ompl", "python-fcl", "numpy", "scipy", "scikit-learn", "networkx", "numba", "shapely")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that do the work."""
    return {"Python": platform.python_version()} | {name: _version(name) for name in PACKAGES}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def cpu_name() -> str:
    """Return the processor's name and the number of cores."""
    info = Path("/proc/cpuinfo")
    text = info.read_text(encoding="utf-8", errors="replace") if info.exists() else ""
    named = re.search(r"^model name\s*: (.+)$", text, re.MULTILINE)
    return f"{named[1] if named else platform.processor() or platform.machine()}, {os.cpu_count()} cores"


@lru_cache(1)
def source_digest() -> str:
    """Return the SHA-256 of trailmark's own source files: it identifies the code where the version does not."""
    digest, root = hashlib.sha256(), Path(__file__).resolve().parents[1]
    for file in sorted(root.rglob("*.py")):
        digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
