"""Does a path past grown obstacles meet the true ones as seldom as it is said to? Prints a table.

A simulated robot drives round a yard, once with a detector of discs (whose radius is uncertain too), once with a laser
scanner (walls, discs and hulls), and ``trailmark.estimation.map_log`` makes a map by its defaults, with the noise that
is stated; the truth errs as much, or twice as much. The estimates are grown for a confidence p, in even shares, and
LandmarkPlanner plans through what is left. Then

1. the true obstacles and the robot's pose are drawn from the estimates' distributions: the share of draws in which the
   planned path collides, over all worlds;
2. the simulation's own obstacles are the true ones: a new world and a new log each time, one outcome for each path.

Both must stay under 1 − p. Paths in the worlds as they were measured, not grown, show what there is to prevent, and
that collisions are found. Intervals are Clopper and Pearson's, 95 %; those of the first table take its draws as
independent, which they are given the worlds. Collisions are found by numpy and shapely in bodies at every centimetre
and hundredth of a radian of the path; nothing of this is shared with what grows obstacles.

    python -m benchmarks.risk [--worlds 20] [--draws 1000] [--logs 100]
"""

from __future__ import annotations

import argparse
import itertools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.stats import beta
from tests.helpers.alignment import Alignment, aligned
from tests.helpers.worlds import star_polygon

from benchmarks.report import Claim, keep
from trailmark.errors import TrailmarkError
from trailmark.estimation import MappingSettings, MapSettings, RangeBearing, Unicycle, disc_estimates, map_log
from trailmark.estimation.risk import regrow
from trailmark.estimation.scan_features import ScanSettings
from trailmark.estimation.simulation import simulate
from trailmark.estimation.virtual_sensors import Detector, Scanner
from trailmark.planning import LandmarkPlanner
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]

CONFIDENCES = (0.9, 0.95, 0.99)
SENSORS = ("detector", "scanner")
ROBOT = Robot.rectangle(0.5, 0.36)
CORNERS = 0.5 * np.array([[-0.5, -0.36], [0.5, -0.36], [0.5, 0.36], [-0.5, 0.36]])
REACH = float(np.hypot(0.25, 0.18))
BOUNDS = (0.0, 0.0, 14.0, 10.0)
START, GOAL = (1.0, 1.0, 0.0), (13.0, 9.0, 0.0)
WAY = np.array([[1, 1], [13, 1], [13, 9], [1, 9], [1, 5], [13, 5], [13, 9], [7, 9], [7, 1], [1, 1.0]])
MOTION = Unicycle(0.02, 0.02, period=1.0)
DETECTOR = Detector(RangeBearing(0.08, 0.02), max_range=5.0, period=0.5)
SCANNER = Scanner(beams=361, field_of_view=2.0 * math.pi, max_range=8.0, sigma=0.02, period=1.0)
MAPPING = MappingSettings(scan=ScanSettings(sigma_range=0.02, sigma_bearing=0.002))
FACTORS = (1.0, 2.0)
"""How many times as large as stated the noise of sensors and odometry is."""
RADIUS_SIGMA = 0.02
POSE_SIGMA = np.array([0.02, 0.02, 0.01])
"""Of the robot that follows the path, as it finds its place in the map."""


class Case(NamedTuple):
    """A world as it is estimated, and as it is."""

    estimated: World
    true: World
    pose_covariance: FloatArray
    pose_error: FloatArray
    """Of the robot, shape (3,): its true configuration less the one it takes itself to have."""


class Counts(NamedTuple):
    """Collisions among trials."""

    hits: int
    trials: int

    def interval(self) -> tuple[float, float]:
        """Return Clopper and Pearson's 95 % interval of the probability."""
        low = 0.0 if self.hits == 0 else float(beta.ppf(0.025, self.hits, self.trials - self.hits + 1))
        high = 1.0 if self.hits == self.trials else float(beta.ppf(0.975, self.hits + 1, self.trials - self.hits))
        return low, high


def yard(rng: np.random.Generator, sensor: str) -> World:
    """Return a world with obstacles off the way that the robot drives: posts; for a scanner boxes and stones too."""
    way, obstacles = shapely.LineString(WAY), list[Shape]()
    while len(obstacles) < 20:
        x, y = (float(v) for v in rng.uniform((0.8, 0.8), (13.2, 9.2)))
        kind = rng.integers(0, 3) if sensor == "scanner" else 0
        shape: Shape
        if kind == 0:
            shape = Disc((x, y), float(rng.uniform(0.12, 0.35)))
        elif kind == 1:
            length, width, heading = (float(v) for v in rng.uniform((0.6, 0.2, 0.0), (2.0, 0.5, math.pi)))
            shape = Rectangle((x, y), length, width, heading)
        else:
            shape = star_polygon(rng, (x, y), float(rng.uniform(0.4, 0.8)))
        region = shape.polygon().shapely()
        apart = [shapely.distance(region, other.polygon().shapely()) for other in obstacles]
        if shapely.distance(region, way) > 0.35 and min(apart, default=1.0) > 0.3:
            obstacles.append(shape)
    return World("yard", BOUNDS, tuple(obstacles), ROBOT)


