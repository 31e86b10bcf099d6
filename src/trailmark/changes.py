"""Changes between two worlds: obstacles that came, went, moved or became better known; and edits that make them."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from dataclasses import replace as replaced
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief, each_of, number_array, one_of
from trailmark.errors import WorldError, expected_name
from trailmark.estimates import ObstacleEstimate
from trailmark.moving import Moving
from trailmark.shapes import Disc, LazyShapes, Polygon, Rectangle, Shape, displaced, shape_of, shapes_of

__all__ = ["Change", "Changes", "Obstacle", "Obstacles", "apply", "changes_of_edits", "difference", "index_of"]

Obstacle = Shape | Moving | ObstacleEstimate
"""What a world may be given as an obstacle."""

Row = tuple[Any, str | None, ObstacleEstimate | None, Moving | None]
"""What a world says of an obstacle: the shape, the id, how well it is known and how it moves."""

SHAPES = (Disc, Rectangle, Polygon)


class Obstacles(NamedTuple):
    """A world's obstacles, as parallel tuples; the last three are empty if they say nothing of any obstacle."""

    shapes: tuple[Shape, ...] = ()
    ids: tuple[str | None, ...] = ()
    estimates: tuple[ObstacleEstimate | None, ...] = ()
    moving: tuple[Moving | None, ...] = ()

    def rows(self) -> list[Row]:
        """Return what is said of each obstacle."""
        return list(zip(self.shapes, *(column or repeat(None) for column in self[1:]), strict=False))

    def row(self, i: int) -> Row:
        """Return what is said of one obstacle."""
        ids, estimates, moving = (column[i] if column else None for column in self[1:])
        return self.shapes[i], ids, estimates, moving  # type: ignore[return-value]  # the columns' own kinds

    def require_unique_ids(self) -> Obstacles:
        """Return the same, or raise a WorldError if two have the same id."""
        names = [name for name in self.ids if name is not None]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise WorldError(f"ids: expected each id once, got {twice!r} more than once")
        return self

    @classmethod
    def checked(cls, shapes: Iterable[Any], ids: Any, estimates: Any, moving: Any) -> Obstacles:
        """Return the obstacles that a world is given; those that move become the regions that they sweep.

        Raises:
            ShapeError: a geometry that bounds no region.
            WorldError: what :class:`trailmark.World` says.
        """
        if isinstance(shapes, LazyShapes) and not (ids or estimates or moving):
            return cls(shapes.as_tuple())
        placed: tuple[Any, ...] = each_of(shapes, object, "obstacles", error=WorldError)
        if not all(isinstance(part, (*SHAPES, Moving)) for part in placed):
            placed = tuple(shape for i, part in enumerate(placed) for shape in shapes_of(part, f"obstacles[{i}]"))
            each_of(placed, (*SHAPES, Moving), "obstacles", error=WorldError)
        columns = {"ids": (ids, str), "estimates": (estimates, ObstacleEstimate), "moving": (moving, Moving)}
        checked: list[tuple[Any, ...]] = []
        for name, (values, kind) in columns.items():
            column = each_of(values, (kind, type(None)), name, error=WorldError)
            if column and len(column) != len(placed):
                raise WorldError(
                    f"{name}: expected one for each of {len(placed)} obstacles, or none, got {len(column)}"
                )
            checked.append(column if any(value is not None for value in column) else ())
        if not any(checked) and not any(isinstance(shape, Moving) for shape in placed):
            return cls(placed)
        regions, motions = list(placed), list[Moving | None](checked[2] or (None,) * len(placed))
        for i, shape in enumerate(placed):
            if isinstance(shape, Moving):
                if checked[2]:
                    allowed = "moving obstacles either among the obstacles or beside them"
                    raise WorldError(f"moving: expected {allowed}, got both")
                regions[i], motions[i] = shape.swept, shape
            motion = motions[i]
            if motion is not None and checked[1] and checked[1][i] is not None:
                raise WorldError(f"obstacles[{i}]: expected an estimate or a motion, got both")
            if motion is not None and regions[i] is not motion.swept and regions[i] != motion.swept:
                raise WorldError(f"moving[{i}]: expected the region that it sweeps in its place, got {regions[i]}")
        for name in filter(lambda name: name is not None, checked[0]):
            _id(name, "ids:")
        among = tuple(motions) if any(motions) else ()
        return cls(tuple(regions), checked[0], checked[1], among).require_unique_ids()


