"""What a result depends on besides the planner: versions, source code, processor, system."""

from __future__ import annotations

import hashlib
import os
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

__all__ = ["cpu_name", "source_digest", "system", "versions"]

PACKAGES = ("trailmark", "ompl", "python-fcl", "numpy", "scipy", "scikit-learn", "networkx", "numba", "shapely")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that do the work."""
    found = {"Python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found


def cpu_name() -> str:
    """Return the processor's name and the number of cores."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8", errors="replace").splitlines()
        names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        name = names[0] if names else name
    return f"{name}, {os.cpu_count()} cores"


def system() -> str:
    """Return the operating system and its kernel."""
    return platform.platform()


@lru_cache(1)
def source_digest() -> str:
    """Return the SHA-256 of trailmark's own source files: it identifies the code where the version does not."""
    digest, root = hashlib.sha256(), Path(__file__).resolve().parents[1]
    for file in sorted(root.rglob("*.py")):
        digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
