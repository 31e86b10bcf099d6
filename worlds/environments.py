"""The two environments of the source method, made anew: only what was published about them is kept."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blocks import PI, QUARTER, Shape, box, disc, poly, rect
from dice import Dice, Scatter
from trailmark import Polygon, Query, Robot, World

# Environment 1: the rectangle as published.
XMIN, YMIN, XMAX, YMAX = 5.5001, 10.5481, 46.6007, 117.5

# The curved boundary touches the rectangle here. Counter-clockwise from the lower left corner: (x, y) on the
# rectangle, and how far the boundary bulges inwards between this place and the next; corners are cut off round.
BOTTOM = ((10.2, 0.7), (41.9, 0.0))
RIGHT = ((15.6, 3.1), (38.0, 0.6), (57.0, 2.3), (77.0, 0.7), (112.4, 0.0))
TOP = ((41.5, 0.8), (10.0, 0.0))
LEFT = ((112.0, 0.6), (88.0, 3.5), (67.0, 0.6), (47.0, 1.4), (16.2, 0.0))


def bulge(a: tuple[float, float], b: tuple[float, float], depth: float) -> NDArray[np.float64]:
    """Return a smooth wave from a to b, both on one side of the rectangle, that bulges to the left by ``depth``."""
    t = np.linspace(0.0, 1.0, 25)[:, None]
    along = np.array(b) - np.array(a)
    inwards = np.array([-along[1], along[0]]) / np.hypot(*along)
    return np.asarray(np.array(a) + t * along + depth * np.sin(PI * t) ** 2 * inwards)


def bend(a: tuple[float, float], b: tuple[float, float], corner: tuple[float, float]) -> NDArray[np.float64]:
    """Return a round way from a to b, on two sides of the rectangle, past their corner."""
    t = np.linspace(0.0, PI / 2, 17)[:, None]
    to_a, to_b = np.array(a) - np.array(corner), np.array(b) - np.array(corner)
    return np.asarray(np.array(corner) + to_a * (1 - np.sin(t)) + to_b * (1 - np.cos(t)))


def tenths(points: NDArray[np.float64]) -> Polygon:
    """Return a polygon with coordinates rounded to tenths of millimetres, as the published ones are."""
    return Polygon(np.asarray(np.round(points, 4), dtype=np.float64))


def shore() -> tuple[Polygon, list[Polygon]]:
    """Return the curved boundary, and the ground beyond it in pieces from one touching place to the next."""
    places = [
        *((x, YMIN, depth) for x, depth in BOTTOM),
        *((XMAX, y, depth) for y, depth in RIGHT),
        *((x, YMAX, depth) for x, depth in TOP),
        *((XMIN, y, depth) for y, depth in LEFT),
    ]
    curve, pieces = [], []
    for (ax, ay, depth), (bx, by, _) in zip(places, places[1:] + places[:1], strict=True):
        if depth:
            line = bulge((ax, ay), (bx, by), depth)
            piece = line
        else:
            corner = (ax if ax in (XMIN, XMAX) else bx, ay if ay in (YMIN, YMAX) else by)
            line = bend((ax, ay), (bx, by), corner)
            piece = np.concatenate([line, [corner]])
        curve.append(line[:-1])
        pieces.append(tenths(piece))
    return tenths(np.concatenate(curve)), pieces


def environment1() -> World:
    """The first environment: a curved boundary inside the published rectangle, k = 12.

    Its obstacles' boxes hold 16.8 % of the rectangle, so that 168 of 1,000 uniform points are forbidden on average
    (published: 169, 165 and 171). Algorithm 2 knows obstacles only, and takes the boxes of their readings: so the
    ground beyond the boundary stands among the obstacles too, in pieces.
    """
    boundary, pieces = shore()
    dice = Dice(1)
    return World(
        name="environment1",
        bounds=(XMIN, YMIN, XMAX, YMAX),
        robot=Robot.rectangle(1.6, 1.0),
        boundary=boundary,
        obstacles=(
            *pieces,
            poly(dice.blob(19.0, 31.0, 4.2, 3.0, 28, 0.5)),
            disc(33.5, 41.0, 2.6),
            poly([(14.0, 50.5), (20.5, 52.5), (20.0, 54.5), (13.5, 52.5)]),
            dice.rock(28.5, 58.5, 3.6, 7),
            rect(38.0, 69.5, 6.5, 1.6, 1.1),
            disc(18.0, 76.0, 2.1),
            poly([(24.5, 84.0), (31.5, 84.0), (31.5, 90.0), (29.5, 90.0), (29.5, 86.0), (24.5, 86.0)]),
            poly(dice.blob(21.5, 103.5, 3.4, 2.6, 28, 0.5)),
            disc(37.0, 99.0, 1.65),
        ),
        queries=(
            Query("south-north", (26.0, 16.0, QUARTER), (30.0, 111.0, QUARTER)),
            Query("north-south", (11.5, 97.0, 0.0), (40.0, 30.0, -QUARTER)),
            Query("across", (9.0, 58.0, 0.0), (43.0, 62.0, 0.0)),
        ),
    )


def environment2() -> World:
    """The second environment: many obstacles, which take half of the region once they are grown by the robot, k = 14.

    Among them stands a yard whose four walls leave no way in: its inside is free, but out of reach.
    """
    dice = Dice(1)
    yard = [
        *(box(57.0, 33.0, 69.0, 34.0), box(57.0, 42.0, 69.0, 43.0)),
        *(box(57.0, 33.0, 58.0, 43.0), box(68.0, 33.0, 69.0, 43.0)),
    ]
    empty = World(
        name="environment2",
        bounds=(0, 0, 100, 80),
        robot=Robot.disc(1.2),
        obstacles=tuple(yard),
        queries=(
            Query("corner", (4.0, 4.0, 0.0), (96.0, 76.0, 0.0)),
            Query("cross", (4.0, 76.0, 0.0), (96.0, 4.0, 0.0)),
            Query("middle", (50.0, 4.0, 0.0), (50.0, 76.0, 0.0)),
            Query("west", (96.0, 40.0, 0.0), (4.0, 40.0, 0.0)),
        ),
    )

    def off_the_yard(x: float, y: float) -> bool:
        return not (50.0 < x < 76.0 and 26.0 < y < 50.0)

    scatter, obstacles = Scatter(dice, empty, 1.2, 2.6, off_the_yard), list[Shape]()
    for radius in (*(5.0,) * 6, *(4.0,) * 12, *(3.0,) * 24, *(2.0,) * 50):
        if place := scatter.place(radius):
            kind = dice()
            if kind < 0.3:
                obstacles.append(disc(*place, radius))
            elif kind < 0.55:
                slim, turn = dice(0.5, 1.0), dice(-PI, PI)
                obstacles.append(rect(*place, 2 * radius * math.cos(slim), 2 * radius * math.sin(slim), turn))
            elif kind < 0.8:
                obstacles.append(dice.rock(*place, radius, dice.whole(5, 8)))
            else:
                obstacles.append(poly(dice.blob(*place, 0.75 * radius, 0.75 * radius, 28, 0.4)))
    return replace(empty, obstacles=(*empty.obstacles, *obstacles))
