"""Edits of a world's obstacles, as a caller states them, to the changes that they are."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import replace as replaced
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief, each_of, number_array, one_of
from trailmark.changes import Change, Changes, Obstacles
from trailmark.errors import WorldError, expected_name
from trailmark.estimates import ObstacleEstimate
from trailmark.lazy_shapes import LazyShapes
from trailmark.moving import Moving
from trailmark.shapes import Disc, Polygon, Rectangle, Shape, displaced, shape_of, shapes_of

__all__ = ["KINDS", "Obstacle", "changes_of_edits", "index_of", "obstacles_of", "require_id"]

Obstacle = Shape | Moving | ObstacleEstimate
"""What a world may be given as an obstacle."""

KINDS = (Disc, Rectangle, Polygon, Moving, ObstacleEstimate)


class _Entry(NamedTuple):
    """An obstacle as a world holds it."""

    shape: Shape
    estimate: ObstacleEstimate | None = None
    moving: Moving | None = None


def changes_of_edits(
    obstacles: Obstacles,
    add: Iterable[Obstacle] | Mapping[str, Obstacle],
    remove: Iterable[str | int],
    move: Mapping[str | int, ArrayLike],
    replace: Mapping[str | int, Obstacle],
    grown: bool,
) -> Changes:
    """Return the changes that edits make of some obstacles.

    Args:
        obstacles: what there is.
        add: new obstacles, in their order; with their ids if a mapping.
        remove: ids or indices.
        move: for ids or indices: dx, dy and, if turned, dtheta; metres and radians.
        replace: for ids or indices: the new obstacles.
        grown: whether obstacles with estimates are grown for a risk, which an estimate that is new here is not.

    Raises:
        WorldError: an unknown or duplicate identity, an obstacle that is edited twice, or a value that is none.
    """
    edits: dict[int, _Entry | None] = {}
    done: dict[int, str] = {}

    places = {name: place for place, name in enumerate(obstacles.ids) if name is not None}

    def place_of(name: object, verb: str) -> int:
        place = places.get(name) if isinstance(name, str) else None
        if place is None:
            place = index_of(obstacles, name, f"edited: {verb}")
        if place in done:
            raise WorldError(
                f"edited: expected each obstacle in one edit, got {brief(name)} in {done[place]} and {verb}"
            )
        done[place] = verb
        return place

    for name in each_of(remove, object, "edited: remove", error=WorldError):
        edits[place_of(name, "remove")] = None
    for name, by in _mapping(move, "move").items():
        place = place_of(name, "move")
        edits[place] = _moved(obstacles, place, by, f"edited: move[{brief(name)}]", grown)
    for name, obstacle in _mapping(replace, "replace").items():
        place = place_of(name, "replace")
        edits[place] = _entry(obstacle, f"edited: replace[{brief(name)}]", grown)

    lost = sorted(place for place, entry in edits.items() if entry is None)
    items = []
    for place, entry in sorted(edits.items()):
        name = obstacles.ids[place] if obstacles.ids else None
        after = None if entry is None else place - bisect_left(lost, place)
        items.append(
            Change(name, obstacles.shapes[place], entry and entry.shape, place, after, *(entry or (None,))[1:])
        )
    named = isinstance(add, Mapping)
    new: Iterable[tuple[Any, Any]] = (
        add.items() if isinstance(add, Mapping) else enumerate(each_of(add, object, "edited: add", error=WorldError))
    )
    for k, (name, obstacle) in enumerate(new, start=len(obstacles.shapes) - len(lost)):
        entry = _entry(obstacle, f"edited: add[{brief(name)}]", grown)
        items.append(
            Change(require_id(name, "edited: add:") if named else None, None, entry.shape, None, k, *entry[1:])
        )
    return Changes(tuple(items))


def obstacles_of(shapes: Iterable[Any], ids: Any, estimates: Any, moving: Any) -> Obstacles:
    """Return the obstacles that a world is given, checked; those that move become the regions that they sweep.

    Args:
        shapes: shapes, geometries of shapely and :class:`Moving`.
        ids: one for each obstacle, None where it has none; or empty.
        estimates: likewise.
        moving: likewise; empty where obstacles are given as :class:`Moving`.

    Raises:
        ShapeError: a geometry that bounds no region.
        WorldError: what :class:`trailmark.World` says.
    """
    if isinstance(shapes, LazyShapes) and not (ids or estimates or moving):
        return Obstacles(shapes.as_tuple())
    placed: tuple[Any, ...] = each_of(shapes, object, "obstacles", error=WorldError)
    if any(type(part).__module__.startswith("shapely") for part in placed):
        placed = tuple(shape for i, part in enumerate(placed) for shape in shapes_of(part, f"obstacles[{i}]"))
    each_of(placed, (Disc, Rectangle, Polygon, Moving), "obstacles", error=WorldError)
    kinds = {"ids": str, "estimates": ObstacleEstimate, "moving": Moving}
    columns: dict[str, tuple[Any, ...]] = {}
    for (name, kind), given in zip(kinds.items(), (ids, estimates, moving), strict=True):
        column: tuple[Any, ...] = each_of(given, (kind, type(None)), name, error=WorldError)
        if column and len(column) != len(placed):
            raise WorldError(f"{name}: expected one for each of {len(placed)} obstacles, or none, got {len(column)}")
        columns[name] = column if any(value is not None for value in column) else ()
    among = tuple(shape if isinstance(shape, Moving) else None for shape in placed)
    if any(among):
        if columns["moving"]:
            raise WorldError("moving: expected moving obstacles either among the obstacles or beside them, got both")
        columns["moving"] = among
        placed = tuple(shape.swept if isinstance(shape, Moving) else shape for shape in placed)
    names = [require_id(name, "ids:") for name in columns["ids"] if name is not None]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise WorldError(f"ids: expected each id once, got {twice!r} more than once")
    for i, motion in enumerate(columns["moving"]):
        if motion is not None and columns["estimates"] and columns["estimates"][i] is not None:
            raise WorldError(f"obstacles[{i}]: expected an estimate or a motion, got both")
        if motion is not None and placed[i] is not motion.swept and placed[i] != motion.swept:
            raise WorldError(f"moving[{i}]: expected the region that it sweeps in its place, got {placed[i]}")
    return Obstacles(placed, **columns)


def require_id(value: object, name: str) -> str:
    """Return an obstacle's id: a text that is not empty, nor what audits call the world's edges."""
    if isinstance(value, str) and value not in ("", "bounds", "boundary"):
        return value
    raise WorldError(f"{name} expected ids that are texts, not empty, not bounds or boundary, got {brief(value)}")


def index_of(obstacles: Obstacles, name: object, verb: str) -> int:
    """Return the index of an obstacle that is named by its id or by its index.

    Raises:
        WorldError: there is none; ``verb`` says in the message what was to be done with it.
    """
    count = len(obstacles.shapes)
    if isinstance(name, str):
        if name in obstacles.ids:
            return obstacles.ids.index(name)
        known = [known for known in obstacles.ids if known is not None]
        problem = (
            expected_name(name, known[:50]) if known else f"expected an index, for no obstacle has an id, got {name!r}"
        )
        raise WorldError(f"{verb}: {problem}")
    if isinstance(name, int | np.integer) and not isinstance(name, bool) and 0 <= name < count:
        return int(name)
    allowed = f"an id or an index from 0 to {count - 1}" if count else "nothing, for there are no obstacles"
    raise WorldError(f"{verb}: expected {allowed}, got {brief(name)}")


def _mapping(value: Any, verb: str) -> Mapping[Any, Any]:
    if isinstance(value, Mapping):
        return value
    raise WorldError(f"edited: {verb}: expected a mapping of ids or indices, got {brief(value)}")


def _entry(obstacle: Any, where: str, grown: bool) -> _Entry:
    """Return a new obstacle as a world holds it."""
    obstacle = shape_of(obstacle, where)
    one_of(obstacle, KINDS, where, error=WorldError)
    if grown and isinstance(obstacle, ObstacleEstimate):
        raise WorldError(
            f"{where}: expected a shape, for this world's obstacles are grown for a risk, got an estimate; "
            "trailmark.estimation.refined takes estimates"
        )
    if isinstance(obstacle, ObstacleEstimate):
        return _Entry(obstacle.mean, obstacle)
    return _Entry(obstacle.swept, moving=obstacle) if isinstance(obstacle, Moving) else _Entry(obstacle)


def _moved(obstacles: Obstacles, place: int, by: ArrayLike, where: str, grown: bool) -> _Entry:
    """Return the obstacle at an index, displaced."""
    step = number_array(by, where, "expected dx, dy or dx, dy, dtheta, got {}", error=WorldError)
    if step.shape not in ((2,), (3,)) or not np.isfinite(step).all():
        raise WorldError(f"{where}: expected two or three finite numbers dx, dy, dtheta, got {brief(by)}")
    dx, dy, dtheta = (*step.tolist(), 0.0)[:3]
    estimate = obstacles.estimates[place] if obstacles.estimates else None
    moving = obstacles.moving[place] if obstacles.moving else None
    if moving is not None:
        moving = moving.displaced(dx, dy, dtheta)
        return _Entry(moving.swept, moving=moving)
    if estimate is not None and isinstance(estimate.mean, Disc):
        dtheta = 0.0  # what it was grown to may be no disc
    shape = displaced(obstacles.shapes[place], dx, dy, dtheta)
    if estimate is None:
        return _Entry(shape)
    if grown and dtheta:
        allowed = "expected dx, dy, for an obstacle that is grown for a risk is not turned"
        raise WorldError(f"{where}: {allowed}, got {brief(by)}")
    return _Entry(shape, replaced(estimate, mean=displaced(estimate.mean, dx, dy, dtheta)))
