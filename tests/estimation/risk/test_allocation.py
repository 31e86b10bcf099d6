"""The risk of a whole path: how it is shared out, what worlds say of it, and that it is kept."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.grown import grown_world
from tests.support.trials import few

from trailmark.errors import FormatError, WorldError
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.risk.allocation import (
    refined,
    regrow,
)
from trailmark.estimation.risk.growth import grow
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import ObstacleEstimate, Query, RiskBound, Robot, World

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


# --- Shares


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


# --- Worlds


def test_each_obstacle_is_grown_by_its_part_of_the_risk() -> None:
    world = office(0.96)
    assert world.risk == RiskBound(0.96, POSE, Robot.rectangle(0.6, 0.4).sweep_radius)
    assert [e.share if e else None for e in world.estimates] == pytest.approx([0.1, 0.2, 0.3, 0.4, None])
    for shape, estimate, risk in zip(world.obstacles, ESTIMATES, (0.004, 0.008, 0.012, 0.016), strict=False):
        alone = grow(estimate, 1.0 - risk, pose_covariance=POSE, reach=math.hypot(0.3, 0.2))
        assert shape.area == pytest.approx(alone.area, rel=1e-9)
    assert world.obstacles[4] == Disc((18.0, 2.0), 0.4)


def test_saving_and_loading_is_exact(tmp_path: Path) -> None:
    world = office()
    world.save(tmp_path / "w.yaml")
    again = World.load(tmp_path / "w.yaml")
    assert again == world
    assert hash(again) == hash(world)
    again.save(tmp_path / "v.yaml")
    assert (tmp_path / "v.yaml").read_text() == (tmp_path / "w.yaml").read_text()


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
    with pytest.raises(WorldError, match=problem) as caught:
        make()  # type: ignore[operator]  # the parameters above
    assert "\n" not in str(caught.value)


HEAD = "trailmark: 1\nbounds: [0, 0, 9, 9]\n"
DISC = "{shape: disc, center: [1, 2], radius: 1"


def entry(estimate: str) -> str:
    return f"{HEAD}obstacles: [{DISC}, estimate: {estimate}}}]"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (entry("5"), "obstacles[0].estimate: "),
        (entry("{}"), "obstacles[0].estimate.mean: "),
        (entry("{mean: 5, covariance: [[1, 0], [0, 1]]}"), "obstacles[0].estimate.mean: "),
        (entry(f"{{mean: {DISC}}}, covarance: 1}}"), "obstacles[0].estimate.covarance: unknown key"),
        (entry(f"{{mean: {DISC}, radus: 1}}, covariance: [[1, 0], [0, 1]]}}"), "obstacles[0].estimate.mean.radus: "),
        (entry("{mean: {shape: disk}, covariance: [[1, 0], [0, 1]]}"), "obstacles[0].estimate.mean: "),
        (entry(f"{{mean: {DISC}}}, covariance: 1}}"), "obstacles[0].estimate.covariance: "),
        (entry(f"{{mean: {DISC}}}, covariance: [1, 2]}}"), "obstacles[0].estimate.covariance[0]: "),
        (entry(f"{{mean: {DISC}}}, covariance: [[1, x], [0, 1]]}}"), "obstacles[0].estimate.covariance[0][1]: "),
        (entry(f"{{mean: {DISC}}}, covariance: [[1, 0], [0, 1, 2]]}}"), "covariance: no matrix"),
        (entry(f"{{mean: {DISC}}}, covariance: [[1, 2], [2, 1]]}}"), "covariance: expected a matrix without negative"),
        (entry(f"{{mean: {DISC}}}, covariance: [[1, 0], [0, 1]], share: 0}}"), "obstacles[0].estimate.share: "),
        (HEAD + "risk: 0.9", "risk: "),
        (HEAD + "risk: {}", "risk.confidence: field required"),
        (HEAD + "risk: {confidence: 1.0}", "risk.confidence: "),
        (HEAD + "risk: {confidence: 0.9, reach: -1}", "risk.reach: "),
        (HEAD + "risk: {confidance: 0.9}", "risk.confidance: unknown key (did you mean 'confidence'?)"),
        (HEAD + "risk: {confidence: 0.9, pose_covariance: [[1, 0], [0, 1]]}", "risk: risk: pose_covariance: expected"),
    ],
)
def test_messages_about_world_files(tmp_path: Path, text: str, problem: str) -> None:
    file = tmp_path / "w.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(FormatError) as caught:
        World.load(file)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


# --- Is the bound kept?


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


# --- Refined


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
