"""What the live page draws under a path: roadmap, clearances, heuristic, and C-obstacle."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import ConfigurationError, expected_name
from trailmark.planning import LandmarkPlanner
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.roadmap import EdgeStatus
from trailmark.se2 import FloatArray

__all__ = ["LAYERS", "layer_data"]

MAX_NODES, MAX_EDGES = 5000, 20_000
"""Of a roadmap, that are sent: more would be a grey surface."""

MAX_CELLS = 40_000
"""Of a picture that is sent, about."""

LEVELS = 255
"""Of a cell's brightness; 0 stands for none."""

Layer = dict[str, Any]


def layer_data(planner: LandmarkPlanner, name: str, heading: float = 0.0, goal: FloatArray | None = None) -> Layer:
    """Return a layer: ``nodes`` and ``edges``, or ``cells`` of a picture.

    Cells are ``rows`` x ``columns`` bytes as base64, row 0 at the smallest y, ``size`` metres wide, from the corner
    ``origin`` on; the largest of the values that 1 to 255 stand for is ``most``, 0 is none.

    Args:
        planner: of the world that is shown.
        name: one of :data:`LAYERS`.
        heading: radians, of the C-obstacle.
        goal: shape (3,), to which costs are told; None if there is none yet.

    Raises:
        ConfigurationError: no such layer.
    """
    if name not in LAYERS:
        raise ConfigurationError(f"layer.name: {expected_name(name, LAYERS)}")
    return {"name": name, **LAYERS[name](planner, heading, goal)}


def _roadmap(planner: LandmarkPlanner, *_: Any) -> Layer:
    nodes, edges, _lengths, status = planner.roadmap.rows()
    count = min(len(nodes), MAX_NODES)
    shown = edges[(edges < count).all(axis=1) & (status == EdgeStatus.FREE)][:MAX_EDGES]
    return {"nodes": np.round(nodes[:count], 3).ravel().tolist(), "edges": shown.ravel().tolist()}


def _field(planner: LandmarkPlanner, *_: Any) -> Layer:
    field = planner.checker.field
    step = max(1, int(np.ceil(np.sqrt(field.distance.size / MAX_CELLS))))
    return _cells(field.distance[::step, ::step], (field.x0, field.y0), field.size * step)


def _lattice(planner: LandmarkPlanner, heading: float, goal: FloatArray | None) -> Layer:
    if goal is None:
        return {}
    costs = CostToGo.of(planner.checker, goal, MAX_CELLS // 2)
    reached = np.isfinite(costs.cost)
    return _cells(np.where(reached, np.maximum(costs.cost, 1e-3), 0.0), (costs.x0, costs.y0), costs.size)


def _obstacle(planner: LandmarkPlanner, heading: float, *_: Any) -> Layer:
    xmin, ymin, xmax, ymax = planner.world.bounds
    size = float(np.sqrt((xmax - xmin) * (ymax - ymin) / MAX_CELLS))
    columns, rows = int(np.ceil((xmax - xmin) / size)), int(np.ceil((ymax - ymin) / size))
    x, y = xmin + (np.arange(columns) + 0.5) * size, ymin + (np.arange(rows) + 0.5) * size
    states = np.column_stack([np.tile(x, rows), np.repeat(y, columns), np.full(rows * columns, heading)])
    hit = ~np.asarray(planner.checker.valid(states), dtype=bool).reshape(rows, columns)
    return _cells(hit.astype(float), (xmin, ymin), size)


LAYERS: Final[Mapping[str, Callable[..., Layer]]] = {
    "roadmap": _roadmap,
    "field": _field,
    "lattice": _lattice,
    "c-obstacle": _obstacle,
}
"""By the names that messages give."""


def _cells(values: NDArray[Any], origin: tuple[float, float], size: float) -> Layer:
    most = float(values.max(initial=0.0))
    grey = np.ceil(values * (LEVELS / most)).astype(np.uint8) if most > 0.0 else np.zeros(values.shape, np.uint8)
    return {
        "rows": values.shape[0],
        "columns": values.shape[1],
        "origin": [float(origin[0]), float(origin[1])],
        "size": float(size),
        "most": most,
        "cells": base64.b64encode(np.ascontiguousarray(grey).tobytes()).decode(),
    }
