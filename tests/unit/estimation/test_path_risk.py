"""A path's probability of a collision against exact probabilities, and against draws judged state by state."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from scipy.stats import norm, poisson
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS

from trailmark.estimation.risk import PathRisk, path_risk, swept_region
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import ObstacleEstimate, RiskBound, Robot, World

BOUNDS = (-50.0, -50.0, 50.0, 50.0)
STRAIGHT = np.array([[-40.0, 0.0, 0.0], [40.0, 0.0, 0.0]])
DRAWS = 20_000


def world_of(*estimates: ObstacleEstimate, robot: Robot | None = None, pose: FloatArray | None = None) -> World:
    risk = None if pose is None else RiskBound(0.9, pose, 2.0)
    shapes = tuple(estimate.mean for estimate in estimates)
    return World("w", BOUNDS, shapes, robot or Robot.disc(0.5), estimates=estimates, risk=risk)


def within(risk: PathRisk, exact: float) -> bool:
    """Whether the count may come of a sum of this probability: one in a million does not."""
    mean = exact * risk.draws
    return bool(poisson.cdf(risk.hits, mean) > 1e-6 and poisson.sf(risk.hits - 1, mean) > 1e-6)


@pytest.mark.parametrize("gap", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("pose", [None, np.diag([0.5, 0.02, 0.0])])
def test_a_disc_beside_a_straight_path(gap: float, pose: FloatArray | None) -> None:
    disc = ObstacleEstimate(Disc((3.0, 1.0 + gap), 0.5), np.diag([0.3, 0.04]))
    sigma = math.sqrt(0.04 + (0.0 if pose is None else 0.02))
    # It meets the path from above, unless it leaps across it.
    exact = norm.cdf(-gap / sigma) - norm.cdf(-(gap + 2.0) / sigma)
    risk = path_risk(world_of(disc, pose=pose), STRAIGHT, draws=DRAWS)
    assert within(risk, exact)
    assert risk.upper_bound >= exact
    assert risk.upper_bound < 1.3 * exact + 1e-3


def test_an_uncertain_radius_and_several_obstacles_add_up() -> None:
    near = ObstacleEstimate(Disc((3.0, 1.3), 0.5), np.diag([0.01, 0.01, 0.03]))
    far = ObstacleEstimate(Disc((-3.0, -1.4), 0.5), np.diag([0.01, 0.04]))
    exact = norm.cdf(-0.3 / 0.2) + norm.cdf(-0.4 / 0.2)
    assert within(path_risk(world_of(near, far), STRAIGHT, draws=DRAWS), exact)


@pytest.mark.slow
@pytest.mark.parametrize(
    "estimate",
    [
        ObstacleEstimate(Rectangle((2.0, 1.6), 3.0, 0.6, 0.4), np.diag([0.05, 0.04, 0.02, 0.04, 0.02])),
        ObstacleEstimate(Polygon(np.array([[0, 1.2], [3, 1.0], [1.5, 2.5]])), np.diag([0.05, 0.04, 0.02])),
        ObstacleEstimate(Disc((1.0, 1.4), 0.6), np.diag([0.05, 0.06, 0.01])),
    ],
)
def test_shapes_that_turn_and_stretch_against_draws_judged_by_themselves(estimate: ObstacleEstimate) -> None:
    robot, pose = Robot.rectangle(1.2, 0.8), np.diag([0.01, 0.02, 0.003])
    states = np.array([[-4.0, -0.2, 0.0], [0.0, 0.0, 0.3], [2.0, -0.3, -0.2], [6.0, 0.0, 0.0]])
    risk = path_risk(world_of(estimate, robot=robot, pose=pose), states, draws=DRAWS)
    rng, draws, hits = np.random.default_rng(8), 300, 0
    along = np.vstack([a + np.linspace(0, 1, 30)[:, None] * (b - a) for a, b in itertools.pairwise(states)])
    errors = rng.multivariate_normal(np.zeros(len(estimate.covariance)), estimate.covariance, draws)
    poses = rng.multivariate_normal(np.zeros(3), pose, draws)
    outline = np.array([[-0.6, -0.4], [0.6, -0.4], [0.6, 0.4], [-0.6, 0.4]])
    for error, off in zip(errors, poses, strict=True):
        q = along + off
        c, s = np.cos(q[:, 2:]), np.sin(q[:, 2:])
        body = np.stack([c * outline[:, 0] - s * outline[:, 1], s * outline[:, 0] + c * outline[:, 1]], axis=-1)
        bodies = shapely.polygons(body + q[:, None, :2])
        hits += bool(shapely.intersects(bodies, moved(estimate.mean, error)).any())
    share = hits / draws
    spread = 4.0 * math.sqrt(share * (1.0 - share) / draws)
    # The turn of the robot counts as if it moved its farthest point towards the obstacle: never less than there is.
    assert max(share - spread, 0.5 * share) <= risk.probability <= 1.35 * share + spread
    assert 0.01 < share < 0.9


def moved(shape: Shape, error: FloatArray) -> shapely.Geometry:
    """An obstacle with an error, by shapely's affinities."""
    e = np.zeros(5)
    e[: len(error)] = error
    if isinstance(shape, Disc):
        return shapely.Point(shape.center[0] + e[0], shape.center[1] + e[1]).buffer(max(0.0, shape.radius + e[2]), 64)
    if isinstance(shape, Rectangle):
        length, width = max(0.0, shape.length + e[3]), max(0.0, shape.width + e[4])
        flat = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
        turned = shapely.affinity.rotate(flat, shape.heading + e[2], origin=(0, 0), use_radians=True)
        return shapely.affinity.translate(turned, shape.center[0] + e[0], shape.center[1] + e[1])
    centre = tuple(shape.vertices.mean(axis=0))
    turned = shapely.affinity.rotate(shape.shapely(), e[2], origin=centre, use_radians=True)
    return shapely.affinity.translate(turned, e[0], e[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mean", "sigmas"),
    [
        (Disc((1.0, 1.9), 0.6), (0.2, 0.3)),
        (Disc((1.0, 2.1), 0.6), (0.1, 0.1, 0.4)),
        (Disc((1.0, 0.8), 0.02), (0.2, 0.2)),
        (Rectangle((2.0, 2.0), 4.0, 0.4, 0.2), (0.1, 0.1, 0.3)),
        (Rectangle((2.0, 2.6), 4.0, 0.4, 1.5), (0.1, 0.1, 0.01, 0.5, 0.3)),
        (Polygon(np.array([[0, 1.3], [3, 1.2], [1.5, 4.0]])), (0.2, 0.2, 0.3)),
    ],
)
def test_no_draw_that_meets_the_path_is_left_out(mean: Shape, sigmas: tuple[float, ...]) -> None:
    """The draws that cannot meet it are told from their errors alone: each one is judged here."""
    robot, pose, draws = Robot.rectangle(1.2, 0.8), np.diag([0.02, 0.02, 0.01]), few(2000)
    estimate = ObstacleEstimate(mean, np.diag(np.square(sigmas)))
    states = np.array([[-4.0, -0.2, 0.0], [0.0, 0.0, 0.3], [2.0, -0.3, -0.2], [6.0, 0.0, 0.0]])
    risk = path_risk(world_of(estimate, robot=robot, pose=pose), states, draws=draws, margin=0.05, seed=4)
    rng = np.random.default_rng([4, 0])
    errors = rng.multivariate_normal(np.zeros(len(sigmas)), estimate.covariance, draws, method="eigh")
    off = rng.multivariate_normal(np.zeros(3), pose, draws, method="eigh")
    errors[:, :2] -= off[:, :2]
    region = swept_region(robot, states)
    gaps = np.array([region.distance(moved(mean, error)) for error in errors])
    # Rounded arcs of a disc lie inside of it by a 1,200th of its radius.
    near = np.abs(gaps - 0.05 - robot.sweep_radius * np.abs(off[:, 2])) < 1e-3
    hits = int((gaps <= 0.05 + robot.sweep_radius * np.abs(off[:, 2])).sum())
    assert abs(risk.hits - hits) <= near.sum()
    assert 0.01 * draws < hits < 0.6 * draws
    assert near.sum() < 0.1 * hits + 5


def test_inside_a_hole_the_path_is_free_and_far_obstacles_are_not_drawn() -> None:
    hole = np.array([[-44, -8], [-44, 8], [44, 8], [44, -8]])
    ring = Polygon(np.array([[-45, -9], [45, -9], [45, 9], [-45, 9]]), (hole,))
    room = ObstacleEstimate(ring, np.diag([0.01, 0.01, 1e-6]))
    assert path_risk(world_of(room), STRAIGHT).hits == 0
    assert path_risk(world_of(ObstacleEstimate(Disc((0.0, 0.2), 0.5), 0.01 * np.eye(2))), STRAIGHT).probability == 1.0
    assert path_risk(World("w", BOUNDS, (), Robot.disc(0.5)), STRAIGHT, draws=10).hits == 0


def test_the_margin_counts_and_the_seed_decides() -> None:
    world = world_of(ObstacleEstimate(Disc((3.0, 1.4), 0.5), np.diag([0.1, 0.04])))
    plain, wide = path_risk(world, STRAIGHT), path_risk(world, STRAIGHT, margin=0.2)
    assert within(wide, norm.cdf(-0.2 / 0.2))
    assert plain.hits < wide.hits
    assert plain == path_risk(world, STRAIGHT)
    assert plain != path_risk(world, STRAIGHT, seed=1)


def test_the_upper_bound_is_hardly_ever_too_low() -> None:
    # Garwood's bound holds 0.999 of the time: of 2,000 counts two are expected to break it.
    counts = np.random.default_rng(0).binomial(10_000, 0.004, 2000)
    broken = sum(PathRisk(int(hits), 10_000).upper_bound < 0.004 for hits in counts)
    assert broken <= 9
    assert PathRisk(0, 10_000).upper_bound == pytest.approx(-math.log(1e-3) / 10_000)
    assert PathRisk(10_000, 10_000).upper_bound == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangle", "L", "disc"])
def test_the_swept_region_is_what_the_robot_covers(name: str) -> None:
    robot = ROBOTS[name]
    states = np.array([[0, 0, 0], [3, 0, 2.5], [3, 2, -2.5], [3, 2, -2.5]])
    region = swept_region(robot, states)
    shapely.prepare(region)
    bodies = []
    for a, b in itertools.pairwise(states):
        turn = (b[2] - a[2] + math.pi) % (2 * math.pi) - math.pi
        for t in np.linspace(0, 1, 150):
            x, y, theta = a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * turn
            rotation = np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]])
            outline = robot.outline.vertices @ rotation + [x, y]
            bodies.append(shapely.Point(x, y).buffer(0.6) if name == "disc" else shapely.Polygon(outline))
    assert shapely.covers(shapely.buffer(region, 1e-9), bodies).all()
    # No point moves farther than 5 cm from one body to the next.
    assert shapely.covers(shapely.buffer(shapely.union_all(bodies), 0.03), region)
    assert shapely.covers(swept_region(robot, states[0]), robot.outline.shapely())


@pytest.mark.slow
def test_far_from_the_origin_it_is_the_same_region() -> None:
    states = np.array([[0, 0, 0], [3, 0, 2.5], [3, 2, -2.5]])
    near = swept_region(ROBOTS["L"], states)
    for offset in (1e4, 1e6):
        far = swept_region(ROBOTS["L"], states + np.array([offset, -offset, 0.0]))
        back = shapely.transform(far, lambda points, o=offset: points - [o, -o])
        assert shapely.hausdorff_distance(near, back) <= 4.0 * np.spacing(offset)
