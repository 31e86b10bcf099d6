"""Worlds of walls and rooms, laid out by hand."""

from __future__ import annotations

import math

from blocks import PI, QUARTER, Shape, box, disc, frame, mm, ngon, placed, poly, rect, ribbon, wall
from trailmark import CostZone, KeepOutZone, OneWayZone, Polygon, Query, Robot, SpeedZone, World


def office() -> World:
    """Rooms along a corridor, with desks, chairs, plants and round columns."""
    return World(
        name="office",
        bounds=(0, 0, 20, 12),
        robot=Robot.rectangle(0.6, 0.4),
        obstacles=(
            *frame(20, 12, 0.15),
            *wall((0.15, 5.0), (19.85, 5.0), 0.15, (5.4, 6.4), (8.0, 9.0), (14.6, 17.4)),
            *wall((0.15, 7.0), (19.85, 7.0), 0.15, (2.9, 3.9), (5.2, 6.2), (12.9, 13.9), (15.2, 16.2)),
            *wall((7.0, 0.15), (7.0, 4.925), 0.15, (3.5, 4.5)),
            *wall((13.0, 0.15), (13.0, 4.925), 0.15),
            *wall((4.5, 7.075), (4.5, 11.85), 0.15),
            *wall((9.0, 7.075), (9.0, 11.85), 0.15, (10.3, 11.3)),
            *wall((14.5, 7.075), (14.5, 11.85), 0.15),
            # Open-plan room: two pairs of desks, chairs, a bookshelf, plants.
            *(box(x, y, x + 1.6, y + 0.75) for x in (2.0, 4.2) for y in (1.85, 2.6)),
            *(disc(x, y, 0.24) for x, y in ((2.7, 1.5), (3.0, 3.75), (5.1, 1.4), (4.9, 3.7))),
            box(0.15, 2.2, 0.5, 4.6),
            disc(6.5, 0.6, 0.3),
            disc(0.45, 0.45, 0.2),
            # Kitchen: an L-shaped counter, two round tables with stools.
            poly([(9.4, 0.15), (12.925, 0.15), (12.925, 3.4), (12.3, 3.4), (12.3, 0.8), (9.4, 0.8)]),
            *(disc(x, y, 0.5) for x, y in ((8.1, 1.4), (10.8, 3.2))),
            *(disc(x, y, 0.18) for x, y in ((8.75, 1.75), (7.55, 0.95), (10.2, 3.6), (11.3, 2.65), (11.4, 3.6))),
            # Lobby: a curved reception desk, a sofa, two columns.
            ribbon(ngon(18.7, 1.9, 1.4, 1.4, 24, 1.2)[2:15], 0.5),
            disc(18.4, 1.8, 0.24),
            poly([(13.4, 0.5), (15.6, 0.5), (15.6, 1.2), (14.1, 1.2), (14.1, 2.8), (13.4, 2.8)]),
            disc(15.2, 3.4, 0.3),
            disc(17.9, 4.3, 0.25),
            # Corridor: a column by the wall, plants, a trolley left in the way.
            disc(10.6, 6.6, 0.3),
            disc(1.2, 5.4, 0.25),
            disc(19.4, 6.6, 0.25),
            rect(12.1, 5.6, 0.9, 0.5, 0.35),
            # Two small offices.
            box(1.2, 10.4, 2.8, 11.2),
            disc(2.0, 10.05, 0.24),
            box(0.15, 7.6, 0.6, 9.6),
            disc(4.0, 11.3, 0.28),
            poly([(6.6, 11.85), (6.6, 11.1), (7.4, 11.1), (7.4, 10.3), (8.1, 10.3), (8.1, 11.85)]),
            disc(6.9, 10.55, 0.24),
            rect(7.3, 8.3, 1.5, 0.75, 0.5),
            disc(7.5, 7.7, 0.24),
            box(4.575, 9.2, 4.95, 11.0),
            # Meeting room: an oval table with chairs, a whiteboard.
            poly(ngon(11.7, 9.4, 1.5, 0.75, 32)),
            *(disc(x, y, 0.22) for x in (10.8, 11.7, 12.6) for y in (8.45, 10.35)),
            *(disc(x, 9.4, 0.22) for x in (10.0, 13.4)),
            box(10.6, 11.7, 12.8, 11.85),
            # Workshop: benches, a column, the dock that the robot charges at.
            box(19.1, 7.6, 19.85, 9.4),
            rect(15.7, 10.6, 1.6, 0.8, QUARTER - 0.2),
            disc(16.45, 10.3, 0.24),
            disc(17.2, 8.6, 0.3),
            box(17.7, 11.6, 18.3, 11.85),
        ),
        queries=(
            Query("door", (1.0, 1.0, 0.0), (18.0, 10.0, 1.57)),
            Query("meeting", (0.9, 6.2, 0.0), (13.6, 11.2, 3.14)),
            Query("coffee", (3.7, 9.8, -1.57), (11.6, 1.4, 0.0)),
        ),
    )


