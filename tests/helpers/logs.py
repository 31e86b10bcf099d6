"""Logs for the tests of ``trailmark map``: a simulated drive among posts, a small MRCLAM folder."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

from trailmark import Disc, World
from trailmark.estimation import Detector, Log, RangeBearing, Scanner, Unicycle, simulate

POSTS = [(2.0, 2.2), (5.0, 1.0), (9.5, 1.5), (10.5, 5.0), (7.0, 6.5), (3.0, 6.8), (1.0, 5.0), (6.0, 3.8)]
WAY = [[1.0, 1.0], [8.0, 2.6], [9.0, 5.0], [4.5, 5.3], [2.2, 4.0], [1.2, 1.6], [8.0, 2.4]]
START = f"1,1,{math.atan2(1.6, 7.0)}"  # a drive to waypoints begins towards the second

ODOMETRY = [f"{0.1 * i:.1f} 0.2 {0.1 * math.sin(0.05 * i):.4f}" for i in range(200)]
MEASUREMENTS = [
    f"{0.5 * i + 0.05:.2f} {(25, 63)[i % 2]} {(2.0, 3.0)[i % 2]:.1f} {(0.4, -0.6)[i % 2]:.1f}" for i in range(6)
]
BARCODES = ["6 25", "7 63", "1 5"]


@cache
def recorded(scanner: bool = False) -> Log:
    """Return a drive's log, with detections or scans."""
    world = World("yard", (0.0, 0.0, 12.0, 8.0), tuple(Disc(centre, 0.15) for centre in POSTS))
    detector = None if scanner else Detector(RangeBearing(0.03, 0.01), 7.0, period=1.5)
    eyes = Scanner(beams=121, max_range=9.0, period=2.0) if scanner else None
    motion = Unicycle(0.01, 0.002, period=1.0)
    return simulate(world, WAY, motion, detector=detector, scanner=eyes, period=0.3, random_state=3).log


def write_mrclam(folder: Path) -> None:
    """Write the files of one robot that sees two landmarks."""
    folder.mkdir()
    for name, lines in (
        ("Robot1_Odometry.dat", ["# t v omega", *ODOMETRY]),
        ("Robot1_Measurement.dat", MEASUREMENTS),
        ("Barcodes.dat", BARCODES),
    ):
        (folder / name).write_text("\n".join(lines) + "\n")
