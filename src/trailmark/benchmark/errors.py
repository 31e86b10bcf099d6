"""Errors of a benchmark's input, and of the machinery that runs it."""

from __future__ import annotations

from trailmark.errors import TrailmarkError

__all__ = ["BenchmarkError", "StoreError", "SuiteError", "WorkerError"]


class BenchmarkError(TrailmarkError):
    """Base class of the benchmark's errors."""


class StoreError(BenchmarkError):
    """A results database that cannot be used: another schema, locked, damaged, of another machine."""


class SuiteError(BenchmarkError):
    """A suite, or a list of planners and worlds, that cannot be run."""


class WorkerError(BenchmarkError):
    """Workers that do not start, or a scheduler that does not answer."""