def corridor() -> World:
    """A hospital ward: a corridor narrowed by fire doors, rooms with beds, a trolley that just turns in it."""
    up = [(3.0, 3.9), (8.6, 9.5), (15.4, 16.3), (21.1, 22.0), (27.0, 27.9)]
    down = [(1.2, 2.1), (7.8, 8.7), (13.2, 14.1), (21.0, 21.9), (25.4, 26.3)]
    furniture = list[Shape]()
    for i in range(5):
        middle = 6.0 * i + 3.0
        for y, side in ((7.8, 1), (1.2, -1)):  # beds stand against the outer walls, every third room has a desk
            furniture.append(rect(middle - 1.6 + 0.2 * (i % 2), y, 0.95, 2.0))
            furniture.append(rect(middle + 0.125, y + side * 0.75, 0.45, 0.4))
            if (2 * i + side) % 3:
                furniture.append(rect(middle + 1.5, y, 0.95, 2.0))
            else:
                furniture.append(rect(middle + 1.7, y + side * 0.5, 1.6, 0.8))
                furniture.append(disc(middle + 1.6, y - side * 0.2, 0.24))
    return World(
        name="corridor",
        bounds=(0, 0, 30, 9),
        robot=Robot.rectangle(1.0, 0.65),
        obstacles=(
            *frame(30, 9, 0.1),
            *wall((0.1, 5.3), (29.9, 5.3), 0.15, *up),
            *wall((0.1, 3.7), (29.9, 3.7), 0.15, *down),
            *(part for x in (6, 12, 18, 24) for part in wall((x, 5.375), (x, 8.9), 0.15)),
            *(part for x in (6, 12, 18, 24) for part in wall((x, 0.1), (x, 3.625), 0.15)),
            # Fire doors leave 0.85 m of the corridor's 1.45 m.
            *(box(x, low, x + 0.2, high) for x in (11.9, 19.4) for low, high in ((3.775, 4.075), (4.925, 5.225))),
            *furniture,
            box(23.0, 3.775, 23.9, 4.2),
            disc(11.5, 5.8, 0.2),
            disc(28.9, 3.2, 0.22),
            disc(4.6, 2.7, 0.2),
            disc(0.45, 4.5, 0.2),
        ),
        queries=(
            Query("end", (1.6, 4.5, 0.0), (28.9, 4.5, 0.0)),
            Query("ward", (3.0, 6.6, -1.57), (27.3, 2.6, 1.57)),
            Query("across", (8.4, 2.8, 1.57), (9.4, 6.6, 1.57)),
            Query("turn", (17.0, 4.5, 0.0), (17.0, 4.5, 3.14)),
        ),
    )


def lshape() -> World:
    """An L-shaped robot (2 m arms) that threads a 1.3 m doorway and turns where there is room."""
    return World(
        name="lshape",
        bounds=(0, 0, 20, 12),
        robot=Robot.polygon([(-0.5, -0.5), (1.5, -0.5), (1.5, 0.0), (0.0, 0.0), (0.0, 1.5), (-0.5, 1.5)]),
        obstacles=(
            *frame(20, 12, 0.2),
            *wall((6.2, 0.2), (6.2, 11.8), 0.3, (5.4, 6.7)),
            box(13.0, 0.2, 13.3, 4.7),
            box(13.0, 7.0, 13.3, 11.8),
            box(13.3, 4.4, 17.0, 4.7),
            box(13.3, 7.0, 17.0, 7.3),
            disc(9.6, 9.4, 0.9),
            rect(9.4, 2.4, 1.8, 1.0, 0.4),
            rect(2.0, 10.2, 2.2, 1.2),
            disc(1.6, 1.6, 0.6),
        ),
        queries=(
            Query("thread", (3.0, 6.0, 0.0), (9.6, 6.0, 0.0)),
            Query("turn", (15.0, 5.35, 0.0), (15.6, 6.35, 3.14)),
            Query("park", (3.0, 3.5, 1.57), (18.3, 9.6, 3.14)),
        ),
    )


