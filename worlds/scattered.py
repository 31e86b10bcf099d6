"""Worlds of many obstacles at random places."""

from __future__ import annotations

import math
from dataclasses import replace

from blocks import PI, QUARTER, Shape, disc, rect
from dice import Dice, Scatter
from trailmark import Query, Robot, World


def clutter() -> World:
    """200 random polygons, from corner to corner."""
    empty = World(
        name="clutter",
        bounds=(0, 0, 100, 100),
        robot=Robot.rectangle(2.0, 1.0),
        queries=(
            Query("corner", (2.0, 2.0, 0.785), (98.0, 98.0, 0.785)),
            Query("cross", (2.0, 98.0, -0.785), (98.0, 2.0, -0.785)),
            Query("flip", (2.0, 50.0, 3.14), (98.0, 50.0, 3.14)),
        ),
    )
    return replace(empty, obstacles=tuple(_rocks(Dice(200), empty, 200, 1.5, 5.0)))


def field2000() -> World:
    """2,000 trees, rocks and crates, none overlapping, with clearings between the thickets."""
    dice = Dice(2000)
    empty = World(
        name="field2000",
        bounds=(0, 0, 200, 200),
        robot=Robot.rectangle(1.0, 0.6),
        queries=(
            Query("corner", (3.0, 3.0, 0.785), (197.0, 197.0, 0.785)),
            Query("west", (197.0, 100.0, 3.14), (3.0, 100.0, 3.14)),
            Query("centre", (100.0, 100.0, 0.0), (3.0, 197.0, QUARTER)),
        ),
    )
    waves = [(dice(-0.1, 0.1), dice(-0.1, 0.1), dice(0, 2 * PI)) for _ in range(5)]

    def thicket(x: float, y: float) -> bool:
        return sum(math.cos(a * x + b * y + c) for a, b, c in waves) < 1.9

    scatter, obstacles = Scatter(dice, empty, 0.5, 0.45, thicket), list[Shape]()
    while len(obstacles) < 2000:
        radius = dice(0.5, 1.7)
        if place := scatter.place(radius, tries=200):
            kind = dice()
            if kind < 0.4:
                obstacles.append(disc(*place, radius))
            elif kind < 0.6:
                slim, turn = dice(0.3, 1.2), dice(-PI, PI)
                obstacles.append(rect(*place, 2 * radius * math.cos(slim), 2 * radius * math.sin(slim), turn))
            else:
                obstacles.append(dice.rock(*place, radius, dice.whole(4, 7)))
    return replace(empty, obstacles=tuple(obstacles))


def discs() -> World:
    """A round robot among discs of all sizes."""
    empty = World(
        name="discs",
        bounds=(0, 0, 40, 40),
        robot=Robot.disc(0.5),
        queries=(
            Query("corner", (1.2, 1.2, 0.0), (38.8, 38.8, 0.0)),
            Query("cross", (1.2, 38.8, 0.0), (38.8, 1.2, 0.0)),
        ),
    )
    scatter = Scatter(Dice(7), empty, 0.4, 0.3)
    radii = (3.5, 3.0, 2.5, 2.5, *(2.0,) * 6, *(1.4,) * 16, *(0.9,) * 40, *(0.5,) * 70)
    placed = ((r, scatter.place(r)) for r in radii)
    return replace(empty, obstacles=tuple(disc(*place, r) for r, place in placed if place))


def long() -> World:
    """A robot of 4 by 0.5 m that has to go along the gaps."""
    empty = World(
        name="long",
        bounds=(0, 0, 60, 60),
        robot=Robot.rectangle(4.0, 0.5),
        queries=(
            Query("corner", (3.0, 3.0, 0.785), (57.0, 57.0, 0.785)),
            Query("across", (3.0, 57.0, 0.0), (57.0, 3.0, QUARTER)),
        ),
    )
    return replace(empty, obstacles=tuple(_rocks(Dice(5), empty, 160, 1.0, 2.6)))


def _rocks(dice: Dice, empty: World, count: int, low: float, high: float) -> list[Shape]:
    """Polygons of that many sizes between two radii; they may overlap."""
    scatter, rocks = Scatter(dice, empty, 0.5), list[Shape]()
    while len(rocks) < count:
        radius = dice(low, high)
        if place := scatter.place(radius):
            rocks.append(dice.rock(*place, radius, dice.whole(4, 8)))
    return rocks
