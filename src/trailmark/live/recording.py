"""An exploration that was kept, as the live page steps through it; and a step of one that is under way."""

from __future__ import annotations

import base64
import json
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError
from trailmark.exploration.exploration_folder import load_exploration
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.exploration.result import ExplorationProgress
from trailmark.formats.files import read_text
from trailmark.formats.nav2_map import occupancy, pixels_of
from trailmark.formats.schema import MapFile
from trailmark.formats.validation import validate
from trailmark.formats.yaml_data import parse_yaml

__all__ = ["is_exploration", "recording_of", "step_data"]

MAX_STEPS: Final = 2000
"""Of a longer exploration, evenly chosen readings are shown."""

Data = dict[str, Any]


def is_exploration(path: str) -> bool:
    """Return whether ``trailmark explore`` has written this folder."""
    return (FilePath(path) / "resume.npz").is_file()


def recording_of(folder: str) -> Data:
    """Return a kept exploration: ``grid``, ``steps`` as :func:`step_data` gives them, ``status`` and ``reason``.

    Cells are shown as they were at the end, from the time on at which they were known first.

    Raises:
        FormatError: its files are missing, damaged, or do not belong together.
    """
    path = FilePath(folder)
    saved = load_exploration(path)
    file = _map_file(path / "map.yaml")
    told = pixels_of(path / file.image, lambda pixels: occupancy(pixels, file))[::-1]
    if told.shape != saved.first_known.shape:
        raise FormatError(path / file.image, f"expected {saved.first_known.shape} cells, got {told.shape}")
    try:
        summary = json.loads((path / "summary.json").read_text(encoding="utf-8"))
        status, reason = str(summary["status"]), str(summary["reason"])
    except (OSError, ValueError, KeyError, TypeError):
        # It was interrupted before that was written.
        status, reason = "interrupted", "the folder holds no summary"
    state = np.select([told < 0, told > 0], [UNKNOWN, OCCUPIED], FREE).astype(np.uint8).ravel()
    last = len(saved.history) - 1
    rows = np.unique(np.linspace(0, last, min(last + 1, MAX_STEPS)).astype(np.intp))
    times = np.array([saved.history[row].time for row in rows], dtype=np.float32)
    # What became known between two readings is shown from the later one on.
    begins = np.searchsorted(times, saved.first_known.ravel())
    begins[state == UNKNOWN] = len(rows)
    order = np.argsort(begins, kind="stable")
    parts = np.split(order, np.searchsorted(begins[order], np.arange(1, len(rows) + 1)))
    return {
        "grid": {
            "rows": told.shape[0],
            "columns": told.shape[1],
            "size": file.resolution,
            "origin": list(file.origin[:2]),
        },
        "steps": [step_data(saved.history[row], at, state[at]) for row, at in zip(rows, parts, strict=False)],
        "status": status,
        "reason": reason,
    }


def step_data(progress: ExplorationProgress, at: NDArray[Any], cells: NDArray[np.uint8]) -> Data:
    """Return how far an exploration has come, and cells that are told anew.

    ``at`` are indices row * columns + column, ``cells`` are 1 free, 2 occupied; both as base64, 32 and 8 bits each.
    """
    return {
        "pose": np.round(progress.pose, 4).tolist(),
        "path": [] if progress.path is None else np.round(progress.path, 3).tolist(),
        "target": None if progress.target is None else np.round(progress.target, 3).tolist(),
        "time": progress.time,
        "distance": progress.distance,
        "area": progress.area,
        "landmarks": progress.landmarks,
        "sigma": progress.sigma,
        "event": progress.event,
        "at": base64.b64encode(at.astype("<i4").tobytes()).decode(),
        "cells": base64.b64encode(cells.tobytes()).decode(),
    }


def _map_file(path: FilePath) -> MapFile:
    data = parse_yaml(read_text(path), path)
    if not isinstance(data, dict):
        raise FormatError(path, "expected a nav2 map file")
    return validate(MapFile, data, path)