def enclosed() -> World:
    """Goals that cannot be reached: a vault, a room whose door is too narrow, a ring of posts too close together."""
    vault = [(15.0, 9.2), (21.5, 9.2), (22.6, 11.0), (21.5, 14.4), (15.0, 14.4), (14.0, 12.0)]
    inside = [(15.4, 9.7), (21.2, 9.7), (22.1, 11.1), (21.1, 13.9), (15.3, 13.9), (14.5, 12.0)]
    return World(
        name="enclosed",
        bounds=(0, 0, 24, 16),
        robot=Robot.rectangle(0.9, 0.6),
        obstacles=(
            poly(vault, [inside]),
            *(disc(x, y, 0.3) for x, y in ngon(5.5, 11.5, 2.6, 2.6, 17)),
            *wall((13.85, 1.0), (22.15, 1.0), 0.3),
            *wall((13.85, 6.0), (22.15, 6.0), 0.3),
            *wall((14.0, 1.15), (14.0, 5.85), 0.3, (3.3, 3.85)),
            *wall((22.0, 1.15), (22.0, 5.85), 0.3),
            rect(17.5, 3.0, 1.6, 0.8, 0.4),
            disc(20.3, 12.6, 0.6),
            rect(9.6, 4.6, 2.0, 1.0, 0.9),
            disc(11.2, 8.6, 0.8),
            poly([(3.4, 5.0), (5.6, 4.2), (6.4, 6.2), (4.8, 7.2)]),
            disc(9.8, 14.2, 0.5),
        ),
        queries=(
            Query("infeasible", (2.0, 2.0, 0.0), (18.0, 11.6, 0.0)),
            Query("infeasible-door", (2.0, 2.0, 0.0), (20.2, 3.6, 1.57)),
            Query("infeasible-posts", (5.5, 11.5, 0.0), (11.5, 2.0, 0.0)),
        ),
    )


def narrow() -> World:
    """Three passages, 1.4, 1.2 and 1.05 times as wide as the robot; the second one is slanted."""
    slope, half = math.tan(0.5), 0.6 * 0.8 / math.cos(0.5)
    left, right = 5.6 - 1.25 * slope, 5.6 + 1.25 * slope
    return World(
        name="narrow",
        bounds=(0, 0, 24, 12),
        robot=Robot.rectangle(1.2, 0.8),
        obstacles=(
            box(5.0, 0, 6.0, 8.0),
            box(5.0, 8.0 + 1.12, 6.0, 12),
            poly([(10.5, 0), (13.0, 0), (13.0, right - half), (10.5, left - half)]),
            poly([(10.5, left + half), (13.0, right + half), (13.0, 12), (10.5, 12)]),
            box(18.0, 0, 20.0, 3.0),
            box(18.0, 3.84, 20.0, 12),
            disc(3.2, 4.6, 0.7),
            rect(8.0, 2.4, 1.4, 0.8, 0.7),
            disc(15.8, 8.6, 0.8),
        ),
        queries=(
            Query("first", (1.6, 2.0, 0.0), (8.2, 8.6, 0.0)),
            Query("second", (8.2, 8.6, 0.0), (15.6, 4.6, 0.0)),
            Query("third", (15.6, 4.6, 1.57), (22.2, 9.0, 1.57)),
            Query("all", (1.6, 2.0, 1.57), (22.2, 9.0, 3.14)),
        ),
    )


