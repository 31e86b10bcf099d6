"""A world from the Intel lab's laser scans: does it fit them, and is it free where the robot was?

Writes results/intel.{json,md}. The map is made twice: from the poses that a SLAM program put into the log, and from
the raw odometry alone. Figures are taken by shapely from the world's shapes, not from the grid that made them:

- the share of scan end points within 0.15 m of an obstacle's boundary;
- the share of the driven way, looked at every 2 cm, on which a disc of 0.2 m meets no obstacle;
- paths between all pairs of rooms that the robot visited: by LandmarkPlanner, and some by ``trailmark plan``.

A room is a part of the free space that is left when it is cut off wherever a disc of 0.45 m does not fit, and that the
robot was in.

    python -m benchmarks.intel [--time-limit 2] [--commands 5]
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.oracle import Oracle, motion_states
from benchmarks.suite import data_folder
from trailmark.errors import TrailmarkError
from trailmark.estimation.logs import load_log
from trailmark.estimation.logs.records import Log, Scan
from trailmark.estimation.maps.map_settings import MappingSettings
from trailmark.estimation.maps.scan_map import ScanMap, map_scans
from trailmark.estimation.risk.allocation import regrow
from trailmark.estimation.scans.scan_features import find_features
from trailmark.formats.files import write_atomically
from trailmark.planning import LandmarkPlanner
from trailmark.se2 import transform, wrap
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

RESULTS = Path(__file__).resolve().parent / "results"

ROBOT = Robot.disc(0.2)
NEAR = 0.15
"""Metres from an obstacle's boundary within which an end point counts as explained."""
SETTINGS = {"log": MappingSettings(pose_memory=2.0), "odometry": MappingSettings()}
"""How the log's poses err is measured: see :func:`residual_memory`. Errors of raw odometry never end."""
ROOM_RADIUS = 0.45
"""Metres: where a disc of this radius does not fit, rooms end."""
ROOM_AREA = 0.5
"""Square metres that a room has at least, for the centre of that disc."""

FloatArray = NDArray[np.float64]


def end_points(scans: list[Scan], poses: FloatArray) -> FloatArray:
    """Return where beams met something, in the world, shape (n, 2); the log's mounts are all zero."""
    points = []
    for scan, (x, y, theta) in zip(scans, poses, strict=True):
        assert scan.mount == (0.0, 0.0, 0.0)
        met = scan.ranges < scan.range_max
        angles = theta + scan.angle_min + scan.angle_increment * np.flatnonzero(met)
        points.append([x, y] + scan.ranges[met][:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))
    return np.concatenate(points)


def driven_way(poses: FloatArray, step: float = 0.02) -> FloatArray:
    """Return places along the straight lines between the poses, shape (n, 2)."""
    parts = [poses[:1, :2]]
    for a, b in itertools.pairwise(poses[:, :2]):
        n = max(1, int(np.ceil(np.hypot(*(b - a)) / step)))
        parts.append(a + np.linspace(0.0, 1.0, n + 1)[1:, None] * (b - a))
    return np.concatenate(parts)


def distances(geometries: NDArray[np.object_], points: FloatArray) -> FloatArray:
    """Return each point's distance to the nearest geometry, shape (n,)."""
    tree = shapely.STRtree(geometries)
    _, distance = tree.query_nearest(shapely.points(points), return_distance=True, all_matches=False)
    return np.asarray(distance)


def fit(world: World, ends: FloatArray, way: FloatArray) -> dict[str, float]:
    """Return how well a world explains the end points and leaves the way free."""
    solid = np.array([shape.polygon(1e-4).shapely() for shape in world.obstacles])
    return {
        "explained": float((distances(shapely.boundary(solid), ends) <= NEAR).mean()),
        "free": float((distances(solid, way) >= 0.2).mean()),
    }


def rooms(world: World, poses: FloatArray, cell: float = 0.1) -> FloatArray:
    """Return one pose for each room that the robot visited, the one with the most space about it, shape (k, 3)."""
    solid = np.array([shape.polygon(1e-3).shapely() for shape in world.obstacles])
    xmin, ymin, xmax, ymax = world.bounds
    x, y = np.arange(xmin, xmax, cell) + 0.5 * cell, np.arange(ymin, ymax, cell) + 0.5 * cell
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    wide = (distances(solid, centres) >= ROOM_RADIUS).reshape(len(y), len(x))
    labels, count = ndimage.label(wide)
    place = ((poses[:, :2] - [xmin, ymin]) / cell).astype(int)
    visited = labels[place[:, 1], place[:, 0]]
    clearance = distances(solid, poses[:, :2])
    found = []
    for label in range(1, count + 1):
        inside = np.flatnonzero(visited == label)
        if len(inside) and (labels == label).sum() * cell**2 >= ROOM_AREA:
            found.append(poses[inside[clearance[inside].argmax()]])
    return np.array(found).reshape(-1, 3)


