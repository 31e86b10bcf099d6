"""Small problems, and a worker that runs planners on them."""

from __future__ import annotations

from tests.helpers.runs import ahead, around, worker

__all__ = ["ahead", "around", "worker"]