@dataclass(frozen=True)
class Change:
    """What became of one obstacle.

    Attributes:
        id: its identity, in both worlds; None if it has none.
        before: the region it covered; None if it was added.
        after: the region it covers; None if it was removed.
        index_before: its place among the obstacles of the world before; None if it was added.
        index_after: its place among those of the world after; None if it was removed.
        estimate: how well it is known afterwards; None if exactly.
        moving: how it moves afterwards (``after`` is the region that it sweeps); None if it stands.

    Raises:
        WorldError: no shapes or places, a shape without a place or the other way round, or another region than swept.
    """

    id: str | None
    before: Shape | None
    after: Shape | None
    index_before: int | None
    index_after: int | None
    estimate: ObstacleEstimate | None = None
    moving: Moving | None = None

    def __post_init__(self) -> None:
        for shape, index in ((self.before, self.index_before), (self.after, self.index_after)):
            if (shape is None) != (index is None) or not isinstance(shape, (*SHAPES, type(None))):
                raise WorldError(f"change: expected shapes with their indices, got {brief(shape)} at {brief(index)}")
            if index is not None and (not isinstance(index, int) or isinstance(index, bool) or index < 0):
                raise WorldError(f"change: expected an index of 0 or more, got {brief(index)}")
        if self.id is not None and not isinstance(self.id, str):
            raise WorldError(f"change: expected an id that is a text, got {brief(self.id)}")
        if self.moving is not None and self.moving.swept is not self.after and self.moving.swept != self.after:
            raise WorldError(f"change: expected the region that {brief(self.moving)} sweeps, got {brief(self.after)}")

    def __str__(self) -> str:
        name = self.id or (self.index_before if self.after is None else self.index_after)
        verb = "+" if self.before is None else "-" if self.after is None else "~"
        return f"{verb}{name}"

    @classmethod
    def between(cls, before: Row | None, after: Row | None, i: int | None, j: int | None) -> Change:
        """Return the change of an obstacle from one row at an index to another."""
        shape, name, estimate, moving = after or (None, before and before[1], None, None)
        return cls(name, before and before[0], shape, i, j, estimate, moving)


@dataclass(frozen=True)
class Changes:
    """What turns one world into another; true if it is anything.

    Attributes:
        items: one for each obstacle that was added, removed or changed.
    """

    items: tuple[Change, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "items", each_of(self.items, Change, "changes", error=WorldError))
        gone = [item.index_before for item in self.items if item.index_before is not None]
        if len(set(gone)) < len(gone):
            raise WorldError(f"changes: expected each obstacle in one of them, got indices {brief(gone)}")

    def __bool__(self) -> bool:
        return bool(self.items)

    def __repr__(self) -> str:
        shown = [str(item) for item in self.items[:8]] + (["…"] if len(self.items) > 8 else [])
        return f"Changes({', '.join(shown) or 'none'})"  # +added, -removed, ~changed: ids, or indices


_MATCHES: tuple[Callable[[Row], Any], ...] = (
    lambda row: tuple(map(id, row)),
    lambda row: row[1],
    lambda row: row if row[1] is None else None,
    lambda row: row[0] if row[1] is None else None,
)
"""By what an obstacle is found again: the same objects, its id, and without one what is said of it, then its shape."""


