"""Grown obstacles: they contain what they must, and little more. The oracles move, turn and buffer with shapely."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2
from tests.helpers.trials import few, trials
from tests.helpers.worlds import grown_world, star_polygon

from trailmark.errors import WorldError
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.risk import DISC_ERROR, SIDES, grow, refined, regrow
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import ObstacleEstimate, Query, RiskBound, Robot, World

L_SHAPE = Polygon(np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3.0]]))
FRAME = Polygon(np.array([[0, 0], [4, 0], [4, 3], [0, 3.0]]), (np.array([[1, 1], [3, 1], [3, 2], [1, 2.0]]),))
SHAPES: dict[str, Shape] = {
    "disc": Disc((1.0, -2.0), 0.4),
    "wall": Rectangle((2.0, 1.0), 5.0, 0.1, 0.7),
    "convex": Polygon(np.array([[0, 0], [2, 0], [1, 1.5]])),
    "L": L_SHAPE,
    "frame": FRAME,
    "star": star_polygon(np.random.default_rng(4), (0.0, 0.0), 2.0),
}
NUMBERS = {name: 5 if isinstance(shape, Rectangle) else 3 for name, shape in SHAPES.items()}

seeds = st.integers(0, 2**32 - 1)


def random_covariance(rng: np.random.Generator, k: int, scale: float = 0.15) -> np.ndarray:
    """Any direction, axes from a hundredth of the scale up to the scale."""
    q, _ = np.linalg.qr(rng.normal(size=(k, k)))
    covariance = (q * (scale * 10.0 ** rng.uniform(-2.0, 0.0, k)) ** 2) @ q.T
    return np.asarray(0.5 * (covariance + covariance.T))


def moved(shape: Shape, xi: np.ndarray) -> shapely.Geometry:
    """The shape with the errors xi, turned and stretched exactly; a disc as the polygon inside it."""
    e = np.concatenate([xi, np.zeros(5 - len(xi))])
    if isinstance(shape, Disc):
        x, y = np.asarray(shape.center) + e[:2]
        return shapely.buffer(shapely.Point(x, y), max(0.0, shape.radius + e[2]), quad_segs=64)
    if isinstance(shape, Rectangle):
        half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (shape.length + e[3], shape.width + e[4]) / 2.0
        box = shapely.Polygon(half) if half.any() else shapely.Point(0, 0)
        body = shapely.affinity.rotate(box, shape.heading + e[2], origin=(0, 0), use_radians=True)
        return shapely.affinity.translate(body, *(np.asarray(shape.center) + e[:2]))
    pivot = tuple(shape.vertices.mean(axis=0))
    body = shapely.affinity.rotate(shape.shapely(), e[2], origin=pivot, use_radians=True)
    return shapely.affinity.translate(body, *e[:2])


def region(shape: Shape) -> shapely.Geometry:
    """The grown shape, as a polygon not smaller than it by more than a hair."""
    return shape.polygon(1e-6).shapely()


def escapes(body: shapely.Geometry, grown: shapely.Geometry) -> bool:
    return float(shapely.area(shapely.difference(body, grown))) > 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
@given(seed=seeds, confidence=st.floats(0.05, 0.9999))
@settings(max_examples=few(25))
def test_every_shape_in_the_ellipsoid_is_inside(name: str, seed: int, confidence: float) -> None:
    rng = np.random.default_rng(seed)
    k = int(rng.integers(2, NUMBERS[name] + 1))
    covariance = random_covariance(rng, k)
    grown = region(grow(ObstacleEstimate(SHAPES[name], covariance), confidence))
    surface = rng.normal(size=(20, k))
    surface *= math.sqrt(chi2.ppf(confidence, k)) / np.linalg.norm(surface, axis=1)[:, None]
    for xi in surface @ np.linalg.cholesky(covariance).T:
        body = moved(SHAPES[name], xi)
        assert not escapes(body, grown) or not body.is_valid


@pytest.mark.parametrize("name", SHAPES)
@given(seed=seeds, confidence=st.floats(0.05, 0.9999))
@settings(max_examples=few(25))
def test_a_displacement_gives_the_minkowski_sum_up_to_the_stated_error(name: str, seed: int, confidence: float) -> None:
    covariance = random_covariance(np.random.default_rng(seed), 2)
    shape = SHAPES[name]
    grown = region(grow(ObstacleEstimate(shape, covariance), confidence))
    # In coordinates in which the ellipse is the unit circle, the sum is a buffer.
    axes = np.linalg.cholesky(covariance) * math.sqrt(chi2.ppf(confidence, 2))

    def minkowski(scale: float, error: float) -> shapely.Geometry:
        body = shapely.buffer(moved(shape, np.zeros(2)), error, quad_segs=64) if error else moved(shape, np.zeros(2))
        inverse = np.linalg.inv(axes)
        flat = shapely.affinity.affine_transform(body, [*inverse.ravel(), 0, 0])
        return shapely.affinity.affine_transform(shapely.buffer(flat, scale, quad_segs=64), [*axes.ravel(), 0, 0])

    # GEOS drops details below 1 % of a buffer's radius in bays, so its sum may be a little large there.
    lower = minkowski(0.98, 0.0)
    upper = minkowski(1.03 / math.cos(math.pi / SIDES), 2.0 * DISC_ERROR)
    assert not escapes(lower, grown)
    assert not escapes(grown, upper)


@pytest.mark.parametrize("name", SHAPES)
def test_an_error_along_one_line_only(name: str) -> None:
    covariance = np.outer([0.3, 0.4], [0.3, 0.4])
    grown = region(grow(ObstacleEstimate(SHAPES[name], covariance), 0.95))
    q = math.sqrt(chi2.ppf(0.95, 1))
    for sign in (-1.0, 0.0, 1.0):
        assert not escapes(moved(SHAPES[name], sign * q * np.array([0.3, 0.4])), shapely.buffer(grown, 1e-9))
    # One degree of freedom: farther than q standard deviations nothing is asked for.
    around = shapely.buffer(moved(SHAPES[name], np.zeros(2)), 1.03 * 0.5 * q + 2.0 * DISC_ERROR, quad_segs=64)
    assert not escapes(grown, around)


def test_a_hole_that_no_robot_may_trust_is_filled() -> None:
    grown = grow(ObstacleEstimate(FRAME, 0.04 * np.eye(2)), 0.999)
    assert isinstance(grown, Polygon)
    assert grown.holes == ()
    assert len(grow(ObstacleEstimate(FRAME, 1e-4 * np.eye(2)), 0.999).polygon().holes) == 1


@pytest.mark.slow
@given(seed=seeds)
@settings(max_examples=few(10))
def test_the_robots_own_error_counts(seed: int) -> None:
    """A robot that believes to touch the grown obstacle meets the true one as seldom as stated."""
    rng = np.random.default_rng(seed)
    confidence = 0.9
    covariance, pose = random_covariance(rng, 3), random_covariance(rng, 3, 0.2)
    wall = Rectangle((0.0, 0.0), 2.0, 0.4, 0.3)
    arms = np.array([[-0.4, -0.2], [0.4, -0.2], [0.4, 0.2], [-0.4, 0.2]])
    reach = float(np.hypot(0.4, 0.2))
    grown = region(grow(ObstacleEstimate(wall, covariance), confidence, pose_covariance=pose, reach=reach))
    # Towards the obstacle from a random side until it touches.
    turn, side = rng.uniform(-np.pi, np.pi, 2)
    body = shapely.affinity.rotate(shapely.Polygon(arms), turn, origin=(0, 0), use_radians=True)
    way = np.array([math.cos(side), math.sin(side)])
    near, far = 0.0, 20.0
    for _ in range(40):
        middle = 0.5 * (near + far)
        hit = shapely.affinity.translate(body, *(middle * way)).intersects(grown)
        near, far = (middle, far) if hit else (near, middle)
    hits = 0
    draws = 200
    for _ in range(draws):
        e = rng.multivariate_normal(np.zeros(3), pose)
        true_body = shapely.affinity.rotate(body, e[2], origin=(0, 0), use_radians=True)
        placed = shapely.affinity.translate(true_body, *(far * way + e[:2]))
        hits += placed.intersects(moved(wall, rng.multivariate_normal(np.zeros(3), covariance)))
    assert hits / draws <= 1.0 - confidence


@pytest.mark.parametrize(
    ("covariance", "problem"),
    [
        (np.eye(4), r"disc: covariance: expected shape \(2, 2\) or \(3, 3\), got \(4, 4\)"),
        ([[1.0]], "shape"),
        ([[1.0, 0.5], [0.0, 1.0]], "symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], "without negative eigenvalues"),
        ([[1.0, math.nan], [math.nan, 1.0]], "finite"),
        ("x", "no matrix"),
    ],
)
def test_bad_covariances_are_one_line(covariance: object, problem: str) -> None:
    with pytest.raises(WorldError, match=problem):
        ObstacleEstimate(Disc((0, 0), 1), covariance)  # type: ignore[arg-type]  # the test's point


@pytest.mark.parametrize("name", ["L", "frame", "star"])
@pytest.mark.parametrize("offset", [1e4, 1e6, 5e6])
def test_far_from_the_origin_nothing_is_missing(name: str, offset: float) -> None:
    shape = SHAPES[name]
    assert isinstance(shape, Polygon)
    rng = np.random.default_rng(int(offset))
    for _ in trials(5):
        shift = offset * rng.uniform(-1.0, 1.0, 2)
        far = Polygon(shape.vertices + shift, tuple(hole + shift for hole in shape.holes))
        covariance = random_covariance(rng, 2)
        grown = grow(ObstacleEstimate(far, covariance), 0.9).polygon()
        ellipse = math.sqrt(float(chi2.ppf(0.9, 2))) * np.linalg.cholesky(covariance)
        for angle in np.linspace(0.0, 2.0 * np.pi, 24):
            by = ellipse @ (np.cos(angle), np.sin(angle))
            # Of the shape moved as far as it goes: what is on its outline lies in the region, to some ulps.
            for ring in shapely.get_rings(shapely.transform(far.shapely(), lambda p, by=by, o=shift: p - o + by)):
                points = shapely.points(shapely.get_coordinates(shapely.segmentize(ring, 0.05)))
                near = shapely.transform(grown.shapely(), lambda p, o=shift: p - o)
                assert shapely.distance(near, points).max() <= 4.0 * np.spacing(offset)


def test_what_an_overlay_loses_is_made_up_for(monkeypatch: pytest.MonkeyPatch) -> None:
    estimate = ObstacleEstimate(FRAME, 1e-4 * np.eye(2))
    whole = grow(estimate, 0.999).polygon().shapely()
    union_all = shapely.union_all
    for lose in (lambda parts: parts[:-1], lambda parts: parts[1:2] + parts[3:4]):
        monkeypatch.setattr(shapely, "union_all", lambda parts, lose=lose: union_all(lose(parts)))
        grown = grow(estimate, 0.999).polygon().shapely()
        assert shapely.covers(shapely.buffer(grown, 1e-9), whole)


BOUNDS = (0.0, 0.0, 20.0, 10.0)
ESTIMATES = [
    ObstacleEstimate(Disc((3.0, 4.0), 0.5), np.array([[0.02, 0.01], [0.01, 0.03]])),
    ObstacleEstimate(Disc((9.0, 2.0), 0.3), np.diag([0.01, 0.01, 0.0025])),
    ObstacleEstimate(Rectangle((7.0, 6.0), 3.0, 0.1, 0.4), np.diag([0.01, 0.02, 0.001, 0.04])),
    ObstacleEstimate(Polygon(np.array([[12, 1], [15, 1], [13, 4.0]])), np.diag([0.01, 0.01, 0.0004])),
]
POSE = np.diag([0.01, 0.01, 0.0009])


def office(confidence: float = 0.99) -> World:
    return grown_world(
        ESTIMATES,
        BOUNDS,
        confidence,
        robot=Robot.rectangle(0.6, 0.4),
        queries=(Query("door", (1, 1, 0), (18, 9, 0)),),
        fixed=[Disc((18.0, 2.0), 0.4)],
        weights=[1.0, 2.0, 3.0, 4.0],
        pose_covariance=POSE,
    )


def shares(n: int, weights: list[float] | None) -> list[float]:
    """Return what share of the risk each of n obstacles gets."""
    world = grown_world(ESTIMATES[:1] * n, BOUNDS, 0.9, weights=weights)
    return [estimate.share or 0.0 for estimate in world.estimates if estimate is not None]


@pytest.mark.slow
@settings(max_examples=few(30))
@given(st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=20))
def test_risks_add_up_to_what_there_is(weights: list[float]) -> None:
    for given_weights in (None, weights):
        found = shares(len(weights), given_weights)
        assert min(found) > 0.0
        assert math.fsum(found) == pytest.approx(1.0, rel=1e-12)


def test_each_obstacle_is_grown_by_its_part_of_the_risk() -> None:
    world = office(0.96)
    assert world.risk == RiskBound(0.96, POSE, Robot.rectangle(0.6, 0.4).sweep_radius)
    assert [e.share if e else None for e in world.estimates] == pytest.approx([0.1, 0.2, 0.3, 0.4, None])
    for shape, estimate, risk in zip(world.obstacles, ESTIMATES, (0.004, 0.008, 0.012, 0.016), strict=False):
        alone = grow(estimate, 1.0 - risk, pose_covariance=POSE, reach=math.hypot(0.3, 0.2))
        assert shape.area == pytest.approx(alone.area, rel=1e-9)
    assert world.obstacles[4] == Disc((18.0, 2.0), 0.4)


@pytest.mark.slow
@given(st.floats(0.01, 0.99999), st.integers(0, 2**32 - 1))
@settings(max_examples=few(10))
def test_growing_again_needs_the_file_only(tmp_path_factory: pytest.TempPathFactory, p: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    estimates = []
    for _ in range(3):
        a = rng.normal(size=(3, 3)) * 0.1
        estimates.append(ObstacleEstimate(Rectangle(tuple(rng.uniform(2, 8, 2)), 2.0, 0.1, float(a[0, 0])), a @ a.T))
    file = tmp_path_factory.mktemp("risk") / "w.yaml"
    world = grown_world(estimates, BOUNDS, 0.9)
    world.save(file)
    again = regrow(World.load(file), p)
    assert again == regrow(world, p) == grown_world(estimates, BOUNDS, p)
    assert regrow(again, 0.9) == world


def test_worlds_as_they_were_measured_can_be_grown() -> None:
    means = tuple(estimate.mean for estimate in ESTIMATES)
    measured = World("measured", BOUNDS, means, estimates=tuple(ESTIMATES))
    grown = regrow(measured, 0.99)
    assert [e.share for e in grown.estimates if e] == [0.25] * 4
    assert all(new.area > old.area for new, old in zip(grown.obstacles, means, strict=True))
    certain = World("certain", BOUNDS, means)
    assert regrow(certain, 0.99).obstacles == means


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: World("w", BOUNDS, (), estimates=(ESTIMATES[0],)), "expected one for each of 0 obstacles, or"),
        (
            lambda: World(
                "w", BOUNDS, 2 * (Disc((1, 1), 1),), estimates=2 * (ObstacleEstimate(Disc((1, 1), 1), np.eye(2), 0.6),)
            ),
            r"expected shares that add up to at most 1, got 1\.2",
        ),
        (lambda: ObstacleEstimate(Disc((1, 1), 1), np.eye(2), 0.0), "expected a finite number above 0 and at most 1,"),
        (
            lambda: ObstacleEstimate(Disc((1, 1), 1), np.eye(2), math.nan),
            "expected a finite number above 0 and at most",
        ),
        (lambda: RiskBound(1.0), "expected a number above 0 and below 1, got 1"),
        (lambda: RiskBound(0.5, np.eye(2)), r"shape \(3, 3\), got \(2, 2\)"),
        (lambda: RiskBound(0.5, None, -1.0), r"expected a finite number of 0 or more, got -1\.0 m"),
    ],
)
def test_contradictions_are_one_line(make: object, problem: str) -> None:
    with pytest.raises(WorldError, match=problem):
        make()  # type: ignore[operator]  # the parameters above


@pytest.mark.slow
def test_all_obstacles_together_are_covered_as_often_as_stated() -> None:
    rng = np.random.default_rng(3)
    centres = rng.uniform(0, 50, (30, 2))
    covariances = np.array([a @ a.T for a in rng.normal(size=(30, 2, 2)) * 0.2])
    estimates = [ObstacleEstimate(Disc(tuple(c), 0.5), s) for c, s in zip(centres, covariances, strict=True)]
    draws = 500
    true = [
        shapely.buffer(shapely.points(rng.multivariate_normal(centre, covariance, draws)), 0.5, quad_segs=16)
        for centre, covariance in zip(centres, covariances, strict=True)
    ]
    for confidence in (0.5, 0.9, 0.99):
        world = grown_world(estimates, (0, 0, 50, 50), confidence)
        escaped = np.zeros(draws, dtype=bool)
        for shape, discs in zip(world.obstacles, true, strict=True):
            region = shape.polygon(1e-6).shapely()
            shapely.prepare(region)
            escaped |= ~shapely.covers(region, discs)
        assert escaped.mean() <= 1.0 - confidence + 3.0 * math.sqrt(confidence * (1.0 - confidence) / draws)


def test_an_obstacle_that_is_known_better_is_grown_anew_and_no_other() -> None:
    world = office()
    better = replace(ESTIMATES[2], covariance=0.1 * ESTIMATES[2].covariance)
    found = refined(world, {2: better})
    assert [i for i in range(5) if found.obstacles[i] is not world.obstacles[i]] == [2]
    expected = regrow(replace(world, estimates=(*world.estimates[:2], found.estimates[2], *world.estimates[3:])), 0.99)
    assert found.obstacles == expected.obstacles
    assert found.estimates[2] == replace(better, share=0.3)
    (item,) = world.difference(found).items
    assert (item.before, item.after) == (world.obstacles[2], found.obstacles[2])
    assert item.estimate is found.estimates[2]


def test_refining_is_refused_in_one_line() -> None:
    with pytest.raises(WorldError, match="refined: expected an id or an index from 0 to 4, got 9"):
        refined(office(), {9: ESTIMATES[0]})
    with pytest.raises(EstimationError, match="obstacle 4: expected an estimate with a share of the risk, got none"):
        refined(office(), {4: ESTIMATES[0]})
    with pytest.raises(WorldError, match="shares that add up to at most 1"):
        refined(office(), {4: replace(ESTIMATES[0], share=0.5)})
