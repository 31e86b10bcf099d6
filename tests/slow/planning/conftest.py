"""Kernels are made ready before the tests."""

from __future__ import annotations

from tests.helpers.kernels import ready

__all__ = ["ready"]
