"""Following a path from where the robot is: what is left of it, as a command in the robot's own frame."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.footprint import Footprint
from trailmark.exploration.known_map import FREE, OCCUPIED, KnownMap
from trailmark.se2 import FloatArray, between, difference, interpolate, motion_bound, transform, wrap
from trailmark.trajectories.path import Path
from trailmark.world.robot import Robot

__all__ = ["BACK", "PathFollower", "contact_points", "turned_around", "way_back", "way_back_to"]

BoolArray = NDArray[np.bool_]

STEP = 0.05  # Metres between the rows of a command: cars follow their curves to 0.3 mm at a radius of 1 m.
# Metres within which two rows are the same: planners repeat states, and only the next few rows are looked at.
ALIKE = 1e-6
# Of the way from one row to the next, from its middle to either: a curve is longer than the line between its ends.
HALF = 0.55
AHEAD = 4  # Half cells of the way on: what the robot ran into is taken to fill all that it would have swept there.
BESIDE = 0.1  # Cells beside the robot as it stands: what does not lead farther has not run into anything.
BACK = 0.5  # Circumradii by which the robot backs off from what it ran into, besides what its map cannot tell.
# Cells inside the robot: a surface that deep in its body, where it has driven, has come there since; one less deep may
# be a matter of the map's resolution.
DEEP = 1.0


def turned_around(path: Path, checker: StateChecker) -> Path:
    """Return the path with a full turn at its end, where there is room for it."""
    turned = np.repeat(path.states[-1:], 5, axis=0)
    turned[:, 2] = wrap(turned[:, 2] + 0.5 * np.pi * np.arange(5))
    turns = checker.motions_valid(turned[:-1], turned[1:]).all()
    return Path(np.concatenate([path.states, turned[1:]])) if turns else path


class PathFollower:
    """Where the robot is on its path.

    Args:
        path: certified, from where the robot is.
        robot: that follows it.
        footprint: of the robot, dilated by the clearance that it keeps.

    Attributes:
        path: that is followed.
    """

    def __init__(self, path: Path, robot: Robot, footprint: Footprint) -> None:
        self.path, self._footprint = path, footprint
        self._reach = footprint.circumradius
        self._comes_back = robot.drive == "omnidirectional"
        rows = path.resample(STEP).states if len(path.states) > 1 else path.states
        self._rows = rows[np.append(True, motion_bound(rows[:-1], rows[1:], self._reach) > ALIKE)]
        self._at, self._along = 0, 0.0
        self._near: tuple[NDArray[np.intp], ...] | None = None

    @property
    def target(self) -> FloatArray:
        """The path's end, shape (3,)."""
        return np.asarray(self.path.states[-1])

    @property
    def rest(self) -> FloatArray:
        """The rows of the path that are left, shape (n, 3), the first where the robot is on it."""
        rows = self._rows[self._at :]
        return np.concatenate([interpolate(rows[:1], rows[1:2], self._along), rows[1:]]) if len(rows) > 1 else rows

    def advance(self, pose: FloatArray, distance: float) -> float:
        """Take note of where the robot has come to; return how far it is from its path, metres, any of its points.

        Args:
            pose: shape (3,).
            distance: metres that it drove since the last call.
        """
        rows = self._rows[self._at : self._at + 4 + int(np.ceil(2.0 * distance / STEP))]
        if len(rows) == 1:
            ahead = between(rows[0], pose)
            return float(np.hypot(*ahead[:2])) + self._reach * abs(float(ahead[2]))
        a, b = rows[:-1], rows[1:]
        # Headings count by what they move the farthest point: on a turn in place they say how far along it is.
        scale = np.array([1.0, 1.0, self._reach])
        edge, ahead = scale * difference(a, b), scale * difference(a, pose)
        along = np.clip((ahead * edge).sum(axis=1) / np.square(edge).sum(axis=1), 0.0, 1.0)
        off = difference(interpolate(a, b, along), pose)
        away = np.hypot(off[:, 0], off[:, 1]) + self._reach * np.abs(off[:, 2])
        nearest = int(np.flatnonzero(away <= away.min() + 1e-9)[-1])
        past = along[nearest] > 1.0 - 1e-9
        self._at, self._along = self._at + nearest + int(past), 0.0 if past else float(along[nearest])
        return float(away.min())

    def command(self, pose: FloatArray) -> FloatArray:
        """Return what is left of the path in the robot's frame, shape (n, 3), the first row (0, 0, 0).

        A robot that moves in every direction comes back to its path on the way to the next row; others follow the
        path's shape from where they are.

        Args:
            pose: where the robot is, shape (3,).
        """
        rows = self.rest
        ahead = between(pose if self._comes_back else rows[0], rows[1:] if len(rows) > 1 else rows)
        return np.concatenate([np.zeros((1, 3)), ahead])

    def endangered(self, known: KnownMap) -> bool:
        """Return whether the rest of the path may meet a cell that was free at the first call and is not any more.

        The first call is made when the path was planned. False is a proof: whatever came to the planner's world since
        (:meth:`KnownMap.follow`) is no nearer to the rest of the path than the robot's clearance.
        """
        if self._near is None:
            near = np.zeros(known.state.shape, dtype=bool)
            near[known.cells_of(self._rows[:, :2])] = True
            near = grown(near, self._reach + STEP, known.cell) & (known.state == FREE)
            self._near, self._revision = np.nonzero(near), known.revision
        if known.revision == self._revision:
            return False
        self._revision = known.revision
        new = known.state[self._near] != FREE
        middles = known.centres(self._near[0][new], self._near[1][new])
        return bool(new.any()) and self._meets(np.hstack([middles - 0.5 * known.cell, middles + 0.5 * known.cell]))

    def _meets(self, boxes: FloatArray) -> bool:
        """Return whether the robot may meet one of some boxes, xmin, ymin, xmax, ymax, shape (n, 4), farther along."""
        rows, cover = self._rows[self._at :], self._footprint.cover
        between = motion_bound(rows[:-1], rows[1:], self._footprint.sweep_radius)
        off = HALF * float(between.max(initial=0.0))
        reach = self._reach + off
        low, high = boxes[:, :2].min(axis=0) - reach, boxes[:, 2:].max(axis=0) + reach
        rows = rows[((rows[:, :2] >= low) & (rows[:, :2] <= high)).all(axis=1)]
        cos, sin = np.cos(rows[:, 2, None]), np.sin(rows[:, 2, None])
        discs = np.stack([cos * cover[:, 0] - sin * cover[:, 1], sin * cover[:, 0] + cos * cover[:, 1]], axis=-1)
        centres, radii = rows[:, None, :2] + discs, cover[:, 2] + off
        for box in boxes:
            gaps = np.maximum(np.maximum(box[:2] - centres, centres - box[2:]), 0.0)
            if (np.hypot(gaps[..., 0], gaps[..., 1]) < radii).any():
                return True
        return False


