"""Pictures in notebooks: well-formed, to scale, of a limited size, and safe whatever a world is called."""

from __future__ import annotations

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trailmark import LandmarkPlanner, Objective, Path, Query, Robot, World
from trailmark.errors import ConfigurationError
from trailmark.planning import PlanResult
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.sketch.colours import AVOID, COLLISION, GOAL, LANDMARK, OBSTACLE, ONE_WAY, PATH, PREFER, SPEED, START
from trailmark.sketch.scene import plan_facts
from trailmark.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone

CAR = Robot.rectangle(0.8, 0.4)
ROOM = World("room", (0.0, 0.0, 10.0, 6.0), (Rectangle((5.0, 3.0), 2.0, 1.0), Disc((2.0, 4.5), 0.5)), CAR)
SVG = "{http://www.w3.org/2000/svg}"
MOST = 400_000
"""Characters of a picture."""


def parsed(text: str) -> ET.Element:
    return ET.fromstring(text)  # noqa: S314  # made by trailmark


def numbers(data: str) -> np.ndarray[Any, Any]:
    """Return the points of path data made of ``M``, ``l`` and ``z``, shape (n, 2)."""
    points = []
    for part in re.findall(r"M([^M]*)", data):
        start, *moves = part.rstrip("z").split("l")
        values = [float(v) for v in re.findall(r"-?\d*\.?\d+", " ".join([start, *moves]))]
        points += np.array(values).reshape(-1, 2).cumsum(axis=0).tolist()
    return np.array(points)


def test_a_world_is_drawn_to_scale() -> None:
    svg = parsed(ROOM._repr_svg_())
    disc = svg.find(f".//{SVG}circle")
    solid = next(e for e in svg.iter(f"{SVG}path") if e.get("fill") == OBSTACLE)
    assert disc is not None
    corners = numbers(solid.get("d") or "")
    width, height = np.ptp(corners, axis=0)
    assert width / height == pytest.approx(2.0, rel=0.01)
    assert float(disc.get("r") or 0) / width == pytest.approx(0.25, rel=0.02)
    center = corners.mean(axis=0)
    assert (center[0] - float(disc.get("cx") or 0)) / width == pytest.approx(1.5, rel=0.02)
    # y points upwards in the world and downwards in the picture.
    assert (center[1] - float(disc.get("cy") or 0)) / width == pytest.approx(0.75, rel=0.02)


@pytest.mark.slow
def test_a_result_shows_path_ends_and_roadmap() -> None:
    planner = LandmarkPlanner(ROOM, seed=0)
    planner.build(30)
    result = planner.plan((1, 1, 0), (9, 5, 1.57), 60.0, max_iterations=1)
    assert result.path is not None
    colours = set(re.findall(r'(?:fill|stroke)="(#\w+)"', result._repr_svg_()))
    assert {PATH, START, GOAL, OBSTACLE} <= colours
    assert LANDMARK in planner.roadmap._repr_svg_()
    assert f"cost {result.path.cost:.4g}" in result._repr_html_()


@pytest.mark.parametrize("robot", [CAR, Robot.disc(0.3), Robot.polygon([[1, -0.2], [2, -0.2], [2, 0.2]])])
def test_a_robot_shows_itself(robot: Robot) -> None:
    assert parsed(robot._repr_svg_()).find(f".//{SVG}path") is not None
    assert robot.describe() in robot._repr_html_()


def test_names_are_no_markup() -> None:
    queries = (Query("</svg><script>alert(2)</script>", (1, 1, 0), (9, 5, 0)),)
    world = World("<script>alert('1') & more</script>", ROOM.bounds, robot=CAR, queries=queries)
    for text in (world._repr_html_(), world._repr_svg_()):
        parsed(text)
        assert "<script" not in text
        assert "&lt;script&gt;" in text


@pytest.mark.slow
def test_pictures_of_large_worlds_stay_small() -> None:
    rng = np.random.default_rng(0)
    at = rng.uniform(0, 1000, (6000, 2))
    shapes = [Disc((float(x), float(y)), 1.0) for x, y in at[:5000]]
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    shapes += [Polygon(p + rng.uniform(1, 8, (40, 1)) * ring) for p in at[5000:]]  # type: ignore[misc]  # lists
    text = World("large", (0, 0, 1000, 1000), tuple(shapes))._repr_html_()
    assert 10_000 < len(text) < MOST
    assert "outlines are simplified" in text
    parsed(text)


def test_zones_are_drawn() -> None:
    square = np.array([[1, 1], [3, 1], [3, 3], [1, 3]])
    zones = (CostZone(square, 0.5), CostZone(square + 2.0, 5.0), KeepOutZone(square), SpeedZone(square, 0.3))  # type: ignore[arg-type]  # vertices
    text = World("zones", ROOM.bounds, zones=(*zones, OneWayZone(square, 0.0, 0.1)))._repr_svg_()  # type: ignore[arg-type]
    assert {PREFER, AVOID, COLLISION, SPEED, ONE_WAY} <= set(re.findall(r'fill="(#\w+)"', text))


@pytest.mark.slow
def test_a_crowded_roadmap_stays_small() -> None:
    planner = LandmarkPlanner(ROOM, seed=0)
    planner.build(3000)
    assert len(planner.roadmap._repr_svg_()) < MOST


@pytest.mark.parametrize(
    "bounds", [(0, 0, 1, 80), (0, 0, 80, 1), (1e6, 1e6, 1e6 + 20, 1e6 + 12), (0, 0, 1e-3, 6e-4), (-9, -9, -8, -8)]
)
def test_pictures_of_any_shape_and_place(bounds: Any) -> None:
    svg = parsed(World("w", bounds)._repr_svg_())
    assert 20.0 < float(svg.get("width") or 0) < 700.0
    assert 20.0 < float(svg.get("height") or 0) < 700.0


def test_a_result_without_its_world_says_so() -> None:
    result = PlanResult("timeout", None, 0, 1.0, None, None, 0, 0)
    with pytest.raises(ConfigurationError, match="expected a result that knows its world and robot"):
        result.plot()
    assert repr(result) == "PlanResult(timeout)"


@pytest.mark.slow
def test_no_matplotlib_and_nothing_that_plans_for_a_world() -> None:
    program = "import sys; from trailmark import World; World.load('office')._repr_html_(); print([*sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert "'shapely'" in done.stdout
    assert "'matplotlib'" not in done.stdout
    assert "'numba'" not in done.stdout


def test_what_a_picture_says_of_the_cost_is_the_cost_that_was_planned_for() -> None:
    path = Path(np.array([[1.0, 1.0, 0.0], [4.0, 5.0, 1.0]]))
    plain = PlanResult("solved", path, 0, 5.0, 6.0, 0.1, 0, 0, time={"total": 1.0})
    assert plan_facts(plain, CAR).startswith("cost 5.5 = 5 m + 0.5 × 1 rad")
    charged = replace(plain, charged=31.9, objective=Objective.of("clearance"))
    assert plan_facts(charged, CAR).startswith("cost 31.9, 5 m, 1 rad")