def mapped(rng: np.random.Generator, sensor: str, factor: float) -> Case:
    """Return what ``trailmark map`` makes of a drive whose sensors and odometry err ``factor`` times as much as stated.

    The map's frame is its own: the truth is laid over it, detected features or scans' poses nearest to their partners.
    """
    true = yard(rng, sensor)
    motion = Unicycle(factor * MOTION.sigma_v, factor * MOTION.sigma_omega, period=MOTION.period)
    model = RangeBearing(factor * DETECTOR.model.sigma_range, factor * DETECTOR.model.sigma_bearing)
    detector = replace(DETECTOR, model=model) if sensor == "detector" else None
    scanner = replace(SCANNER, sigma=factor * SCANNER.sigma) if sensor == "scanner" else None
    log, truth = simulate(true, WAY, motion, detector=detector, scanner=scanner, random_state=rng)
    x, y, theta = (float(value) for value in truth[0, 1:])
    settings = MapSettings(start=(x, y, theta), velocity=MOTION, range_bearing=DETECTOR.model, mapping=MAPPING)
    found = map_log(log, settings, robot=ROBOT)
    world = found.world
    if sensor == "detector":
        assert found.slam is not None
        discs = [true.obstacles[feature.identity or 0] for feature in found.slam.features]
        radii = np.array([disc.radius for disc in discs if isinstance(disc, Disc)])
        centres = np.array([disc.center for disc in discs if isinstance(disc, Disc)])
        radii = np.maximum(0.02, radii + RADIUS_SIGMA * rng.standard_normal(len(radii)))
        means = np.array([feature.mean for feature in found.slam.features])
        covariances = np.array([e.covariance for e in world.estimates if e is not None])
        estimates = tuple(disc_estimates(means, covariances, radii, RADIUS_SIGMA))
        world = replace(world, obstacles=tuple(e.mean for e in estimates), estimates=estimates)
        onto = aligned(centres, means)
    else:
        rows = np.searchsorted(truth[:, 0], found.trajectory[:, 0] - 1e-9)
        onto = aligned(truth[rows, 1:3], found.trajectory[:, 1:3])
    laid_over = replace(true, obstacles=tuple(moved(shape, onto) for shape in true.obstacles))
    return Case(replace(world, bounds=BOUNDS), laid_over, np.diag(POSE_SIGMA**2), POSE_SIGMA * rng.standard_normal(3))


def moved(shape: Shape, onto: Alignment) -> Shape:
    """Return a shape moved rigidly."""
    turn = math.atan2(onto.R[1, 0], onto.R[0, 0])
    if isinstance(shape, Polygon):
        return Polygon(onto(shape.vertices))
    x, y = (float(value) for value in onto(np.array([shape.center]))[0])
    if isinstance(shape, Disc):
        return Disc((x, y), shape.radius)
    return Rectangle((x, y), shape.length, shape.width, shape.heading + turn)


def planned(world: World) -> FloatArray | None:
    """Return the configurations of a path in a grown world, shape (n, 3); None if there is none."""
    try:
        result = LandmarkPlanner(world, ROBOT, seed=0).plan(START, GOAL, time_limit=5.0, max_iterations=2)
    except TrailmarkError:
        return None  # an end lies in a grown obstacle
    return None if result.path is None else result.path.states


def along(states: FloatArray) -> FloatArray:
    """Return configurations on a path, a centimetre and a hundredth of a radian apart at most, shape (m, 3)."""
    parts = [states[:1]]
    for a, b in itertools.pairwise(states):
        step = b - a
        step[2] = math.remainder(step[2], 2.0 * math.pi)
        n = max(1, math.ceil(max(float(np.hypot(*step[:2])), abs(step[2])) / 0.01))
        parts.append(a + np.linspace(0.0, 1.0, n + 1)[1:, None] * step)
    return np.concatenate(parts)


def bodies(q: FloatArray) -> NDArray[np.object_]:
    """Return the robot's outline at configurations, shape (m,)."""
    cos, sin = np.cos(q[:, 2:]), np.sin(q[:, 2:])
    x = q[:, :1] + cos * CORNERS[:, 0] - sin * CORNERS[:, 1]
    y = q[:, 1:2] + sin * CORNERS[:, 0] + cos * CORNERS[:, 1]
    return np.asarray(shapely.polygons(np.stack([x, y], axis=-1)))


