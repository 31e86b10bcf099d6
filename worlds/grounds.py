"""Worlds with a plan of their own: traps, a street, a maze, a warehouse, a lake."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from blocks import PI, QUARTER, Shape, box, disc, frame, placed, poly, rect, ribbon
from dice import Dice, Scatter
from trailmark import Polygon, Query, Robot, World


def trap(x: float, y: float, radius: float, mouth: float, heading: float) -> Polygon:
    """Return a round wall whose ends curl inward and leave a funnel of that half width, open towards ``heading``."""
    open_angle, t = 0.6, np.linspace(0.0, 1.0, 20)[:, None]
    rim = np.array([math.cos(open_angle), math.sin(open_angle)]) * radius
    tangent = np.array([math.sin(open_angle), -math.cos(open_angle)]) * radius * 0.5
    inner = np.array([0.15 * radius, mouth])
    # A cubic Bezier curve from the circle's rim, along its tangent, to the end of the lip.
    a, b, c, d = rim, rim + tangent, inner + np.array([0.75 * radius, 0.0]), inner
    lip = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t**2 * (1 - t) * c + t**3 * d
    angles = np.linspace(open_angle, 2 * PI - open_angle, 60)[1:-1]
    circle = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    line = np.concatenate([lip[::-1], circle, lip * (1, -1)])
    return ribbon(placed(line, x, y, heading), 0.5)


def bugtrap() -> World:
    """Two bug traps: the ways out and in lead through funnels that the straight line to the goal does not show."""
    return World(
        name="bugtrap",
        bounds=(0, 0, 40, 24),
        robot=Robot.rectangle(1.6, 0.8),
        obstacles=(
            trap(11, 12, 8.5, 1.1, PI),
            trap(30.5, 12.5, 6.0, 0.95, 0.0),
            poly([(20.5, 4.0), (24.0, 2.5), (22.5, 6.5)]),
            poly([(20.0, 17.0), (23.5, 18.0), (23.0, 21.5), (20.5, 20.5)]),
            disc(37.5, 3.0, 1.2),
            disc(36.0, 21.5, 1.0),
        ),
        queries=(
            Query("out", (15.5, 12.0, 0.0), (22.0, 12.0, 0.0)),
            Query("into", (22.0, 12.0, 0.0), (27.5, 12.5, 0.0)),
            Query("swap", (15.5, 12.0, 1.57), (27.5, 12.5, -1.57)),
        ),
    )


def car(x: float, y: float, heading: float) -> Polygon:
    """Return a parked car: a rectangle of 4.3 by 1.75 m with rounded corners, the front ones wider."""
    corners = ((1, 1, 0.6), (-1, 1, 0.35), (-1, -1, 0.35), (1, -1, 0.6))
    outline = [
        (sx * (2.15 - r) + r * math.cos(turn), sy * (0.875 - r) + r * math.sin(turn))
        for quarter, (sx, sy, r) in enumerate(corners)
        for turn in (PI / 2 * quarter + PI / 6 * i for i in range(4))
    ]
    return poly(placed(outline, x, y, heading))


def parking() -> World:
    """A street with parallel parking above and bays below; one gap and one bay are free."""
    tilt = (0.03, -0.02, 0.0, 0.02, -0.03, 0.01, -0.01, 0.02)
    above = [car(x, 12.85 + t, t) for x, t in zip((4.0, 9.15, 19.05, 24.2, 29.4, 34.3), tilt, strict=False)]
    bays = [x for x in np.arange(4.0, 37.0, 2.7) if not 25.0 < x < 26.0]
    below = [car(x, 3.3 + 4 * tilt[i % 8], QUARTER * (1 if i % 3 else -1) + tilt[i % 8]) for i, x in enumerate(bays)]
    return World(
        name="parking",
        bounds=(0, 0, 40, 16),
        robot=Robot.rectangle(4.4, 1.8),
        obstacles=(
            box(0, 14.0, 40, 16),
            box(0, 0, 40, 0.8),
            box(0, 0.8, 2.4, 5.4),
            box(37.8, 0.8, 40, 5.4),
            *above,
            *below,
            rect(6.9, 10.8, 5.8, 2.0, 0.02),  # a van stands in the second row, just before the gap
            disc(37.6, 12.9, 0.6),
            poly([(9.5, 7.1), (10.0, 6.8), (17.5, 6.8), (18.0, 7.1), (17.5, 7.4), (10.0, 7.4)]),
        ),
        queries=(
            Query("parallel", (3.2, 7.6, 0.0), (14.1, 12.85, 0.0)),
            Query("bay", (36.5, 9.6, 3.14), (25.6, 3.3, QUARTER)),
            Query("leave", (14.1, 12.85, 0.0), (36.5, 9.6, 0.0)),
            Query("swap", (25.6, 3.3, -QUARTER), (14.1, 12.85, 3.14)),
        ),
    )


def maze() -> World:
    """A maze of 10 by 10 cells with a few loops; 2.7 m lanes between 0.3 m walls."""
    dice, n, pitch, thick = Dice(29), 10, 3.0, 0.3
    closed = {(i, j, side) for i in range(n) for j in range(n) for side in "EN"}
    seen, stack = {(0, 0)}, [(0, 0)]
    while stack:  # depth first: long winding lanes
        i, j = stack[-1]
        near = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        near = [c for c in near if 0 <= c[0] < n and 0 <= c[1] < n and c not in seen]
        if not near:
            stack.pop()
            continue
        k, m = near[dice.whole(0, len(near) - 1)]
        closed.discard((min(i, k), min(j, m), "E" if k != i else "N"))
        seen.add((k, m))
        stack.append((k, m))
    for _ in range(7):  # loops: more than one way through
        closed.discard((dice.whole(0, n - 2), dice.whole(0, n - 2), "EN"[dice.whole(0, 1)]))
    half, size = thick / 2, n * pitch + thick
    walls = frame(size, size, thick)
    for side in "EN":
        for line in range(n - 1):
            cells = [k for k in range(n) if ((line, k, side) if side == "E" else (k, line, side)) in closed]
            while cells:
                end = next((k for k in range(cells[0], n) if k not in cells), n)
                at, low, high = pitch * (line + 1) + half, pitch * cells[0], pitch * end + thick
                walls.append(box(at - half, low, at + half, high))
                if side == "N":
                    walls[-1] = box(low, at - half, high, at + half)
                cells = [k for k in cells if k >= end]
    a, b = half + pitch / 2, half + pitch * (n - 0.5)
    middle = half + 4.5 * pitch
    return World(
        name="maze",
        bounds=(0, 0, size, size),
        robot=Robot.rectangle(1.4, 0.9),
        obstacles=tuple(walls),
        queries=(
            Query("across", (a, a, 0.0), (b, b, 0.0)),
            Query("diagonal", (a, b, 0.0), (b, a, 0.0)),
            Query("centre", (b, b, 3.14), (middle, middle, QUARTER)),
        ),
    )


def warehouse() -> World:
    """Rows of racks with pallets left in the aisles, packing tables, and goods at the loading docks."""
    dice = Dice(7)
    racks = [
        box(x + 2.7 * bay, y + dy, x + 2.7 * bay + 2.6, y + dy + 1.05)
        for y in (12.0 + 4.4 * row for row in range(6))
        for x in (3.5, 22.0, 40.5)
        for bay in range(6)
        for dy in (0.0, 1.15)
    ]
    pallets = [
        *((8.2, 14.8, 0.1), (14.0, 20.1, -0.2), (27.5, 15.7, 0.0), (31.0, 19.2, 1.4), (45.5, 23.7, 0.2)),
        *((50.5, 15.8, 0.0), (10.5, 28.9, 1.6), (47.8, 32.4, 0.1), (29.2, 28.0, 0.2), (29.2, 29.0, -0.1)),
    ]
    conveyor = [(24, 9.4), (24, 4), (36, 4), (36, 9.4), (35, 9.4), (35, 5), (25, 5), (25, 9.4)]
    empty = World(
        name="warehouse",
        bounds=(0, 0, 60, 38),
        robot=Robot.rectangle(1.4, 0.9),
        obstacles=(
            *racks,
            *(disc(x, y, 0.25) for x in (20.85, 39.35) for y in (11.0, 19.8, 28.6, 37.4)),
            *(rect(x, y, 1.2, 0.8, heading) for x, y, heading in pallets),
            *(box(x, 8.2, x + 3.0, 9.2) for x in (6.0, 14.0, 43.0, 51.0)),
            poly(conveyor),
        ),
        queries=(
            Query("pick", (30.0, 7.2, QUARTER), (24.0, 37.0, 0.0)),
            Query("dock", (5.0, 2.2, 0.0), (55.0, 24.1, 0.0)),
            Query("far", (1.8, 36.4, -QUARTER), (57.5, 2.0, 0.0)),
        ),
    )
    goods = list[Shape]()
    for x0, x1 in ((1.0, 23.0), (37.0, 59.0)):
        scatter = Scatter(dice, replace(empty, bounds=(x0, 0.6, x1, 7.0)), 0.6, 0.35)
        places = [place for _ in range(15) if (place := scatter.place(0.73))]
        goods += [rect(*place, 1.2, 0.8, QUARTER * dice.whole(0, 1) + dice(-0.15, 0.15)) for place in places]
    return replace(empty, obstacles=(*empty.obstacles, *goods))


def lake() -> World:
    """A lake with a curved shore, islands and buoys; the robot is a boat with a pointed bow."""
    dice = Dice(12)
    shore = dice.blob(60, 40, 48, 31, 120, 0.3)
    islands = [
        *((36, 48, 8, 5), (60, 30, 6, 9), (82, 50, 9, 4), (52, 58, 4, 3)),
        *((84, 28, 4, 5), (30, 30, 4, 3), (68, 46, 2.5, 2.5)),
    ]
    buoys = [
        *((45, 40), (47, 34), (72, 36), (75, 40), (94, 40), (60, 52)),
        *((44, 24), (73, 24), (23, 38), (98, 46), (66, 60)),
    ]
    return World(
        name="lake",
        bounds=(0, 0, 120, 80),
        robot=Robot.polygon([(-2, -0.8), (0.6, -0.8), (1.6, -0.45), (2.2, 0), (1.6, 0.45), (0.6, 0.8), (-2, 0.8)]),
        boundary=poly(shore),
        obstacles=(
            *(poly(dice.blob(x, y, a, b, 40, 0.45)) for x, y, a, b in islands),
            *(disc(x, y, 0.6) for x, y in buoys),
        ),
        queries=(
            Query("ferry", (18.0, 40.0, 0.0), (104.0, 38.0, 0.0)),
            Query("cove", (64.0, 64.0, 3.14), (58.0, 17.0, 3.14)),
        ),
    )
