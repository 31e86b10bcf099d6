"""Maps of CARMEN logs from raw odometry and scans: are the poses, the walls and the free way right?

Writes results/relations.{json,md}. The logs' corrected poses are taken away, and the maps made as ``trailmark map``
makes them by its defaults. Then:

- the mean errors of relations between poses, as Kümmerle et al. 2009 define them ("On measuring the accuracy of SLAM
  algorithms", Autonomous Robots 27): consecutive scans, and as many pairs from different visits to a place. Their
  relations were checked by hand; these are made from the corrected poses that a SLAM program (GMapping) put into the
  log, a proxy whose own errors, by their table 0.06 to 0.07 m, count as ours;
- the share of scan end points within 0.15 m of an obstacle's boundary, and of the driven way, looked at every 2 cm, on
  which a disc of 0.2 m meets no obstacle, by shapely from the world's shapes;
- processor time against the drive's duration.

    python -m benchmarks.relations [--logs intel aces csail freiburg-101]
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks.intel import ROBOT, driven_way, end_points, fit
from benchmarks.machine import describe_machine, markdown_table
from benchmarks.suite import data_folder
from trailmark.estimation.logs import load_log
from trailmark.estimation.logs.records import Log, Scan
from trailmark.estimation.maps.log_map import map_log
from trailmark.estimation.maps.map_settings import MapSettings
from trailmark.estimation.scans.clouds import relative
from trailmark.formats.files import write_atomically
from trailmark.se2 import FloatArray

RESULTS = Path(__file__).resolve().parent / "results"
LOGS = ("intel", "aces", "csail", "freiburg-101")
NEAR = 4.0
"""Metres between two scans of different visits to a place."""
VISIT = 20
"""Scans, about a metre apart, from one visit to another."""
TARGETS = {"translation": 0.05, "rotation": 1.0, "explained": 0.97, "free": 0.995, "time": 0.25}


def without_poses(log: Log) -> Log:
    """Return a log whose scans have no poses: as the robot recorded it."""
    records = (record._replace(pose=None) if isinstance(record, Scan) else record for record in log.records)
    return log._replace(records=tuple(records))


def relation_errors(reference: FloatArray, poses: FloatArray) -> dict[str, dict[str, float]]:
    """Return the mean, median and largest errors of relations, in metres and degrees."""
    n = len(reference)
    apart = np.hypot(*(reference[:, None, :2] - reference[None, :, :2]).transpose(2, 0, 1))
    visits = np.argwhere(np.triu(apart < NEAR, VISIT))
    chosen = np.random.default_rng(0).permutation(len(visits))[: n - 1]
    consecutive = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    kinds = {"consecutive": consecutive, "visits": visits[chosen]}
    kinds["all"] = np.concatenate(list(kinds.values()))
    found = {}
    for kind, (a, b) in ((kind, pairs.T) for kind, pairs in kinds.items()):
        error = relative(relative(reference[a], reference[b]), relative(poses[a], poses[b]))
        place, turn = np.hypot(*error[:, :2].T), np.degrees(np.abs(error[:, 2]))
        found[kind] = {
            "relations": len(a),
            **{f"translation_{f.__name__}": float(f(place)) for f in (np.mean, np.median, np.max)},
            **{f"rotation_{f.__name__}": float(f(turn)) for f in (np.mean, np.median, np.max)},
        }
    return found


def run(name: str) -> dict[str, Any]:
    """Map one log and return its figures."""
    log = load_log(data_folder() / "carmen" / f"{name}-corrected.log.gz")
    scans = [record for record in log.records if isinstance(record, Scan)]
    reference = np.array([scan.pose for scan in scans])
    begin = process_time()
    mapped = map_log(without_poses(log), MapSettings(), robot=ROBOT)
    seconds = process_time() - begin
    poses = mapped.trajectory[:, 1:]
    assert mapped.poses == "match"
    figures = {"relations": relation_errors(reference, poses), "seconds": seconds}
    figures |= {
        "duration": float(scans[-1].t - scans[0].t),
        "scans": len(scans),
        "matching": mapped.figures()["matching"],
    }
    figures |= fit(mapped.world, end_points(scans, poses), driven_way(poses))
    stated = map_log(log, MapSettings(poses="log"), robot=ROBOT)
    figures["by_log"] = fit(stated.world, end_points(scans, reference), driven_way(reference))
    return figures


def main() -> int:
    """Map the logs, measure, and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", nargs="+", choices=LOGS, default=LOGS)
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    runs = {}
    for name in options.logs:
        runs[name] = run(name)
        print(name, json.dumps(runs[name]), file=sys.stderr, flush=True)
    table = []
    for name, figures in runs.items():
        errors, stated = figures["relations"], figures["by_log"]
        cells = [
            f"{errors[kind][f'{what}_mean']:.3f}"
            + (f" ({errors[kind][f'{what}_median']:.3f})" if kind == "visits" else "")
            for what in ("translation", "rotation")
            for kind in ("consecutive", "visits", "all")
        ]
        table.append(
            [
                name,
                *cells,
                f"{100 * figures['explained']:.2f} % ({100 * stated['explained']:.2f} %)",
                f"{100 * figures['free']:.2f} % ({100 * stated['free']:.2f} %)",
                f"{figures['matching']['closures']}",
                f"{figures['seconds']:.0f} of {figures['duration']:.0f}",
            ]
        )
    header = ["log", "m, consecutive", "m, visits", "m, all", "deg, consecutive", "deg, visits", "deg, all"]
    header += ["ends explained", "way free", "closures", "s of the drive's"]
    text = markdown_table(header, table)
    print(text)
    reached = all(
        figures["relations"]["all"]["translation_mean"] <= TARGETS["translation"]
        and figures["relations"]["all"]["rotation_mean"] <= TARGETS["rotation"]
        and figures["explained"] >= TARGETS["explained"]
        and figures["free"] >= TARGETS["free"]
        for figures in runs.values()
    )
    if not options.no_write:
        RESULTS.mkdir(exist_ok=True)
        machine = describe_machine()
        write_atomically(RESULTS / "relations.json", json.dumps({"machine": machine, "runs": runs}, indent=1) + "\n")
        lines = [
            *("# Poses and maps from raw odometry and scans", "", "Written by `python -m benchmarks.relations`.", ""),
            *(text, "", "Mean errors of relations (medians in brackets): of consecutive scans, of pairs of scans from"),
            f"different visits to a place (at most {NEAR:g} m apart), and of both. The reference is the log's",
            "corrected poses, a proxy for relations that were checked by hand: its own errors, 0.06 to 0.07 m by",
            "the published table, count as ours. `ends explained`, `way free`: in brackets by the log's corrected",
            "poses. Processor seconds for poses and map; the corrected CSAIL log has its times rounded to 10,000 s.",
            *("", machine),
        ]
        write_atomically(RESULTS / "relations.md", "\n".join(lines) + "\n")
    return 0 if reached else 1


if __name__ == "__main__":
    raise SystemExit(main())