def difference(before: Obstacles, after: Obstacles) -> Changes:
    """Return what turns some obstacles into others.

    Obstacles with an id are matched by it, those without by what is said of them: each that has an equal one among the
    others is unchanged, wherever it stands. One that has no id and was moved counts as removed and added.
    """
    old, new = before.rows(), after.rows()
    gone, come, items = list(range(len(old))), list(range(len(new))), list[Change]()
    for key in _MATCHES:
        places = defaultdict[Any, list[int]](list)
        for j in reversed(come):
            places[key(new[j])].append(j)
        places.pop(None, None)
        rest, matched = [], set()
        for i in gone:
            found = places.get(key(old[i]))
            if not found:
                rest.append(i)
                continue
            j = found.pop()
            matched.add(j)
            if old[i] != new[j]:
                items.append(Change.between(old[i], new[j], i, j))
        gone, come = rest, [j for j in come if j not in matched]
        if not gone or not come:
            break
    items += [Change.between(old[i], None, i, None) for i in gone]
    items += [Change.between(None, new[j], None, j) for j in come]
    return Changes(tuple(items))


def apply(obstacles: Obstacles, changes: Changes) -> Obstacles:
    """Return the obstacles after changes: those changed or added at their index, the others in their order around them.

    Raises:
        WorldError: the changes are not those of these obstacles.
    """
    gone = {item.index_before: item for item in changes.items if item.index_before is not None}
    come = {item.index_after: item for item in changes.items if item.index_after is not None}
    before = len(obstacles.shapes)
    for i, item in gone.items():
        shape, name = obstacles.row(i)[:2] if i < before else (None, None)
        if i >= before or name != item.id or (shape is not item.before and shape != item.before):
            raise WorldError(f"apply: expected changes of this world, got one of another: {item} at index {i}")
    places = sorted(item.index_after for item in changes.items if item.index_after is not None)
    after = before - len(gone) + len(places)
    if len(come) < len(places) or (places and places[-1] >= after):
        raise WorldError(f"apply: expected changes with different indices below {after}, got {brief(places)}")
    columns = []
    for column, field in zip(obstacles, ("after", "id", "estimate", "moving"), strict=True):
        new: list[Any] = [getattr(come[i], field) for i in places]
        values: list[Any] = []
        if column or any(value is not None for value in new):
            values.extend(column or repeat(None, before))
            for i in sorted(gone, reverse=True):
                del values[i]
            for i, value in zip(places, new, strict=True):
                values.insert(i, value)
        columns.append(tuple(values) if any(value is not None for value in values) else ())
    result = Obstacles(*columns)
    return result.require_unique_ids() if any(item.id and item.before is None for item in changes.items) else result


def changes_of_edits(
    obstacles: Obstacles,
    add: Iterable[Obstacle] | Mapping[str, Obstacle],
    remove: Iterable[str | int],
    move: Mapping[str | int, ArrayLike],
    replace: Mapping[str | int, Obstacle],
    grown: bool,
) -> Changes:
    """Return the changes that edits make of some obstacles (:meth:`trailmark.World.edited`).

    ``grown`` says whether obstacles with estimates are grown for a risk, which an estimate that is new here is not.

    Raises:
        WorldError: an unknown or duplicate identity, an obstacle that is edited twice, or a value that is none.
    """
    places = {name: i for i, name in enumerate(obstacles.ids) if name is not None}
    edits: dict[int, Row | None] = {}
    verbs: dict[int, str] = {}

    def place_of(name: Any, verb: str) -> int:
        place = (
            places[name] if isinstance(name, str) and name in places else index_of(obstacles, name, f"edited: {verb}")
        )
        if place in verbs:
            one = f"expected each obstacle in one edit, got {brief(name)} in {verbs[place]} and {verb}"
            raise WorldError(f"edited: {one}")
        verbs[place] = verb
        return place

    for name in each_of(remove, object, "edited: remove", error=WorldError):
        edits[place_of(name, "remove")] = None
    changed: tuple[tuple[str, Any, Callable[..., Row]], ...] = (("move", move, _moved), ("replace", replace, _row))
    for verb, given, edited in changed:
        if not isinstance(given, Mapping):
            raise WorldError(f"edited: {verb}: expected a mapping of ids or indices, got {brief(given)}")
        for name, value in given.items():
            place = place_of(name, verb)
            edits[place] = edited(value, obstacles.row(place), f"edited: {verb}[{brief(name)}]", grown)

    lost = sorted(place for place, row in edits.items() if row is None)
    items = [
        Change.between(obstacles.row(place), row, place, None if row is None else place - bisect_left(lost, place))
        for place, row in sorted(edits.items())
    ]
    named = isinstance(add, Mapping)
    new: Any = (
        add.items() if isinstance(add, Mapping) else enumerate(each_of(add, object, "edited: add", error=WorldError))
    )
    for k, (name, obstacle) in enumerate(new, start=len(obstacles.shapes) - len(lost)):
        row = (None, _id(name, "edited: add:") if named else None, None, None)
        items.append(Change.between(None, _row(obstacle, row, f"edited: add[{brief(name)}]", grown), None, k))
    return Changes(tuple(items))


