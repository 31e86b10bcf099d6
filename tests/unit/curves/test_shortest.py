"""Dubins' and Reeds-Shepp's curves: lengths and words against OMPL's, and far from the origin."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.helpers.trials import few, trials

from trailmark import ConfigurationError, CurvePath, Robot, Steering, se2
from trailmark.curves.dubins import dubins_words
from trailmark.curves.reeds_shepp import reeds_shepp_words
from trailmark.curves.shortest import MAX_WORDS, all_words, curve_states
from trailmark.curves.words import copy_word, rounding, seen_from, unit_length, walk

ORACLE = """
import sys
import numpy as np
from ompl import base as ob
data = np.load(sys.argv[1])
a, b, t, radius = data["a"], data["b"], data["t"], float(data["radius"])
answers = {}
for name, kind in (("dubins", ob.DubinsStateSpace), ("reeds-shepp", ob.ReedsSheppStateSpace)):
    space = kind(radius)
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(-1e4); bounds.setHigh(1e4)
    space.setBounds(bounds)
    si = ob.SpaceInformation(space)
    p, q, r = si.allocState(), si.allocState(), si.allocState()
    lengths, places = np.empty(len(a)), np.empty((len(a), 3))
    for i in range(len(a)):
        for s, v in ((p, a[i]), (q, b[i])):
            s.setX(v[0]); s.setY(v[1]); s.setYaw(v[2])
        lengths[i] = space.distance(p, q)
        space.interpolate(p, q, t[i], r)
        places[i] = r.getX(), r.getY(), r.getYaw()
    answers[name + " lengths"], answers[name + " places"] = lengths, places
