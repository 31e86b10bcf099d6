"""Damaged files for a reader in a worker's process, which alone makes the right ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.fuzzing.attack import Finding, attack, available

__all__ = ["attack_if_available"]


def attack_if_available(task: dict[str, Any], asking: Path) -> tuple[int, int, list[Finding]] | None:
    """Return what came of an attack, or None if the reader's files are not there."""
    return attack(task, asking) if available(task["target"]) else None