def index_of(obstacles: Obstacles, name: object, verb: str) -> int:
    """Return the index of an obstacle that is named by its id or by its index.

    Raises:
        WorldError: there is none; ``verb`` says in the message what was to be done with it.
    """
    count, known = len(obstacles.shapes), [known for known in obstacles.ids if known is not None]
    if isinstance(name, str):
        if name in obstacles.ids:
            return obstacles.ids.index(name)
        unknown = f"expected an index, for no obstacle has an id, got {name!r}"
        raise WorldError(f"{verb}: {expected_name(name, known[:50]) if known else unknown}")
    if isinstance(name, int | np.integer) and not isinstance(name, bool) and 0 <= name < count:
        return int(name)
    allowed = f"an id or an index from 0 to {count - 1}" if count else "nothing, for there are no obstacles"
    raise WorldError(f"{verb}: expected {allowed}, got {brief(name)}")


def _id(value: object, name: str) -> str:
    """Return an obstacle's id: a text that is not empty, nor what audits call the world's edges."""
    if isinstance(value, str) and value not in ("", "bounds", "boundary"):
        return value
    raise WorldError(f"{name} expected ids that are texts, not empty, not bounds or boundary, got {brief(value)}")


def _row(given: Any, before: Row, where: str, grown: bool) -> Row:
    """Return what is said of a new obstacle in the place of another, or of one of an id."""
    obstacle = shape_of(given, where)
    one_of(obstacle, (*SHAPES, Moving, ObstacleEstimate), where, error=WorldError)
    if grown and isinstance(obstacle, ObstacleEstimate):
        raise WorldError(
            f"{where}: expected a shape, for this world's obstacles are grown for a risk, got an estimate; "
            "trailmark.estimation.refined takes estimates"
        )
    if isinstance(obstacle, ObstacleEstimate):
        return obstacle.mean, before[1], obstacle, None
    return (
        (obstacle.swept, before[1], None, obstacle)
        if isinstance(obstacle, Moving)
        else (obstacle, before[1], None, None)
    )


def _moved(by: ArrayLike, before: Row, where: str, grown: bool) -> Row:
    """Return what is said of an obstacle once it is displaced."""
    step = number_array(by, where, "expected dx, dy or dx, dy, dtheta, got {}", error=WorldError)
    if step.shape not in ((2,), (3,)) or not np.isfinite(step).all():
        raise WorldError(f"{where}: expected two or three finite numbers dx, dy, dtheta, got {brief(by)}")
    dx, dy, dtheta = (*step.tolist(), 0.0)[:3]
    shape, name, estimate, moving = before
    if moving is not None:
        moving = moving.displaced(dx, dy, dtheta)
        return moving.swept, name, None, moving
    if estimate is None:
        return displaced(shape, dx, dy, dtheta), name, None, None
    if isinstance(estimate.mean, Disc):
        dtheta = 0.0  # what it was grown to may be no disc
    if grown and dtheta:
        allowed = "expected dx, dy, for an obstacle that is grown for a risk is not turned"
        raise WorldError(f"{where}: {allowed}, got {brief(by)}")
    mean = displaced(estimate.mean, dx, dy, dtheta)
    return displaced(shape, dx, dy, dtheta), name, replaced(estimate, mean=mean), None
