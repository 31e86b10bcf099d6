"""Laser logs whose odometry is cut out while the robot turns: mapped right, refused, or silently wrong?

A simulated robot drives between random places of worlds that ship and of yards, on the way of which it turns by 80 to
180 degrees where it stands. What the log says of that turn is left out: its odometry, or scans too; to the moment, or
from somewhat before or to somewhat after it. ``trailmark.estimation.map_log`` maps the rest by its defaults. Wrong is a
map that says nothing though its poses err by more than half a metre or ten degrees across the cut. Half of the logs
have velocities, half increments; half of the scanners see all around, half only ahead.

    python -m benchmarks.cuts [--logs 100] [--first 0]
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.report import Claim, keep
from benchmarks.risk import yard
from trailmark import World
from trailmark.estimation import MapSettings, PoseIncrement, Scan, Unicycle, map_log, simulate
from trailmark.estimation.records import Increment, Log, Odometry
from trailmark.estimation.virtual_sensors import Scanner
from trailmark.se2 import between, wrap
from trailmark.world.library import shipped_worlds

FloatArray = NDArray[np.float64]

PLACES = ("office", "warehouse", "factory", "yard")
CLEARANCE = 0.35
"""Metres between the robot's way and what stands there."""

WRONG = 0.5, math.radians(10.0)
"""Metres and radians from which on poses across a cut are wrong."""


class Cut(NamedTuple):
    """A log with a cut, and the truth."""

    log: Log
    turn: float  # Degrees.
    begins: float  # Seconds.
    ends: float
    poses: FloatArray  # Of its scans, shape (m, 3).


def cut_log(seed: int) -> Cut:
    """Return a log with a cut in a turn."""
    rng = np.random.default_rng(seed)
    name = PLACES[seed % len(PLACES)]
    world = yard(rng, "scanner") if name == "yard" else World.load(shipped_worlds()[name])
    way, turned = _way(world, rng)
    velocities, around = bool(seed // 4 % 2), bool(seed // 8 % 2)
    motion = (
        Unicycle(0.02, 0.02, period=1.0) if velocities else PoseIncrement(1e-4, 1e-4, 1e-5, growth=(1e-3, 1e-4, 1e-3))
    )
    scanner = Scanner(
        361 if around else 181,
        (2.0 if around else 1.0) * math.pi,
        12.0,
        sigma=0.015,
        period=float(rng.choice([0.2, 1.0])),
    )
    log, truth = simulate(world, way, motion, scanner=scanner, speed=0.6, turn_rate=0.8, period=0.1, random_state=seed)
    # The turn: where the heading changes and the robot stands.
    at = way[turned]
    standing = np.flatnonzero(np.hypot(*(truth[:, 1:3] - at[:2]).T) < 1e-6)
    begins, ends = truth[standing[0], 0], truth[standing[-1], 0]
    turn = math.degrees(abs(float(wrap(truth[standing[-1], 3] - truth[standing[0], 3]))))
    if rng.integers(2):
        begins, ends = begins - rng.uniform(0.0, 0.5), ends + rng.uniform(0.0, 0.5)
    lost: tuple[type, ...] = (Odometry, Increment, Scan) if rng.integers(2) else (Odometry, Increment)
    kept = tuple(r for r in log.records if not (isinstance(r, lost) and begins <= r.t <= ends))
    times = np.array([record.t for record in kept if isinstance(record, Scan)])
    poses = truth[np.searchsorted(truth[:, 0], times - 1e-9), 1:]
    return Cut(log._replace(records=kept), turn, begins, ends, poses)


def _way(world: World, rng: np.random.Generator) -> tuple[FloatArray, int]:
    """Return places, shape (k, 2) with a turn of 80 to 180 degrees in the middle, and its place."""
    solid = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    free = shapely.box(*world.bounds) if world.boundary is None else world.boundary.shapely()
    free = shapely.buffer(shapely.difference(free, solid), -CLEARANCE)
    shapely.prepare(free)
    low, high = np.array(world.bounds[:2]), np.array(world.bounds[2:])

    def beyond(places: list[FloatArray], least: float, most: float) -> FloatArray | None:
        for _ in range(300):
            place = rng.uniform(low, high)
            length = np.hypot(*(place - places[-1]))
            if not 1.5 < length < 10.0 or not free.covers(shapely.LineString([places[-1], place])):
                continue
            if len(places) > 1:
                (a, b), (c, d) = places[-1] - places[-2], place - places[-1]
                if not least <= abs(math.degrees(math.atan2(a * d - b * c, a * c + b * d))) <= most:
                    continue
            return np.asarray(place)
        return None

    while True:
        places = [rng.uniform(low, high)]
        for k in range(5):
            if not free.covers(shapely.Point(places[0])):
                break
            place = beyond(places, *((80.0, 180.0) if k == 3 else (0.0, 100.0)))
            if place is None:
                break
            places.append(place)
        if len(places) == 6:
            return np.array(places), 3


def judged(cut: Cut) -> tuple[str, str]:
    """Return whether a log is mapped right, refused or wrong, and what was found."""
    mapped = map_log(cut.log, MapSettings(poses="match"))
    own, true = mapped.trajectory[:, 1:], cut.poses
    times = mapped.trajectory[:, 0]
    before, after = np.flatnonzero(times < cut.begins)[-5:], np.flatnonzero(times > cut.ends)[:10]
    error = between(own[before[0]], own[after]) - between(true[before[0]], true[after])
    off, turned = float(np.hypot(*error[:, :2].T).max()), float(np.abs(wrap(error[:, 2])).max())
    right = off <= WRONG[0] and turned <= WRONG[1]
    refused = mapped.world.not_certified is not None
    figure = f"turn of {cut.turn:.0f} degrees: {off:.2f} m and {math.degrees(turned):.1f} degrees off"
    return ("refused" if right else "refused, wrong") if refused else ("right" if right else "WRONG"), figure


def main() -> int:
    """Measure and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    options = parser.parse_args()
    counts = Counter[str]()
    with threadpool_limits(1):
        for seed in range(options.first, options.first + options.logs):
            verdict, figure = judged(cut_log(seed))
            counts[verdict] += 1
            print(seed, verdict, figure, sep=" | ", file=sys.stderr, flush=True)
    found = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
    missed = f"{counts['WRONG']} silently wrong" if counts["WRONG"] else ""
    keep("cuts", [Claim(f"{options.logs} turns without odometry", found, "right or refused", missed)])
    return 0


if __name__ == "__main__":
    sys.exit(main())
