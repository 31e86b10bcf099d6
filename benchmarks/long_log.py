"""Memory and time of a map from a log of very many scans: they must not grow faster than the log.

Writes results/long_log.{json,md}. A robot drives round after round through a hall of 20 by 12 metres with pillars, and
scans it ten times a second with 60 beams; its odometry turns half a degree too far each metre. The log is a CARMEN
file, which ``trailmark map`` reads and maps by its defaults, in a process of its own for each length.

    python -m benchmarks.long_log [--scans 5000 10000]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from trailmark.estimation.simulation.raycast import RayCaster
from trailmark.formats.files import write_atomically
from trailmark.se2 import FloatArray, compose
from trailmark.shapes import Disc, Rectangle
from trailmark.world import World

RESULTS = Path(__file__).resolve().parent / "results"
HALL = World(
    "hall",
    (0.0, 0.0, 20.0, 12.0),
    (Rectangle((10.0, 6.0), 9.0, 4.0), Disc((3.0, 6.0), 0.4), Rectangle((17.5, 11.0), 1.0, 1.5), Disc((8.0, 1.0), 0.3)),
)
BEAMS = 60
RANGE_MAX = 12.0

PROGRAM = """
import json, resource, sys, time
from trailmark.estimation import load_log, map_log
def peak(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
import trailmark.estimation.maps.log_map
begin, figures = time.process_time(), {"start": peak()}
log = load_log(sys.argv[1])
figures |= {"load": peak(), "load_seconds": time.process_time() - begin}
begin, mapped = time.process_time(), map_log(log)
figures |= {"map": peak(), "map_seconds": time.process_time() - begin}
found = mapped.figures()
figures |= {"nodes": found["matching"]["nodes"]}
print(json.dumps(figures))
"""


def rounds(count: int) -> FloatArray:
    """Return true poses at half a metre a second, ten a second, shape (count, 3)."""
    corners = np.array([[2.0, 2.0], [18.0, 2.0], [18.0, 9.5], [2.0, 9.5]])
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*sides.T)
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    way = 0.05 * np.arange(count) % ends[-1]
    side = np.searchsorted(ends, way, side="right") - 1
    places = corners[side] + ((way - ends[side]) / lengths[side])[:, None] * sides[side]
    headings = np.unwrap(np.arctan2(*sides[side].T[::-1]))
    # Corners take a second and a half.
    smooth = np.convolve(np.pad(headings, 7, mode="edge"), np.full(15, 1.0 / 15.0), mode="valid")
    return np.column_stack([places, smooth])


def write_log(path: Path, count: int) -> None:
    """Write the drive's scans, with their poses by odometry."""
    rng, caster, true = np.random.default_rng(0), RayCaster(HALL), rounds(count)
    angles = -0.5 * np.pi + np.pi / (BEAMS - 1) * np.arange(BEAMS)
    odometry = true[0].copy()
    with path.open("w", encoding="utf-8") as file:
        for i, pose in enumerate(true):
            if i:
                step, turn = true[i] - true[i - 1], true[i - 1, 2]
                c, s = np.cos(turn), np.sin(turn)
                moved = np.array([c * step[0] + s * step[1], c * step[1] - s * step[0], step[2]])
                odometry = compose(odometry, np.add(moved, [0.0, 0.0, np.radians(0.5) * np.hypot(*moved[:2])]))
            lengths = caster.distances(pose[:2], pose[2] + angles, RANGE_MAX)
            ranges = np.minimum(np.maximum(lengths + rng.normal(0.0, 0.01, BEAMS), 0.01), RANGE_MAX)
            place = " ".join(f"{v:.6f}" for v in odometry)
            words = " ".join(f"{v:.2f}" for v in ranges)
            file.write(f"FLASER {BEAMS} {words} {place} {place} {0.1 * i:.2f} host {0.1 * i:.2f}\n")


def main() -> int:
    """Measure each length, and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, nargs="+", default=[5_000, 10_000])
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    runs: dict[int, dict[str, Any]] = {}
    for count in options.scans:
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "hall.log"
            write_log(log, count)
            done = subprocess.run([sys.executable, "-c", PROGRAM, str(log)], capture_output=True, text=True, check=True)
        runs[count] = json.loads(done.stdout.splitlines()[-1])
        print(count, runs[count], file=sys.stderr, flush=True)
    table = [
        [
            f"{count:,}",
            f"{figures['load'] - figures['start']:.0f}",
            f"{figures['map'] - figures['load']:.0f}",
            f"{figures['nodes']:,}",
            f"{figures['load_seconds']:.0f} + {figures['map_seconds']:.0f} of {0.1 * count:.0f}",
        ]
        for count, figures in runs.items()
    ]
    header = ["scans", "MB for the log", "MB more to map it", "nodes", "s of the drive's"]
    text = markdown_table(header, table)
    print(text)
    if not options.no_write:
        RESULTS.mkdir(exist_ok=True)
        machine = describe_machine()
        write_atomically(RESULTS / "long_log.json", json.dumps({"machine": machine, "runs": runs}, indent=1) + "\n")
        lines = ["# Long logs of scans", "", "Written by `python -m benchmarks.long_log`.", "", text, "", machine]
        write_atomically(RESULTS / "long_log.md", "\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
