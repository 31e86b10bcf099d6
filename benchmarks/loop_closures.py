"""Drives around simulated blocks of corridors: are loops closed where they are, and are errors as large as stated?

Writes results/loop_closures.{json,md}. A block of 24 by 14 metres has 4 to 13 niches and pillars at random; the robot
drives around it twice, or once and back the other way, with odometry that drifts. How far scans lie apart, how much a
laser sees and how far, and how much odometry drifts are drawn for each drive. From the poses that scan matching finds:

- wrong relations: of those that the final graph counts as right, those that lie more than 0.6 m off the truth;
- the largest error of a place, all places aligned with the truth (which shifts and turns the map as a whole);
- NEES of the places, 2 on average where errors are as large as the covariances say.

    python -m benchmarks.loop_closures [--drives 140]
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from trailmark.estimation.graph.scan_slam import match_scans
from trailmark.estimation.scans.clouds import relative
from trailmark.estimation.simulation.raycast import RayCaster
from trailmark.estimation.simulation.virtual_sensors import Scanner
from trailmark.formats.files import write_atomically
from trailmark.se2 import FloatArray, compose
from trailmark.shapes import Rectangle
from trailmark.world import World

RESULTS = Path(__file__).resolve().parent / "results"
WIDTH, HEIGHT, CORRIDOR = 24.0, 14.0, 2.5
"""Metres."""
WRONG = 0.6
"""Metres by which a relation is off that is wrong: six times the scatter that a match allows for."""
DRIFTS = (0.01, 0.02, 0.04)
"""Metres by which odometry is too long for each metre; its random errors grow along with it."""


def block(rng: np.random.Generator) -> World:
    """Return a block with corridors around it, and boxes at random along their walls."""
    box = Rectangle((0.5 * WIDTH, 0.5 * HEIGHT), WIDTH - 2.0 * CORRIDOR, HEIGHT - 2.0 * CORRIDOR)
    boxes = []
    for _ in range(rng.integers(4, 14)):
        along, deep, outside = rng.uniform(0.3, 2.0), rng.uniform(0.2, 0.7), rng.random() < 0.6
        across = 0.5 * deep if outside else CORRIDOR - 0.3 * deep
        thick = deep if outside else 0.6 * deep
        far = rng.random() < 0.5
        if rng.random() < 0.5:
            x = rng.uniform(3.0, WIDTH - 3.0)
            boxes.append(Rectangle((x, HEIGHT - across if far else across), along, thick))
        else:
            y = rng.uniform(3.0, HEIGHT - 3.0)
            boxes.append(Rectangle((WIDTH - across if far else across, y), thick, along))
    return World("block", (0.0, 0.0, WIDTH, HEIGHT), (box, *boxes))


def drive(apart: float, back: bool) -> FloatArray:
    """Return poses around the block twice, or once and back, shape (n, 3)."""
    m = 0.5 * CORRIDOR
    corners = [[m, m], [WIDTH - m, m], [WIDTH - m, HEIGHT - m], [m, HEIGHT - m], [m, m]]
    corners += corners[-2::-1] if back else corners[1:]
    poses = []
    for a, b in itertools.pairwise(np.array(corners)):
        length = float(np.hypot(*(b - a)))
        poses += [[*(a + s * (b - a) / length), math.atan2(*(b - a)[::-1])] for s in np.arange(0.0, length, apart)]
    return np.array(poses)


def odometry(true: FloatArray, drift: float, rng: np.random.Generator) -> FloatArray:
    """Return odometry along true poses, shape (n, 3)."""
    poses = [true[0]]
    for step in relative(true[:-1], true[1:]):
        sigmas = drift * np.array([1.5, 1.0, 1.0]) * math.sqrt(float(np.hypot(*step[:2])))
        poses.append(compose(poses[-1], step * [1.0 + drift, 1.0, 1.0] + rng.normal(size=3) * sigmas))
    return np.array(poses)


def aligned(places: FloatArray, true: FloatArray) -> FloatArray:
    """Return by how much places err after the turn and the shift that fit the truth best, shape (n, 2)."""
    a, b = true - true.mean(axis=0), places - places.mean(axis=0)
    turn = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = math.cos(turn), math.sin(turn)
    return np.asarray(b @ np.array([[c, -s], [s, c]]) - a)


def run(seed: int) -> dict[str, Any]:
    """Make one drive and return its figures."""
    rng = np.random.default_rng(seed)
    caster = RayCaster(block(rng))
    apart, degrees, reach = (float(rng.choice(c)) for c in ([0.4, 1.0, 1.5, 2.5], [180, 270, 360], [6.0, 10.0, 20.0]))
    back, drift = bool(rng.integers(2)), float(rng.choice(DRIFTS))
    scanner = Scanner(int(degrees), math.radians(degrees), reach, sigma=0.015)
    true = drive(apart, back)
    scans = [scanner.sweep(float(i), pose, caster, rng) for i, pose in enumerate(true)]
    found = match_scans(scans, odometry(true, drift, rng))
    at = true[found.keys]
    wrong = [
        relation
        for relation in found.relations
        if np.hypot(*(relation.pose - relative(at[relation.a], at[relation.b]))[:2]) > WRONG and not relation.certain
    ]
    errors = aligned(found.poses[:, :2], true[:, :2])
    nees = np.einsum("ij,ijk,ik->i", errors, np.linalg.inv(found.covariances[:, :2, :2]), errors)
    return {
        "seed": seed, "apart": apart, "degrees": degrees, "reach": reach, "back": back, "drift": drift,
        "closures": found.closures, "wrong": len(wrong), "error": float(np.hypot(*errors.T).max()),
        "nees": float(nees.mean()),
    }  # fmt: skip


def main() -> int:
    """Drive, measure, and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=140)
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    runs = []
    for seed in range(options.drives):
        runs.append(run(seed))
        print(json.dumps(runs[-1]), file=sys.stderr, flush=True)
    table = []
    for drift in DRIFTS:
        own = [figures for figures in runs if figures["drift"] == drift]
        if not own:
            continue
        error, nees = (np.array([figures[key] for figures in own]) for key in ("error", "nees"))
        table.append(
            [
                f"{100 * drift:g} %",
                f"{len(own)}",
                f"{sum(figures['closures'] for figures in own):,}",
                f"{sum(figures['wrong'] > 0 for figures in own)}",
                f"{np.median(error):.2f}, {error.max():.2f}",
                f"{np.median(nees):.2f}, {nees.max():.1f}",
            ]
        )
    header = ["odometry too long by", "drives", "closures", "drives with wrong ones"]
    header += ["m, largest error: median, most", "NEES: median, most"]
    text = markdown_table(header, table)
    print(text)
    if not options.no_write:
        RESULTS.mkdir(exist_ok=True)
        machine = describe_machine()
        record = json.dumps({"machine": machine, "runs": runs}, indent=1)
        write_atomically(RESULTS / "loop_closures.json", record + "\n")
        lines = [
            *("# Loop closures around blocks of corridors", "", "Written by `python -m benchmarks.loop_closures`.", ""),
            *(text, "", "A wrong relation is one that the final graph counts and that is off by more than"),
            f"{WRONG:g} m. NEES is 2 on average where errors are as large as stated; odometry that is always too long",
            "by more than a few per cent is no random error, as which it counts.",
            *("", machine),
        ]
        write_atomically(RESULTS / "loop_closures.md", "\n".join(lines) + "\n")
    return 1 if any(figures["wrong"] for figures in runs) else 0


if __name__ == "__main__":
    raise SystemExit(main())
