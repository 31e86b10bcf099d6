"""An exploration as a page with a scrubber: one HTML file with everything in it, that asks for nothing else."""

from __future__ import annotations

import base64
import json
import zlib
from html import escape
from pathlib import Path as FilePath
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import OutputError
from trailmark.exploration.history import History
from trailmark.exploration.known_map import UNKNOWN
from trailmark.formats.files import write_atomically
from trailmark.plotting.canvas import picture_of
from trailmark.plotting.exploration import coarse
from trailmark.sketch import colours

if TYPE_CHECKING:
    from trailmark.exploration.result import ExplorationResult

__all__ = ["save_exploration_page"]

MAX_ROWS, MAX_CELLS = 4000, 500_000
"""Readings and cells that a page holds: of more readings evenly chosen ones, of more cells squares of them."""

NEVER = 65535
"""In place of a reading: the cell stayed unknown."""

ANGLE = 1e-4
"""Radians: unit of headings."""

STEPS = 2_000_000
"""Units of length along the map's longer side."""


def save_exploration_page(file: str | FilePath, result: ExplorationResult) -> None:
    """Write a page on which the exploration plays, or is gone through by hand.

    Cells are shown as they were at the end, from the time on at which they were known first.

    Raises:
        OutputError: another suffix than ``.html``, or a file that cannot be written.
    """
    target = picture_of(result.world, file)
    if target.suffix.lower() != ".html":
        raise OutputError(f"{file}: expected a file that ends in .html, got {target.suffix or 'no suffix'}")
    meta, data = _packed(result)
    # No text ends the element that it stands in.
    told = json.dumps(meta, separators=(",", ":")).replace("<", "\\u003c")
    parts = {
        "title": escape(f"Exploration of {result.world.name}"),
        "heading": escape(f"Exploration of {result.world.name}"),
        "facts": escape(_facts(result)),
        "meta": told,
        "data": base64.b64encode(zlib.compress(data, 9)).decode(),
        "script": (FilePath(__file__).with_suffix(".js")).read_text(encoding="utf-8"),
    }
    parts |= {name: getattr(colours, name) for name in ("MARGIN", "OBSTACLE", "PATH", "GOAL", "LANDMARK", "START")}
    template = FilePath(__file__).with_suffix(".html").read_text(encoding="utf-8")
    write_atomically(target, Template(template).substitute(parts))


def _packed(result: ExplorationResult) -> tuple[dict[str, Any], bytes]:
    """Return what the page is told as JSON, and its arrays one after the other, those of larger numbers first."""
    whole, known = History.of(result.history), result.known
    history = _thinned(whole)
    state, first, cell = coarse(known.state, result.first_known, known.cell, MAX_CELLS)
    figures, origin = history.figures, np.asarray(known.origin)
    unit = cell * max(state.shape) / STEPS
    reading = np.searchsorted(figures[:, 0].astype(np.float32), first)
    # What became known between two readings is shown from the later one on.
    never = (state == UNKNOWN) | (reading == len(figures))
    scales = {"clock": 1e-3, "distance": 1e-3, "area": 1e-2, "sigma": 1e-5}
    columns = {"clock": 0, "distance": 1, "area": 2, "sigma": 4}
    aimed = np.isfinite(history.targets[:, 0])
    arrays: dict[str, NDArray[Any]] = {
        "pose": np.column_stack([(figures[:, 5:7] - origin) / unit, figures[:, 7] / ANGLE]),
        "target": (np.where(aimed[:, None], history.targets[:, :2], origin) - origin) / unit,
        "path": (history.paths[:, :2] - origin) / unit,
        "places": (whole.landmarks()[:, :2] - origin) / unit,
        **{name: figures[:, column] / scales[name] for name, column in columns.items()},
        "landmarks": figures[:, 3],
        "span": history.spans,
    }
    packed = {name: np.rint(values).astype("<i4") for name, values in arrays.items()}
    packed["first"] = np.where(never, NEVER, reading).astype("<u2")
    packed |= {"state": state, "aimed": aimed.astype(np.uint8)}
    robot = result.world.robot
    meta = {
        "shape": list(state.shape),
        "cell": cell,
        "times": len(figures),
        "unit": unit,
        "angle": ANGLE,
        "scales": scales,
        "robot": [] if robot is None else np.round(robot.outline.vertices, 4).tolist(),
        "events": history.events,
        "arrays": [(name, values.dtype.name, values.size) for name, values in packed.items()],
    }
    return meta, b"".join(values.tobytes() for values in packed.values())


def _thinned(history: History) -> History:
    """Return at most MAX_ROWS rows of a history, the last one among them; what happened in between comes later."""
    n = len(history.figures)
    rows = np.unique(np.linspace(0, n - 1, min(n, MAX_ROWS)).astype(np.intp))
    used = np.zeros(len(history.paths) + 1, dtype=np.bool_)
    for begin, end in history.spans[rows].tolist():
        used[max(0, begin) : max(0, end)] = True
    # How many of the states before each are kept.
    before = np.append(0, np.cumsum(used))[:-1].astype(np.int32)
    return History(
        figures=history.figures[rows],
        targets=history.targets[rows],
        spans=np.where(history.spans[rows] < 0, -1, before[history.spans[rows]]),
        paths=history.paths[used[:-1]],
        events=tuple((int(np.searchsorted(rows, i)), text) for i, text in history.events),
    )


def _facts(result: ExplorationResult) -> str:
    """Return how it ended, with what only a simulator can say."""
    told = result.evaluation
    facts = f"{result.status}: {result.reason}. Strategy {result.strategy}, seed {result.seed}"
    if told is None:
        return f"{facts}."
    return f"{facts}; {told.seen:.1%} of what can be seen was seen, {told.collisions} collisions."