def paths_between(world: World, ends: FloatArray, time_limit: float) -> dict[str, Any]:
    """Return how many pairs of rooms are joined by a path that the referee lets pass, and what failed."""
    planner, oracle = LandmarkPlanner(world, ROBOT, seed=0), Oracle(world, ROBOT)
    solved, times, failures = 0, [], []
    for i, j in itertools.combinations(range(len(ends)), 2):
        begin = perf_counter()
        try:
            result = planner.plan(ends[i], ends[j], time_limit=time_limit)
        except TrailmarkError as error:
            failures.append(f"{i}-{j}: {error}")
            continue
        times.append(perf_counter() - begin)
        if result.path is None:
            failures.append(f"{i}-{j}: {result.status}")
            continue
        states = result.path.states
        if oracle.collides(motion_states(states[:-1], states[1:], 100).reshape(-1, 3)).any():
            failures.append(f"{i}-{j}: collides")
        else:
            solved += 1
    pairs = len(ends) * (len(ends) - 1) // 2
    return {"pairs": pairs, "solved": solved, "median_s": float(np.median(times or [np.nan])), "failures": failures}


def residual_memory(scans: list[Scan], found: ScanMap) -> dict[str, float]:
    """Return how alike the errors of two sightings of a wall are, by the metres that were driven in between.

    A sighting's error is how far its line passes from the wall, at the middle of what was seen; the wall is the mean
    of its sightings, which takes their number's inverse off each correlation.
    """
    seen: list[list[tuple[float, float]]] = [[] for _ in range(found.walls)]
    estimates = found.world.estimates[: found.walls]
    walls = [e.mean for e in estimates if e is not None and isinstance(e.mean, Rectangle)]
    rows = np.array([(*wall.center, wall.heading, wall.length, wall.width) for wall in walls])
    normals = np.column_stack([np.sin(rows[:, 2]), -np.cos(rows[:, 2])])
    driven = np.cumsum(np.hypot(*np.diff(found.poses[:, :2], axis=0, prepend=found.poses[:1, :2]).T))
    for scan, pose, way in zip(scans, found.poses, driven, strict=True):
        points, features = find_features(scan)
        for fit in features.lines:
            middle = transform(pose, points.points[fit.indices].mean(axis=0)[None])[0]
            off = middle - rows[:, :2]
            across = np.einsum("ij,ij->i", off, normals)
            along = np.abs(off[:, 0] * normals[:, 1] - off[:, 1] * normals[:, 0])
            # A wall's normal points at who sees it; its front is half its width from its middle.
            error = across - 0.5 * rows[:, 4]
            turned = np.abs(wrap(fit.line[1] + pose[2] + 0.5 * np.pi - rows[:, 2]))
            near = np.flatnonzero((np.abs(error) < 0.1) & (along < 0.5 * rows[:, 3]) & (turned < 0.2))
            if len(near):
                best = near[np.abs(error[near]).argmin()]
                seen[best].append((way, float(error[best])))
    bins = (0.0, 0.2, 1.0, 2.0, 5.0, 20.0, np.inf)
    sums, counts, squares = np.zeros(len(bins) - 1), np.zeros(len(bins) - 1), list[float]()
    for own in (np.array(one) for one in seen if len(one) >= 10):
        errors = own[:, 1] - own[:, 1].mean()
        a, b = np.triu_indices(len(own), 1)
        place = np.digitize(np.abs(own[a, 0] - own[b, 0]), bins) - 1
        np.add.at(sums, place, errors[a] * errors[b])
        np.add.at(counts, place, 1.0)
        squares += (errors**2).tolist()
    variance = float(np.mean(squares))
    named = {f"{low:g} to {high:g} m": sums[i] / counts[i] for i, (low, high) in enumerate(itertools.pairwise(bins))}
    return {"sigma": variance**0.5} | {name: float(value / variance) for name, value in named.items()}


def commands(world: World, ends: FloatArray, count: int) -> tuple[int, int]:
    """Run ``trailmark plan`` on some pairs of rooms; return how many found a path, and how many were run."""
    solved, rng = 0, np.random.default_rng(0)
    pairs = list(itertools.combinations(range(len(ends)), 2))
    chosen = rng.permutation(len(pairs))[:count]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "intel.yaml"
        world.save(file)
        for k in chosen:
            start, goal = (",".join(repr(float(v)) for v in ends[end]) for end in pairs[k])
            program = [sys.executable, "-m", "trailmark.cli", "plan", str(file), "--robot", "disc:0.2", "--json"]
            done = subprocess.run(
                [*program, f"--start={start}", f"--goal={goal}", "--time-limit", "5"], capture_output=True, text=True
            )
            solved += done.returncode == 0 and json.loads(done.stdout)["status"] == "solved"
    return solved, len(chosen)


