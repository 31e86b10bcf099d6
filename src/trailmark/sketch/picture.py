"""Pictures of scenes as SVG, to scale and of a limited size, and as HTML with a line of facts.

The picture brings its own light ground, so that it reads the same in dark notebooks; it has attributes instead of a
style sheet, which would reach beyond it into the page.
"""

# Tested by tests/sketch/test_sketch.py.
from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING

import numpy as np
import shapely

from trailmark import se2
from trailmark.goals import goals_of
from trailmark.shapes import Polygon
from trailmark.sketch.colours import (
    AVOID,
    BODY,
    COLLISION,
    EDGE,
    GOAL,
    LANDMARK,
    OBSTACLE,
    ONE_WAY,
    OUTSIDE,
    PATH,
    PREFER,
    SPEED,
    START,
    TEXT,
)
from trailmark.sketch.frame import VERTEX, FloatArray, Frame, inside_of
from trailmark.sketch.scene import Scene
from trailmark.sketch.svg import coordinate, element
from trailmark.world import Robot, World
from trailmark.zones import CostZone

if TYPE_CHECKING:
    from trailmark.path import Path
    from trailmark.roadmap import Roadmap

__all__ = ["html_of", "svg_of"]

WIDEST, TALLEST = 560.0, 480.0
"""Of a picture, in pixels of a notebook."""

LIMIT = 150_000
"""Characters that a world's obstacles take at most; outlines are simplified where they would take more."""

MAX_EDGES, MAX_LANDMARKS = 3000, 2000
"""Of a roadmap that are drawn: evenly chosen ones, where there are more."""

MAX_BODIES, MAX_QUERIES, MAX_ZONES = 24, 12, 200
ZONES = {"cost": AVOID, "keep-out": COLLISION, "one-way": ONE_WAY, "speed": SPEED}
SMALL = 5.0
"""Pixels: a smaller robot gets a mark of that radius at its start and goal."""


def svg_of(scene: Scene) -> str:
    """Return a scene as an SVG document of some hundred kB at most."""
    body = scene.robot
    if scene.world is not None:
        frame = Frame.around(scene.world.bounds, 0.02, WIDEST, TALLEST)
        parts = _world(frame, scene.world)
    else:
        assert body is not None  # noqa: S101  # a scene has a world or a robot
        xmin, ymin, xmax, ymax = (float(v) for v in body.outline.shapely().bounds)
        around = (min(xmin, 0.0), min(ymin, 0.0), max(xmax, 0.0), max(ymax, 0.0))
        frame = Frame.around(around, 0.15, 0.5 * WIDEST, 0.4 * TALLEST)
        parts = _end(frame, body, np.zeros(3), PATH)
    if scene.roadmap is not None:
        parts += _roadmap(frame, scene.roadmap)
    if scene.path is not None:
        parts += _path(frame, scene.path, body)
    for start, goal in _ends(scene):
        parts += [] if start is None else _end(frame, body, np.array(start), START)
        for q in goal:
            parts += _end(frame, body, q, GOAL)
    width, height = frame.size
    ground = element("rect", x=-6, y=-6, width=width + 12.0, height=height + 38.0, rx=4, fill="#ffffff")
    box = f"-6 -6 {coordinate(width + 12.0)} {coordinate(height + 38.0)}"
    ruler = element(
        "g",
        "".join(frame.ruler(fill="none", stroke=TEXT)),
        fill=TEXT,
        font_size=11,
        font_family="sans-serif",
    )
    return element(
        "svg",
        element("title", escape(f"{scene.title}: {scene.facts}")) + ground + "".join(parts) + ruler,
        xmlns="http://www.w3.org/2000/svg",
        viewBox=box,
        width=width + 12.0,
        height=height + 38.0,
        role="img",
        style="max-width:100%;height:auto",
    )


def html_of(scene: Scene) -> str:
    """Return a scene as HTML: its picture, and its title and facts in the page's own colours below it."""
    words = element("b", escape(scene.title)) + escape(f" · {scene.facts}{_omissions(scene)}")
    caption = element("figcaption", words, style="font-size:90%;margin-top:2px")
    return element("figure", svg_of(scene) + caption, style="margin:4px 0")


def _world(frame: Frame, world: World) -> list[str]:
    """Return what lies outside, free space, and obstacles."""
    width, height = frame.size
    parts = [element("rect", width=width, height=height, fill=OUTSIDE)]
    parts.append(element("path", d=frame.region([inside_of(world)]), fill="#ffffff", stroke=OBSTACLE))
    parts.append(frame.obstacles(world.obstacles, 0.25, OBSTACLE, LIMIT))
    for zone in sorted(world.zones, key=lambda zone: -zone.region.area)[:MAX_ZONES]:
        colour = PREFER if isinstance(zone, CostZone) and zone.factor < 1.0 else ZONES[zone.kind]
        data = frame.region([zone.region.shapely()])
        parts.append(element("path", d=data, fill=colour, fill_opacity="0.3", stroke=colour))
    return parts


