"""Paths are judged as in the tests of planning."""

from tests.planning.conftest import judge

__all__ = ["judge"]