def run(log: Log, source: str, confidence: float | None) -> tuple[ScanMap, dict[str, Any]]:
    """Return a map and its figures."""
    begin = perf_counter()
    found = map_scans(log, source, settings=SETTINGS[source], robot=ROBOT)
    seconds = perf_counter() - begin
    world = found.world if confidence is None else regrow(found.world, confidence)
    scans = [record for record in log.records if isinstance(record, Scan)]
    figures = fit(world, end_points(scans, found.poses), driven_way(found.poses))
    counted = len([e for e in world.estimates if e is not None]) - found.walls - found.discs
    figures |= {"seconds": seconds, "walls": found.walls, "discs": found.discs, "heaps": counted}
    return found._replace(world=world), figures


def main() -> int:
    """Make the maps, measure them, plan, and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--time-limit", type=float, default=2.0)
    parser.add_argument("--commands", type=int, default=5)
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    log = load_log(data_folder() / "carmen" / "intel-corrected.log.gz")
    table, record = [], dict[str, Any](machine=describe_machine(), runs={})
    ends: FloatArray | None = None
    for source, confidence in (("log", None), ("log", 0.9), ("log", 0.99), ("odometry", None)):
        found, figures = run(log, source, confidence)
        name = f"{source}, {'as measured' if confidence is None else f'grown for {confidence:g}'}"
        if ends is None:
            # The same places for all maps from the log's poses.
            ends = rooms(found.world, found.poses)
            scans = [entry for entry in log.records if isinstance(entry, Scan)]
            record["memory"] = residual_memory(scans, found)
            figures["commands"] = commands(found.world, ends, options.commands)
        if source == "log":
            figures |= paths_between(found.world, ends, options.time_limit)
        record["runs"][name] = figures
        solved = f"{figures['solved']}/{figures['pairs']}" if source == "log" else ""
        table.append(
            [
                name,
                f"{100 * figures['explained']:.2f} %",
                f"{100 * figures['free']:.2f} %",
                solved,
                f"{figures['median_s']:.2f}" if source == "log" else "",
                "{walls} + {discs} + {heaps}".format(**figures),
                f"{figures['seconds']:.1f}",
            ]
        )
        for failure in figures.get("failures", ()):
            print(name, failure, file=sys.stderr)
    header = [
        "poses, obstacles",
        f"ends within {NEAR} m",
        "way free",
        "rooms joined",
        "s a path",
        "walls + discs + heaps",
        "s to map",
    ]
    text = markdown_table(header, table)
    print(text)
    count = 0 if ends is None else len(ends)
    first = record["runs"]["log, as measured"]
    memory = ", ".join(f"{name} {value:.2f}" for name, value in record["memory"].items() if name != "sigma")
    memory = (
        f"errors of walls' sightings: {record['memory']['sigma']:.3f} m; their correlation by metres driven: {memory}"
    )
    print(memory)
    print(f"trailmark plan: {first['commands'][0]} of {first['commands'][1]} paths between rooms found")
    reached = first["explained"] >= 0.95 and first["free"] >= 0.99 and first["solved"] == first["pairs"]
    reached = reached and first["commands"][0] == first["commands"][1]
    if not options.no_write:
        RESULTS.mkdir(exist_ok=True)
        write_atomically(RESULTS / "intel.json", json.dumps(record, indent=1) + "\n")
        lines = ["# Intel lab", "", "Written by `python -m benchmarks.intel`.", "", text, ""]
        lines += [
            f"`trailmark plan` found {first['commands'][0]} of {first['commands'][1]} paths between rooms.",
            "`ends`: scan end points that near an obstacle's boundary; `way free`: the driven way, for a disc of",
            f"0.2 m; `rooms joined`: pairs of the {count} rooms that the robot visited; `log`: corrected poses;",
            "`odometry`: raw odometry alone, judged in its own frame. Grown worlds keep their distance from what was",
            f"seen on purpose. {options.time_limit:g} s a path.",
            "",
            f"{memory[0].upper()}{memory[1:]}. So poses more than",
            f"{SETTINGS['log'].pose_memory:g} m of driving apart are taken to err independently (`pose_memory`).",
            "",
            record["machine"],
        ]
        write_atomically(RESULTS / "intel.md", "\n".join(lines) + "\n")
    return 0 if reached else 1


if __name__ == "__main__":
    raise SystemExit(main())