def _omissions(scene: Scene) -> str:
    """Return what a picture leaves out, for its caption."""
    left_out = []
    world, roadmap = scene.world, scene.roadmap
    if world is not None:
        vertices = sum(len(shape.vertices) if isinstance(shape, Polygon) else 4 for shape in world.obstacles)
        left_out += ["outlines are simplified"] if VERTEX * vertices > LIMIT else []
        if scene.queries and len(world.queries) > MAX_QUERIES:
            left_out.append(f"{MAX_QUERIES} of {len(world.queries):,} queries are drawn")
        if len(world.zones) > MAX_ZONES:
            left_out.append(f"{MAX_ZONES} of {len(world.zones):,} zones are drawn")
    if roadmap is not None and (len(roadmap) > MAX_LANDMARKS or np.count_nonzero(roadmap.certified) > MAX_EDGES):
        left_out.append("some of its landmarks and edges are drawn")
    return "".join(f" · {words}" for words in left_out)


def _roadmap(frame: Frame, roadmap: Roadmap) -> list[str]:
    """Return certified edges and landmarks, the first of each kind chosen evenly where there are too many."""
    q, edges = roadmap.configurations, roadmap.edges[roadmap.certified]
    edges = edges[:: max(1, math.ceil(len(edges) / MAX_EDGES))]
    lines = roadmap.motion.lines(q[edges[:, 0]], q[edges[:, 1]]) if len(edges) else np.empty((0, 2, 2))
    data = "".join(frame.line(line) for line in lines)
    at = np.round(frame.at(q[:: max(1, math.ceil(len(q) / MAX_LANDMARKS)), :2]), 1)
    dots = "".join(f"M{coordinate(x)} {coordinate(y)}h0" for x, y in at.tolist())
    width = 0.8 if len(edges) < MAX_EDGES / 4 else 0.4
    return [
        element("path", d=data, fill="none", stroke=EDGE, stroke_width=width),
        element("path", d=dots, stroke=LANDMARK, stroke_width=2.5, stroke_linecap="round"),
    ]


def _path(frame: Frame, path: Path, robot: Robot | None) -> list[str]:
    """Return the robot along a path, and the path."""
    parts = []
    if robot is not None:
        count = min(MAX_BODIES, max(4, math.ceil(path.cost / (2.0 * robot.circumradius)))) + 1
        bodies = frame.bodies(robot, path.at(np.linspace(0.0, 1.0, count)))
        parts.append(element("path", d=bodies, fill=BODY, fill_opacity="0.7", stroke=PATH, stroke_width=0.5))
    data = frame.line(path.states[:, :2])
    for colour, width in (("#ffffff", 4), (PATH, 2)):
        parts.append(element("path", d=data, fill="none", stroke=colour, stroke_width=width, stroke_linejoin="round"))
    return parts


def _ends(scene: Scene) -> list[tuple[tuple[float, float, float] | None, list[FloatArray]]]:
    """Return starts, each with the goals that are shown for it."""
    pairs = [(scene.start, scene.goal)]
    if scene.queries and scene.world is not None:
        pairs += [(query.start, query.goal) for query in scene.world.queries[:MAX_QUERIES]]
    shown = []
    for start, goal in pairs:
        goals = goals_of(goal)
        if goals is not None:
            seen = np.array(start if scene.path is None or start is None else scene.path.states[-1])
            shown.append((start, [one.nearest(seen)[0] for one in goals]))
        else:
            shown.append((start, [] if goal is None else [np.array(goal)]))
    return shown


def _end(frame: Frame, robot: Robot | None, q: FloatArray, colour: str) -> list[str]:
    """Return a robot at a configuration (3,), with a line along its heading, and a dot where it would be too small."""
    parts = []
    reach = 0.0 if robot is None else robot.circumradius
    if robot is not None:
        parts.append(element("path", d=frame.bodies(robot, q[None]), fill=colour, fill_opacity="0.45", stroke=colour))
        if robot.sweep_radius > 0.0 and reach * frame.scale > SMALL:
            front = shapely.LineString([(0.0, 0.0), (reach, 0.0)]).intersection(robot.outline.shapely())
            tip = reach if front.is_empty else front.bounds[2]
            heading = frame.line(se2.transform(q, [(0.0, 0.0), (tip, 0.0)]))
            parts.append(element("path", d=heading, stroke=colour, stroke_width=2, fill="none"))
    x, y = frame.at(q[None, :2])[0].tolist()
    radius = SMALL if reach * frame.scale <= SMALL else 0.6 * SMALL
    parts.append(element("circle", cx=x, cy=y, r=radius, fill=colour, stroke="#ffffff"))
    return parts
