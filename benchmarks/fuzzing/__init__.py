"""Damaged files: what readers make of them. ``python -m benchmarks.fuzz``."""