np.savez(sys.argv[2], **answers)
"""


def pairs(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """10,000 pairs: far apart, near to one another, the same place, straight ahead and behind, arcs, turns in place."""
    rng = np.random.default_rng(11)
    a = rng.uniform((-20, -20, -math.pi), (20, 20, math.pi), (10_000, 3))
    b = rng.uniform((-20, -20, -math.pi), (20, 20, math.pi), (10_000, 3))
    near = slice(0, 4000)
    b[near, :2] = a[near, :2] + radius * rng.uniform(-4.0, 4.0, (4000, 2))
    b[4000:4200] = a[4000:4200]
    way = rng.uniform(0.01, 20.0, 600)
    way[300:] *= -1.0
    b[4200:4800] = a[4200:4800]
    b[4200:4800, 0] += way * np.cos(a[4200:4800, 2])
    b[4200:4800, 1] += way * np.sin(a[4200:4800, 2])
    turn = rng.uniform(0.02, 3.0, 600) * rng.choice((-1.0, 1.0), 600)
    side = rng.choice((-1.0, 1.0), 600)
    q = a[4800:5400]
    b[4800:5400, 0] = q[:, 0] + side * radius * (np.sin(q[:, 2] + turn) - np.sin(q[:, 2]))
    b[4800:5400, 1] = q[:, 1] - side * radius * (np.cos(q[:, 2] + turn) - np.cos(q[:, 2]))
    b[4800:5400, 2] = q[:, 2] + turn
    b[5400:5600, :2] = a[5400:5600, :2]
    b[:, 2] = se2.wrap(b[:, 2])
    return a, b


@pytest.fixture(scope="module", params=[1.0, 4.5])
def answers(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    folder: Path = tmp_path_factory.mktemp("ompl")
    a, b = pairs(request.param)
    t = np.random.default_rng(12).uniform(0.0, 1.0, len(a))
    np.savez(folder / "in.npz", a=a, b=b, t=t, radius=request.param)
    words = [sys.executable, "-c", ORACLE, str(folder / "in.npz"), str(folder / "out.npz")]
    subprocess.run(words, timeout=120.0, check=True)
    with np.load(folder / "out.npz") as found:
        return {"a": a, "b": b, "t": t, "radius": np.array(request.param), **found}


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False], ids=["reeds-shepp", "dubins"])
def test_lengths_and_places_are_ompls(answers: dict[str, np.ndarray], reverse: bool) -> None:
    a, b = answers["a"], answers["b"]
    steering = Steering(float(answers["radius"]), reverse)
    lengths = steering.lengths(a, b)
    longer = answers[f"{steering.kind} lengths"] - lengths
    assert longer.min() > -1e-9
    # On arcs and straight lines drawn with rounding, OMPL's own lengths may be too large: the root of a rounding, or
    # centimetres once in a hundred times. (That ours end at the goal is tested below.)
    degenerate = slice(4200, 5400)
    assert np.delete(longer, np.r_[degenerate]).max() < 1e-9
    assert np.quantile(longer[degenerate], 0.95) < 1e-9
    # Places along the curve: OMPL's, or, where others are as short, on one of those.
    t = answers["t"]
    found = steering.states(a, b, (t * lengths)[:, None])[:, 0]
    expected = answers[f"{steering.kind} places"]
    other = np.flatnonzero(np.abs(se2.difference(found, expected)).max(axis=1) > 1e-6)
    other = other[(other < 4200) | (other >= 5600)]
    assert len(other) < 0.02 * len(a)
    words = np.empty((MAX_WORDS, 2, 5))
    for i in other:
        n, swapped = all_words(a[i], b[i], steering.radius, reverse, words)
        alike = [word for word in words[:n] if steering.radius * unit_length(word) < lengths[i] + 1e-8]
        count = len(alike)
        assert count > 1
        for word in alike:
            copy_word(word, swapped, word)
        on_them = curve_states(a[[i] * count], np.array(alike), steering.radius, np.full((count, 1), t[i] * lengths[i]))
        assert np.abs(se2.difference(on_them[:, 0], expected[i])).max(axis=1).min() < 1e-6


def test_a_car_that_reverses_drives_back_on_the_same_curve() -> None:
    a, b = pairs(1.0)
    steering = Steering(1.0)
    there, back = steering.curves(a, b), steering.curves(b, a)
    assert np.array_equal(there.signed_lengths, -back.signed_lengths[:, ::-1])
    assert np.array_equal(there.sides, back.sides[:, ::-1])
    assert (Steering(1.0, reverse=False).lengths(a, b) - there.lengths > -1e-9).all()


def test_known_lengths() -> None:
    forward, both = Steering(2.0, reverse=False), Steering(2.0)
    origin = (0.0, 0.0, 0.0)
    assert both.lengths(origin, origin) == forward.lengths(origin, origin) == 0.0
    assert forward.lengths(origin, (5, 0, 0)) == both.lengths(origin, (5, 0, 0)) == 5.0
    assert both.lengths(origin, (-5, 0, 0)) == 5.0
    assert forward.lengths(origin, (2, 2, math.pi / 2)) == pytest.approx(math.pi)
    assert both.lengths(origin, (-2, -2, math.pi / 2)) == pytest.approx(math.pi)
    # A turn on the spot: three arcs of a sixth of a turn each; forwards only, LRL with whole arcs around.
    assert both.lengths(origin, (0, 0, math.pi)) == pytest.approx(2.0 * math.pi)
    assert forward.lengths(origin, (0, 0, math.pi)) == pytest.approx(2.0 * math.pi * 7.0 / 3.0)
    assert both.curves(origin, (0, 0, math.pi)).names()[0] in {"L+R-L+", "R+L-R+", "L-R+L-", "R-L+R-"}
    # What rounding alone sets aside costs no circle.
    for theta in np.linspace(-3.1, 3.1, 41):
        far = 1e3 * np.array([math.cos(theta), math.sin(theta)])
        q = np.array([far[0], far[1], theta])
        ahead = q + np.array([7.0 * math.cos(theta), 7.0 * math.sin(theta), 0.0])
        assert forward.lengths(q, ahead) == pytest.approx(7.0, abs=1e-9)


START, END = (0.0, 0.0, 0.0), (6.0, 4.0, 1.0)


def test_one_or_many() -> None:
    steering = Steering(1.5)
    one = steering.lengths(START, END)
    assert isinstance(one, float)
    assert steering.lengths([START, START], [END, START]).tolist() == [one, 0.0]
    assert steering.lengths([START, END], END).tolist() == [one, 0.0]
    assert steering.states(START, END, [0.0, 1.0, one]).shape == (3, 3)
    assert steering.states([START, END], [END, START], [0.0, 1.0]).shape == (2, 2, 3)
    assert steering.states([START, END], [END, START], [[0.0], [1.0]]).shape == (2, 1, 3)
    assert steering.lengths(np.empty((0, 3)), np.empty((0, 3))).shape == (0,)


def test_a_robots_steering() -> None:
    assert Steering.of(Robot.disc(1.0)) is None
    car = Robot(Robot.rectangle(4.0, 2.0).footprint, turning_radius=5.0, reverse=False)
    assert Steering.of(car) == Steering(5.0, reverse=False)
    assert Steering(5.0).kind == "reeds-shepp"
    assert Steering(5.0, reverse=False).kind == "dubins"


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_a_radius_that_is_none(radius: float) -> None:
    with pytest.raises(ConfigurationError, match="expected a finite number above 0, got"):
        Steering(radius)


def test_other_shapes_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="expected as many ends as starts, got 2 starts and 3 ends"):
        Steering(1.0).lengths([START] * 2, [END] * 3)
    with pytest.raises(ConfigurationError, match=r"curve: start: expected shape \(3,\) or \(n, 3\) for x, y, theta,"):
        Steering(1.0).lengths((1.0, 2.0), END)


WORDS = {"dubins": dubins_words, "reeds-shepp": reeds_shepp_words}


def integrated(q: np.ndarray, sides: np.ndarray, ways: np.ndarray, radius: float, steps: int = 400) -> np.ndarray:
    """Drive x' = cos θ, y' = sin θ, θ' = side / ρ over each piece by Runge and Kutta's classical method."""
    x, y, theta = (float(v) for v in q)
    for side, way in zip(sides, ways, strict=True):
        h, turn = way / steps, side / radius
        for _ in range(steps):
            middle, after = theta + 0.5 * h * turn, theta + h * turn
            x += h / 6.0 * (math.cos(theta) + 4.0 * math.cos(middle) + math.cos(after))
            y += h / 6.0 * (math.sin(theta) + 4.0 * math.sin(middle) + math.sin(after))
            theta = after
    return np.array([x, y, theta])


def words_to(kind: str, a: np.ndarray, b: np.ndarray, radius: float) -> np.ndarray:
    words = np.empty((60, 2, 5))
    return words[: WORDS[kind](*seen_from(a, b, radius), rounding(a, b, radius), words)]


@pytest.mark.slow
@pytest.mark.parametrize("kind", WORDS)
@pytest.mark.parametrize("radius", [0.3, 1.0, 25.0])
def test_every_word_leads_to_the_goal(kind: str, radius: float) -> None:
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(400):
        a, b = rng.uniform((-30, -30, -math.pi), (30, 30, math.pi), (2, 3))
        if rng.random() < 0.7:
            b[:2] = a[:2] + radius * rng.uniform(-4.0, 4.0, 2)
        for word in words_to(kind, a, b, radius):
            end = np.empty(3)
            walk(a, word, radius, math.inf, end)
            assert np.abs(se2.difference(end, b)).max() < 1e-9 * max(1.0, radius)
            # A piece on the wrong side of 0 by a hair is driven in the other direction.
            if not ((word[0] != 0.0) & (np.abs(word[0]) < 1.1e-3)).any():
                seen.add("".join("SLR"[int(side)] + "-+"[int(way > 0.0)] for way, side in word.T if way))
    # All six words of Dubins, and the 48 of Reeds and Shepp (none is left out because a piece happens to be 0).
    assert len(seen) == (6 if kind == "dubins" else 48)


@pytest.mark.slow
@pytest.mark.parametrize("kind", WORDS)
def test_words_drive_as_a_car_does(kind: str) -> None:
    rng = np.random.default_rng(4)
    for _ in trials(25):
        radius = float(rng.uniform(0.5, 5.0))
        a, b = rng.uniform((-8, -8, -math.pi), (8, 8, math.pi), (2, 3))
        words = words_to(kind, a, b, radius)
        for word in words[:: max(1, len(words) // 6)]:
            assert np.abs(se2.difference(integrated(a, word[1], word[0] * radius, radius), b)).max() < 1e-7
            # And halfway too.
            along = rng.uniform(0.0, 1.0) * radius * unit_length(word)
            ends = np.cumsum(np.abs(word[0])) * radius
            ways = np.clip(along - (ends - np.abs(word[0]) * radius), 0.0, np.abs(word[0]) * radius) * np.sign(word[0])
            q = np.empty(3)
            walk(a, word, radius, along, q)
            assert -math.pi < q[2] <= math.pi
            assert np.abs(se2.difference(integrated(a, word[1], ways, radius), q)).max() < 1e-7


ORIGINS = [(0.0, 0.0), (1e3, -1e3), (5e5, 4.5e6), (-1e7, 3.0)]
PIECES = [(0,), (1,), (-1,), (0, 1), (0, -1), (1, 0), (-1, 0), (1, 0, 1), (1, 0, -1), (-1, 0, 1), (-1, 0, -1), (1, -1)]


def rounding_at(origin: tuple[float, float]) -> float:
    """Metres that a place may be off by after a dozen roundings."""
    return 12.0 * math.ulp(max(abs(v) for v in origin) + 100.0)


def driven(q: np.ndarray, sides: tuple[int, ...], ways: np.ndarray, radius: float) -> np.ndarray:
    """Return where pieces lead to, as a program would compute it in world coordinates, one after the other."""
    x, y, theta = q
    for side, way in zip(sides, ways, strict=True):
        if side == 0:
            x, y = x + way * math.cos(theta), y + way * math.sin(theta)
        else:
            turned = theta + side * way / radius
            x += side * radius * (math.sin(turned) - math.sin(theta))
            y -= side * radius * (math.cos(turned) - math.cos(theta))
            theta = turned
    return np.array([x, y, math.atan2(math.sin(theta), math.cos(theta))])


def curves(
    origin: tuple[float, float], radius: float, reverse: bool, n: int
) -> list[tuple[np.ndarray, np.ndarray, float, tuple[int, ...]]]:
    """Return starts, ends, lengths and sides of curves made of pieces, none longer than 1.4 radians or 30 m."""
    rng = np.random.default_rng(7)
    made = []
    for k in range(n):
        sides = PIECES[k % len(PIECES)]
        ways = np.array([rng.uniform(0.02, 30.0) if side == 0 else radius * rng.uniform(0.02, 1.4) for side in sides])
        if reverse and rng.random() < 0.5:
            ways = -ways
        a = np.array([*(origin + rng.uniform(-40.0, 40.0, 2)), rng.uniform(-math.pi, math.pi)])
        made.append((a, driven(a, sides, ways, radius), float(np.abs(ways).sum()), sides))
    return made


@pytest.mark.parametrize("reverse", [True, False], ids=["reeds-shepp", "dubins"])
@pytest.mark.parametrize("radius", [0.3, 1.0, 4.5])
@pytest.mark.parametrize("origin", ORIGINS)
def test_rounding_makes_no_curve_longer(origin: tuple[float, float], radius: float, reverse: bool) -> None:
    steering = Steering(radius, reverse)
    made = curves(origin, radius, reverse, few(1200, of=6))
    a, b = np.array([row[0] for row in made]), np.array([row[1] for row in made])
    longer = steering.lengths(a, b) - [row[2] for row in made]
    # Moving aside costs a car the square root of how far: where it has to, it does so by manoeuvres.
    assert longer.max() < 1e-6 * radius + 10.0 * rounding_at(origin), (longer.argmax(), longer.max())
    curve = steering.curves(a, b)
    ends = steering.states(a, b, curve.lengths[:, None])[:, 0]
    assert np.abs((ends - b)[:, :2]).max() < 1e-9 * radius + 2.0 * rounding_at(origin)
    assert np.abs(se2.difference(ends, b)[:, 2]).max() < 1e-9
    assert reverse or (curve.signed_lengths >= 0.0).all()
    for p, q, length, sides in made[: few(60, of=2)]:
        path = CurvePath(np.array([p, q]), steering)
        assert path.length < length + 1e-6 * radius + 10.0 * rounding_at(origin)
        # Beside two arcs that touch, words with cusps are as short; at 1e7 m they may be beside single arcs.
        assert path.cusps == 0 or sides == (1, -1) or abs(origin[0]) > 1e6