def gate() -> World:
    """A castle: a ring wall with towers, a keep with a gate, a cloister with two courtyards."""
    west, east = (18.0, 34.5, 1.2), (36.5, 31.5, 0.4)  # where the cloister and the keep stand
    cloister = [(-7, -5), (7, -5), (7, 5), (-7, 5)]
    yards = [[(-6, -4), (-1.5, -4), (-1.5, 4), (-6, 4)], [(-0.5, -4), (6, -4), (6, 4), (-0.5, 4)]]
    outer = [(1, -6), (6, -6), (6, 6), (-6, 6), (-6, -6), (-1, -6)]
    inner = [(-1, -5), (-5, -5), (-5, 5), (5, 5), (5, -5), (1, -5)]
    hedges = [(0.95, -2.6), (4.55, -2.6), (0.95, 2.6), (4.55, 2.6)]
    houses = [
        *((24.0, 14.5, 0.3), (31.0, 12.0, 0.05), (15.0, 22.0, 1.0)),
        *((47.0, 31.0, 1.5), (30.0, 46.5, -0.1), (39.5, 45.0, -0.6)),
    ]
    wells = [
        (25.5, 48.5, 0.7),
        (47.5, 24.0, 0.7),
        (46.0, 39.0, 0.7),
        (36.0, 50.0, 0.7),
        (11.5, 25.5, 0.7),
        (30.5, 20.5, 0.9),
    ]
    trees = [(4.0, 8.0), (55.5, 53.0), (54.0, 5.0), (7.0, 56.0), (3.2, 3.0), (57.0, 9.5)]
    return World(
        name="gate",
        bounds=(0, 0, 60, 60),
        robot=Robot.rectangle(1.6, 1.0),
        obstacles=(
            poly(ngon(30, 30, 26.2, 26.2, 12, PI / 12), [ngon(30, 30, 24.4, 24.4, 12, PI / 12)]),
            *(disc(x, y, 2.0) for x, y in ngon(30, 30, 25.2, 25.2, 12, PI / 12)),
            poly(placed(cloister, *west), [placed(yard, *west) for yard in yards]),
            *(disc(x, y, 0.6) for x, y in placed([(2.75, 0.0)], *west)),
            *(rect(x, y, 1.6, 0.5, west[2]) for x, y in placed(hedges, *west)),
            poly(placed(outer + inner, *east)),
            *(disc(x, y, 1.3) for x, y in placed([(1.8, 2.2)], *east)),
            *(rect(x, y, 4.5, 3.0, heading) for x, y, heading in houses),
            poly([(40.0, 16.0), (45.0, 19.0), (44.0, 20.7), (40.7, 18.7), (39.0, 21.5), (37.3, 20.5)]),
            *(disc(*well) for well in wells),
            *(disc(x, y, 1.2) for x, y in trees),
        ),
        queries=(
            Query("keep", (20.0, 50.0, -0.7), _inside(east, -2.5, 1.0, 0.0)),
            Query("cloister", _inside(west, 0.4, 0.0, QUARTER), _inside(west, 5.1, 0.0, -QUARTER)),
            Query("moat", (2.0, 30.0, QUARTER), (58.0, 30.0, -QUARTER)),
        ),
    )


def _inside(building: tuple[float, float, float], x: float, y: float, heading: float) -> tuple[float, float, float]:
    """Return a configuration given in a building's frame in the world frame."""
    (place,) = placed([(x, y)], *building)
    return mm(place[0]), mm(place[1]), mm(building[2] + heading)


def factory() -> World:
    """A factory floor with zones: two one-way aisles, a cell to keep out of, a footway to avoid, a slow crossing."""
    racks = (box(5, 2.5, 19, 4), box(5, 6, 19, 8), box(5, 10, 19, 11.5))

    def zone(x0: float, y0: float, x1: float, y1: float) -> Polygon:
        return poly([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])

    return World(
        name="factory",
        bounds=(0, 0, 26, 14),
        robot=Robot.rectangle(0.9, 0.6),
        obstacles=(*racks, disc(23.2, 12.0, 0.8), rect(23.2, 9.8, 1.2, 0.8)),
        queries=(
            Query("deliver", (2.0, 5.0, 0.0), (23.0, 5.0, 0.0)),
            Query("return", (23.0, 5.0, PI), (2.0, 5.0, PI)),
        ),
        zones=(
            OneWayZone(zone(5, 4, 19, 6), 0.0, 1.0),
            OneWayZone(zone(5, 8, 19, 10), PI, 1.0),
            KeepOutZone(poly([(21.5, 8.5), (25.5, 8.5), (25.5, 13.5), (21.5, 13.5)])),
            CostZone(zone(5, 0.5, 19, 2.5), 4.0),
            SpeedZone(zone(19.5, 3.5, 21, 10.5), 0.3),
        ),
    )