def drawn(shape: Shape, xi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return vertices of a shape with errors xi, shapes (draws, m, 2), and what they are dilated by, (draws,)."""
    e = np.zeros((len(xi), 5))
    e[:, : xi.shape[1]] = xi
    if isinstance(shape, Disc):
        return np.array(shape.center) + e[:, None, :2], np.maximum(0.0, shape.radius + e[:, 2])
    if isinstance(shape, Rectangle):
        sides = np.maximum(0.0, np.array([shape.length, shape.width]) + e[:, 3:5])
        local = 0.5 * sides[:, None] * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
        centre, turn = np.array(shape.center), shape.heading + e[:, 2]
    else:
        centre = shape.vertices.mean(axis=0)
        local, turn = np.broadcast_to(shape.vertices - centre, (len(xi), *shape.vertices.shape)), e[:, 2]
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    x, y = local[..., 0], local[..., 1]
    place = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    return centre + e[:, None, :2] + place, np.zeros(len(xi))


def collisions(world: World, covariance: FloatArray, states: FloatArray, draws: int, rng: np.random.Generator) -> int:
    """Return in how many draws of all obstacles and of the robot's pose the path collides."""
    q = along(states)
    placed = bodies(q)
    errors = rng.multivariate_normal(np.zeros(3), covariance, draws)
    strays = np.hypot(errors[:, 0], errors[:, 1]) + REACH * np.abs(errors[:, 2])
    hit = np.zeros(draws, dtype=bool)
    for estimate in world.estimates:
        if estimate is None:
            continue
        xi = rng.multivariate_normal(np.zeros(len(estimate.covariance)), estimate.covariance, draws)
        vertices, radii = drawn(estimate.mean, xi)
        mean, radius = (part[0] for part in drawn(estimate.mean, np.zeros((1, 2))))
        away = np.maximum(0.0, shapely.distance(placed, filled(estimate.mean, mean)) - radius)
        moved = np.hypot(*np.moveaxis(vertices - mean, -1, 0)).max(axis=1) + np.maximum(0.0, radii - radius) + strays
        for i in np.flatnonzero(~hit & (moved >= away.min())):
            near = bodies(q[away <= moved[i]] + errors[i])
            hit[i] = (shapely.distance(near, filled(estimate.mean, vertices[i])) < max(radii[i], 1e-9)).any()
    return int(hit.sum())


def filled(shape: Shape, vertices: FloatArray) -> shapely.Geometry:
    """Return a drawn obstacle without a disc's radius; holes are filled, no path leads into them."""
    return shapely.Point(vertices[0]) if isinstance(shape, Disc) else shapely.Polygon(vertices)


def collides(case: Case, states: FloatArray) -> bool:
    """Return whether the path meets one of the simulation's obstacles."""
    placed = bodies(along(states) + case.pose_error)
    radii = [shape.radius if isinstance(shape, Disc) else 0.0 for shape in case.true.obstacles]
    solids = [filled(shape, drawn(shape, np.zeros((1, 2)))[0][0]) for shape in case.true.obstacles]
    return any((shapely.distance(placed, s) < max(r, 1e-9)).any() for s, r in zip(solids, radii, strict=True))


def main() -> int:
    """Draw, plan, count, and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--logs", type=int, default=100, help="worlds whose own obstacles count, these included")
    options = parser.parse_args()
    tally: dict[tuple[str, float, float], dict[str, list[float]]] = {}
    for i in range(max(options.worlds, options.logs)):
        sensor, factor = SENSORS[i % 2], FACTORS[i // 2 % 2]
        rng = np.random.default_rng([2026, i])
        try:
            case = mapped(rng, sensor, factor)
        except TrailmarkError as error:
            print(f"{sensor}, noise x {factor:g}, log {i}: no map: {error}")
            continue
        for p in (0.0, *CONFIDENCES):
            grown = regrow(case.estimated, p, pose_covariance=case.pose_covariance) if p else case.estimated
            own = tally.setdefault((sensor, factor, p), {"hits": [], "true": [], "failed": []})
            states = planned(grown)
            if states is None:
                own["failed"].append(i)
                continue
            own["true"].append(collides(case, states))
            if i < options.worlds:
                own["hits"].append(collisions(case.estimated, case.pose_covariance, states, options.draws, rng))
    keep("risk", claims(tally, options.draws))
    return 0


def claims(tally: dict[tuple[str, float, float], dict[str, list[float]]], draws: int) -> list[Claim]:
    """Return a row for each sensor, noise and confidence, and for draws and logs."""
    found = []
    for (sensor, factor, p), own in sorted(tally.items()):
        outcomes = {
            "draws": Counts(int(sum(own["hits"])), draws * len(own["hits"])),
            "logs": Counts(int(sum(own["true"])), len(own["true"])),
        }
        for name, counts in outcomes.items():
            if not counts.trials:
                continue
            low, high = counts.interval()
            share = counts.hits / counts.trials
            # Of a hundred logs none may collide or one: what the interval excludes is a bound that is broken.
            broken = p > 0.0 and (share >= 1.0 - p if name == "draws" else low > 1.0 - p)
            figure = f"{100 * share:.3f} % ({100 * low:.3f} to {100 * high:.3f} %) of {counts.trials:,} {name} collide"
            grown = f"grown for {p:g}" if p else "as measured"
            beside = f"allowed: {100 * (1 - p):.3g} %" if p else ""
            missed = "too many" if broken else f"{len(own['failed'])} without a path" if own["failed"] else ""
            found.append(Claim(f"{sensor}, noise x {factor:g}, {grown}", figure, beside, missed))
    return found


if __name__ == "__main__":
    raise SystemExit(main())