def grown(mask: BoolArray, radius: float, cell: float) -> BoolArray:
    """Return the cells within a distance of a mask's, shape of ``mask``, bool."""
    from scipy.ndimage import distance_transform_edt

    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    beyond = int(np.ceil(radius / cell)) + 2
    part = tuple(slice(max(0, at[0] - beyond), at[-1] + beyond + 1) for at in (rows, columns))
    found = np.zeros_like(mask)
    found[part] = distance_transform_edt(~mask[part], sampling=cell) <= radius + cell
    return found


def contact_points(robot: Robot, states: FloatArray, cell: float) -> FloatArray:
    """Return points that the robot's outline would have come to, x, y, shape (m, 2), none of them where it stands.

    Args:
        robot: that stands in contact.
        states: where it stands, and how its path would have gone on, shape (n, 3).
        cell: side of the map's cells, metres.
    """
    outline = robot.outline
    rim = shapely.get_coordinates(shapely.segmentize(outline.shapely().exterior, 0.5 * cell))
    ahead = Path(states).resample(0.5 * cell).states[1 : 1 + AHEAD]
    swept = np.asarray(transform(ahead, rim)).reshape(-1, 2)
    body = shapely.Polygon(transform(states[0], outline.vertices)).buffer(BESIDE * cell)
    return np.asarray(swept[~shapely.contains_xy(body, swept)])


def way_back(driven: FloatArray, distance: float, reach: float) -> FloatArray:
    """Return the last stretch of what was driven, backwards, shape (m, 3), m >= 1.

    Args:
        driven: poses in the order of time, the last where the robot is, shape (n, 3).
        distance: metres that some point of the robot is to move by, if it has come as far.
        reach: metres from the robot's reference point to its farthest one.
    """
    back = driven[::-1]
    along = np.concatenate([[0.0], np.cumsum(motion_bound(back[:-1], back[1:], reach))])
    return _spaced(back[: int(np.searchsorted(along, distance)) + 1], reach)


def _spaced(driven: FloatArray, reach: float) -> FloatArray:
    """Return the first pose, those a step away from the one before, and the last: a follower looks few rows ahead."""
    kept, last = [0], len(driven) - 1
    for i in range(1, len(driven)):
        if motion_bound(driven[kept[-1]], driven[i], reach) >= STEP:
            kept.append(i)
    return np.array(driven[[*(kept[:-1] or kept[:last]), last]])


def way_back_to(there: BoolArray, driven: FloatArray, known: KnownMap, robot: Robot) -> Path | None:
    """Return the way back along what was driven since the robot was last in some cells.

    None if it never was, if a surface stands deep in the way now (:data:`DEEP`), or if it cannot drive backwards.

    Args:
        there: which cells, shape (rows, columns).
        driven: poses in the order of time, the last where the robot is, shape (n, 3).
        known: the map.
        robot: that drove.
    """
    was = np.flatnonzero(there[known.cells_of(driven[:, :2])])
    body = robot.outline.shapely().buffer(-DEEP * known.cell)
    if not len(was) or was[-1] == len(driven) - 1 or not robot.reverse or body.is_empty:
        return None
    back = _spaced(driven[was[-1] :][::-1], robot.circumradius)
    surfaces = known.centres(*np.nonzero(known.state == OCCUPIED))
    for pose in Path(back).resample(STEP).states:
        ahead = surfaces[np.hypot(*(surfaces - pose[:2]).T) <= robot.circumradius]
        inside = between(pose, np.column_stack([ahead, np.zeros(len(ahead))]))
        if shapely.contains_xy(body, inside[:, :2]).any():
            return None
    return Path(back)
