"""Changes between two worlds: obstacles that came, went, moved or became better known."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import repeat
from operator import is_not
from typing import Any, NamedTuple

from trailmark.arguments import brief, each_of
from trailmark.errors import WorldError
from trailmark.estimates import ObstacleEstimate
from trailmark.moving import Moving
from trailmark.shapes import Disc, Polygon, Rectangle, Shape

__all__ = ["Change", "Changes", "Obstacles", "apply", "difference"]

SHAPES = (Disc, Rectangle, Polygon)


class Obstacles(NamedTuple):
    """A world's obstacles, as parallel tuples; the last three are empty if they say nothing of any obstacle."""

    shapes: tuple[Shape, ...] = ()
    ids: tuple[str | None, ...] = ()
    estimates: tuple[ObstacleEstimate | None, ...] = ()
    moving: tuple[Moving | None, ...] = ()

    def rows(self) -> list[tuple[Any, ...]]:
        """Return a tuple (shape, id, estimate, moving) for each obstacle."""
        return list(zip(self.shapes, *(column or repeat(None) for column in self[1:]), strict=False))

    def identities(self) -> list[tuple[int, ...]]:
        """Return what tells the objects that say an obstacle's row from others, for each."""
        columns = (map(id, column) if column else repeat(id(None)) for column in self[1:])
        return list(zip(map(id, self.shapes), *columns, strict=False))


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
        name = self.id or self.index_before if self.after is None else self.id or self.index_after
        verb = "+" if self.before is None else "-" if self.after is None else "~"
        return f"{verb}{name}"


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


def difference(before: Obstacles, after: Obstacles) -> Changes:
    """Return what turns some obstacles into others.

    Obstacles with an id are matched by it, those without by what is said of them: each that has an equal one among the
    others is unchanged, wherever it stands. One that has no id and was moved counts as removed and added.
    """
    old, new = before.rows(), after.rows()
    # Worlds mostly share the objects of what did not change: then a set tells what did, in a fraction of the time.
    old_keys, new_keys = before.identities(), after.identities()
    old_set, new_set = set(old_keys), set(new_keys)
    if len(old_set) == len(old) and len(new_set) == len(new):
        left = [i for i, key in enumerate(old_keys) if key not in new_set]
        right = {j for j, key in enumerate(new_keys) if key not in old_set}
    else:
        left, right = list(range(len(old))), set(range(len(new)))
    by_id = {new[j][1]: j for j in right}
    items = []
    unmatched = []
    for i in left:
        name = old[i][1]
        j = by_id.get(name) if name is not None else None
        if j is None:
            unmatched.append(i)
            continue
        right.remove(j)
        if old[i] != new[j]:
            items.append(_change(old, new, i, j))
    unnamed = [j for j in sorted(right) if new[j][1] is None]
    for same in (lambda row: tuple(map(id, row)), lambda row: row, lambda row: row[0]):
        # Identical objects first, then equal ones, then those of which something else is said.
        places = defaultdict(list)
        for j in reversed(unnamed):
            places[same(new[j])].append(j)
        rest = []
        for i in unmatched:
            found = places.get(same(old[i])) if old[i][1] is None else None
            if not found:
                rest.append(i)
                continue
            j = found.pop()
            right.remove(j)
            if old[i] != new[j]:
                items.append(_change(old, new, i, j))
        unmatched = rest
        unnamed = [j for j in unnamed if j in right]
        if not unmatched or not unnamed:
            break
    items += [_change(old, new, i, None) for i in unmatched]
    items += [_change(old, new, None, j) for j in sorted(right)]
    return Changes(tuple(items))


def apply(obstacles: Obstacles, changes: Changes) -> Obstacles:
    """Return the obstacles after changes: those changed or added at their index, the others in their order around them.

    Raises:
        WorldError: the changes are not those of these obstacles.
    """
    count = len(obstacles.shapes)
    gone = [item for item in changes.items if item.index_before is not None]
    come = sorted(
        (item for item in changes.items if item.index_after is not None), key=lambda item: item.index_after or 0
    )
    for item in gone:
        i = item.index_before or 0
        known = i < count and (obstacles.ids[i] if obstacles.ids else None) == item.id
        if not known or (obstacles.shapes[i] is not item.before and obstacles.shapes[i] != item.before):
            raise WorldError(f"apply: expected changes of this world, got one of another: {item} at index {i}")
    after = count - len(gone) + len(come)
    places = [item.index_after or 0 for item in come]
    if len(set(places)) < len(places) or (places and places[-1] >= after):
        raise WorldError(f"apply: expected changes with different indices below {after}, got {brief(places)}")
    lost = sorted((item.index_before or 0 for item in gone), reverse=True)
    values = (
        zip(*((item.after, item.id, item.estimate, item.moving) for item in come), strict=True) if come else [()] * 4
    )
    columns = [_edited(column, count, lost, places, new) for column, new in zip(obstacles, values, strict=True)]
    result = Obstacles(*columns)
    named = [item.id for item in come if item.id is not None and item.before is None]
    if named and len(set(result.ids)) < len(result.ids) - max(0, result.ids.count(None) - 1):
        twice = next(name for name in named if result.ids.count(name) > 1)
        raise WorldError(f"obstacles: expected each id once, got {twice!r} more than once")
    return result


def _edited(
    column: Sequence[Any], count: int, lost: Iterable[int], places: Sequence[int], values: Sequence[Any]
) -> tuple[Any, ...]:
    """Return a column without its entries at ``lost`` (descending) and with values at ``places`` (ascending)."""
    if not column and not any(map(is_not, values, repeat(None))):
        return ()
    rows = list(column) if column else [None] * count
    for i in lost:
        del rows[i]
    for place, value in zip(places, values, strict=True):
        rows.insert(place, value)
    return tuple(rows) if any(map(is_not, rows, repeat(None))) else ()


def _change(old: Sequence[Any], new: Sequence[Any], i: int | None, j: int | None) -> Change:
    before = (None, None) if i is None else old[i]
    after = (None, before[1], None, None) if j is None else new[j]
    return Change(after[1], before[0], after[0], i, j, after[2], after[3])
