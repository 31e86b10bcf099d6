"""A robot that crosses a field of discs which are as fast as it is and change direction at random.

A field of 32 x 32 m inside walls, with 15 discs of 0.7 m that move at 4 m/s, bounce off the walls and each take another
direction at random, on the mean every 1.5 s (:mod:`benchmarks.arena_scene`); a robot that crosses it from corner to
corner. It sees where the discs are, so many times a second, and nothing else. From the last two looks the program
estimates velocities; it takes each disc to go on like that, and off the walls, for a while, and to be larger than it
is, since it may turn. Then it asks the planner, by :meth:`~trailmark.LandmarkPlanner.update` and
:meth:`~trailmark.LandmarkPlanner.replan` with the robot's speed, for the path to follow until the next look; if there
is none with the discs so large, with smaller ones. Without any it takes the steps that stay clear the longest. The
program's choices are in :class:`Choices`; they were made on scenes 0 to 59, which are not among those judged.

Compared are, on the same scenes: the straight path without a look; a robot that stands at the start for as long; and
replanning at each look with all that the discs sweep taken for occupied, standing still while there is no path.

Writes results/arena.{md,json,png}; a case that is run again takes the place of what is there of it.

    python -m benchmarks.arena [--scenes N] [--first-seed SEED] [--case NAME ...] [--no-write]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from itertools import pairwise
from time import thread_time

import numpy as np

from benchmarks.arena_report import summary, write_report
from benchmarks.arena_scene import DISC_RADIUS, SIZE, Leg, Scene, first_contact
from trailmark import Disc, LandmarkPlanner, Path, Rectangle, Robot, World
from trailmark.moving import Moving
from trailmark.se2 import FloatArray, distance, interpolate

__all__ = ["CASES", "Case", "Choices", "Drive", "drive", "foreseen"]

LIMIT = 60.0
"""Seconds after which a robot that has not arrived has failed."""

CORNER = 1.0
"""Metres from the walls to where the robot starts and to its goal."""

FIRST_SEED = 1_000
"""Of the scenes that are judged."""


@dataclass(frozen=True)
class Choices:
    """What the program chooses.

    Attributes:
        hertz: looks per second.
        horizon: seconds for which a disc is foreseen.
        margins: metres by which the discs are taken to be larger; the first with which a path is found counts.
        time_limit: seconds for one path.
    """

    hertz: float = 50.0
    horizon: float = 1.2
    margins: tuple[float, ...] = (0.6, 0.25, 0.05)
    time_limit: float = 0.02


@dataclass(frozen=True)
class Case:
    """A robot and how it gets across.

    Attributes:
        robot: footprint.
        speed: metres per second.
        how: ``in time`` passes the discs in time; ``swept`` avoids what they sweep; ``straight`` does not look;
            ``standing`` stays.
        choices: of the program.
        scenes: as many of the scenes at most.
    """

    robot: Robot
    speed: float
    how: str = "in time"
    choices: Choices = Choices()
    scenes: int = 200


DISC, BOX = Robot.disc(0.3), Robot.rectangle(1.2, 0.8)
# A robot half as fast as the discs has to give way earlier.
EARLY = Choices(horizon=2.0)

CASES = {
    "disc, 50 looks a second": Case(DISC, 4.0),
    "disc, straight on": Case(DISC, 4.0, "straight"),
    "disc, standing at the start": Case(DISC, 4.0, "standing"),
    "disc, 20 looks a second": Case(DISC, 4.0, choices=Choices(hertz=20.0), scenes=60),
    "rectangle, 50 looks a second": Case(BOX, 2.0, choices=EARLY, scenes=60),
    "disc, what is swept is occupied": Case(
        DISC, 4.0, "swept", Choices(hertz=20.0, horizon=0.6, margins=(0.25, 0.05)), scenes=40
    ),
}


@dataclass(frozen=True)
class Drive:
    """What became of one scene.

    Attributes:
        seed: of the scene.
        reached: whether the robot arrived without contact.
        contact: seconds until contact; None if there was none.
        seconds: until it arrived, or until contact, or the limit.
        looks: processor milliseconds that each look took, from the discs' places to the path.
        replans: processor milliseconds of each look in the planner, for updates and replanning.
        margins: looks by the margin that a path was found with, the last without any path.
        trace: where the robot was at the looks, shape (n, 2).
        discs: where the discs were at the last of them, shape (k, 2).
    """

    seed: int
    reached: bool
    contact: float | None
    seconds: float
    looks: list[float]
    replans: list[float]
    margins: list[int]
    trace: FloatArray
    discs: FloatArray


def foreseen(before: FloatArray, now: FloatArray, interval: float, horizon: float, margin: float) -> dict[str, Moving]:
    """Return the discs as they are taken to go on, by name: each one up to the wall, and one that comes back from it.

    Args:
        before: centres at the look before, shape (k, 2), metres.
        now: centres now.
        interval: seconds between the two.
        horizon: seconds.
        margin: metres.
    """
    found = {}
    low, high = DISC_RADIUS, SIZE - DISC_RADIUS
    for k, ((x, y), (vx, vy)) in enumerate(zip(now.tolist(), ((now - before) / interval).tolist(), strict=True)):
        disc = Disc((x, y), DISC_RADIUS + margin)
        wall_x, wall_y = (high if vx > 0.0 else low), (high if vy > 0.0 else low)
        to_x = (wall_x - x) / vx if vx != 0.0 else horizon
        to_y = (wall_y - y) / vy if vy != 0.0 else horizon
        found[f"disc-{k}"] = Moving(disc, (vx, vy), max(1e-3, min(horizon, to_x, to_y)))
        # After a bounce it moves as its mirror image beyond the wall does all along.
        if to_x < min(horizon, to_y):
            found[f"image-{k}"] = Moving(replace(disc, center=(2.0 * wall_x - x, y)), (-vx, vy), horizon)
        elif to_y < horizon:
            found[f"image-{k}"] = Moving(replace(disc, center=(x, 2.0 * wall_y - y)), (vx, -vy), horizon)
    return found


class Driver:
    """The program: finds the path to follow from look to look.

    Args:
        case: robot and choices.
        ends: start and goal, shape (2, 3).
    """

    def __init__(self, case: Case, ends: FloatArray) -> None:
        self.case, self.goal, self.path = case, ends[1], Path(ends)
        self.planner = LandmarkPlanner(World("arena", (0.0, 0.0, SIZE, SIZE)), case.robot, seed=0)
        self.margins = [0] * (len(case.choices.margins) + 1)
        self.planning = 0.0

    def look(self, here: FloatArray, before: FloatArray, now: FloatArray) -> Path | None:
        """Return the path to follow until the next look; None to stand still."""
        choices, planner = self.case.choices, self.planner
        speed = self.case.speed if self.case.how == "in time" else None
        nearest, self.planning = None, 0.0
        for i, margin in enumerate(choices.margins):
            obstacles = foreseen(before, now, 1.0 / choices.hertz, choices.horizon, margin)
            world = planner.world.edited(remove=range(len(planner.world.obstacles)), add=obstacles)
            begin = thread_time()
            planner.update(world)
            result = planner.replan(here, self.goal, self.path, time_limit=choices.time_limit, speed=speed)
            self.planning += thread_time() - begin
            if result.path is not None:
                self.path = result.path
                self.margins[i] += 1
                return self.path
            nearest = nearest or result.nearest
        self.margins[-1] += 1
        return nearest if self.case.how == "in time" else None


def drive(seed: int, case: Case) -> Drive:
    """Drive a robot through one scene and judge it."""
    heading = np.pi / 4.0
    ends = np.array([[CORNER, CORNER, heading], [SIZE - CORNER, SIZE - CORNER, heading]])
    scene, interval = Scene(seed, (CORNER, CORNER), LIMIT + 1.0), 1.0 / case.choices.hertz
    seconds = float(distance(*ends)) / case.speed
    if case.how in ("straight", "standing"):
        goal = ends[1] if case.how == "straight" else ends[0]
        contact = first_contact(scene, [Leg(0.0, seconds, ends[0], goal)], *_body(case.robot))
        met = contact if contact < np.inf else None
        return Drive(seed, met is None, met, seconds, [], [], [], ends[:, :2], scene.at(seconds))
    driver, here, time, before = Driver(case, ends), ends[0], 0.0, scene.at(0.0)
    looks, replans, trace, contact = [], [], [here[:2]], np.inf
    while time < LIMIT and contact == np.inf and not np.array_equal(here, ends[1]):
        time += interval
        now = scene.at(time)
        begin = thread_time()
        path = driver.look(here, before, now)
        looks.append(1e3 * (thread_time() - begin))
        replans.append(1e3 * driver.planning)
        legs = followed(here if path is None else path.states, time, interval, case.speed)
        contact, here, before = first_contact(scene, legs, *_body(case.robot)), legs[-1].b, now
        trace.append(here[:2])
    reached = contact == np.inf and np.array_equal(here, ends[1])
    met = contact if contact < np.inf else None
    return Drive(seed, bool(reached), met, met or time, looks, replans, driver.margins, np.array(trace), before)


def _body(robot: Robot) -> tuple[tuple[float, float], float]:
    """Return half of a rectangle's sides and 0, or zeros and a disc's radius, metres."""
    if isinstance(robot.footprint, Rectangle):
        return (0.5 * robot.footprint.length, 0.5 * robot.footprint.width), 0.0
    return (0.0, 0.0), robot.circumradius


def followed(states: FloatArray, time: float, interval: float, speed: float) -> list[Leg]:
    """Return the robot's motions along a path's states, (n, 3) or (3,), for an interval; at its end it stands."""
    legs, end = [], time + interval
    states = np.atleast_2d(states)
    for a, b in pairwise(states):
        span = float(distance(a, b)) / speed
        if time + span > end:
            legs.append(Leg(time, end, a, interpolate(a, b, (end - time) / span)))
            return legs
        legs.append(Leg(time, time + span, a, b))
        time += span
    return [*legs, Leg(time, end, states[-1], states[-1])]


def main() -> None:
    """Drive through all scenes in each way, and write the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--case", choices=list(CASES), action="append")
    parser.add_argument("--no-write", action="store_true")
    options = parser.parse_args()
    for name in options.case or CASES:
        case = CASES[name]
        drive(0, case)  # what is loaded or compiled at first is loaded now
        seeds = range(options.first_seed, options.first_seed + min(options.scenes, case.scenes))
        drives = [drive(seed, case) for seed in seeds]
        print(f"{name}: {summary(drives)}", flush=True)
        if not options.no_write:
            write_report(name, drives, options.first_seed)


if __name__ == "__main__":
    main()
