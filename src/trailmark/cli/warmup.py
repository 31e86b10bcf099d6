"""``trailmark warmup``: compile all kernels now, so that nothing compiles later."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from trailmark.cli import console
from trailmark.cli.options import JsonOption

__all__ = ["warmup"]

KINDS = {"straight": "any shape", "translation": "discs", "curve": "cars", "differential": "differential drives"}
"""Names of the kinds of motion in those of the stages."""


def warmup(as_json: JsonOption = False) -> None:
    """Compile all kernels now instead of at first use; takes a few minutes, once.

    Kernels compiled before come from the cache; after an interruption the command continues.
    """
    from trailmark.planning.warmup import side_by_side

    begun, before = time.perf_counter(), len(_kept()[0])
    stages = _stages()
    with console.progress("preparing (compiles on first use)") as progress, side_by_side(list(stages.values())):
        for done, (name, warm) in enumerate(stages.items()):
            progress.stage(f"preparing the kernels for {name}")
            progress.done = done, len(stages)
            try:
                warm()
            except KeyboardInterrupt:
                console.warn(f"{done} of {len(stages)} stages are ready; the same command goes on with {name}")
                raise
    seconds, (files, folder) = time.perf_counter() - begun, _kept()
    written, size = len(files) - before, sum(file.stat().st_size for file in files)
    free = shutil.disk_usage(folder).free if folder else 0
    if as_json:
        kept = str(folder) if folder else None
        facts = {"folder": kept, "files": len(files), "written": written, "size": size, "free": free}
        console.say(console.json_text({"kernels": list(stages), "cache": facts, "time": {"total": seconds}}))
        return
    where = "none: no folder can be written to (NUMBA_CACHE_DIR names one)" if folder is None else str(folder)
    sizes = f"{size / 1e6:,.0f} MB, {free / 1e9:,.1f} GB are left on the disk"
    rows = [
        ("cache", where),
        ("kernels", f"{len(files):,}, {f'{written:,}' if written else 'none'} of them new"),
        ("size", sizes),
    ]
    console.show(f"all kernels are ready, in {len(stages)} stages ({seconds:.1f} s)", rows if folder else rows[:1])


def _kept() -> tuple[list[Path], Path | None]:
    """Return the files of machine code that are kept, and their folder; None if there is none."""
    from trailmark.jit import kernel_folder

    folder = kernel_folder()
    return list(folder.rglob("*.nbc")) if folder else [], folder


def _stages() -> dict[str, Callable[[], None]]:
    """Return the stages by name: each part for each kind of motion, and those of no kind."""
    from trailmark.exploration.warmup import warm_up_exploration
    from trailmark.planning.warmup import ROBOTS, warm_up

    parts: dict[str, Callable[[Any], None]] = {
        "planning": warm_up,
        "many queries": partial(warm_up, use="many"),
        "changed worlds": partial(warm_up, use="changes"),
        "moving obstacles": partial(warm_up, use="moving"),
        "grid maps": partial(warm_up, use="grid"),
        "keep-out zones": partial(warm_up, use="leaving"),
        "objectives and zones": partial(warm_up, weighted=True),
        "many queries under objectives": partial(warm_up, use="many", weighted=True),
        "changed worlds under objectives": partial(warm_up, use="changes", weighted=True),
    }
    others = {
        "OMPL's planners": _warm_up_pointwise,
        "maps from logs": _warm_up_logs,
        "exploration": warm_up_exploration,
    }
    # Cars last: a second process begins at the end, and they take about as long as all else.
    kinds = sorted(ROBOTS, key="curve".__eq__)
    stages = {
        f"{part} ({KINDS.get(kind, kind)})": partial(warm, kind) for kind in kinds for part, warm in parts.items()
    }
    return {**others, **stages}


def _warm_up_pointwise() -> None:
    """Run every kernel that answers for one configuration or motion per call."""
    from trailmark.collision import StateChecker
    from trailmark.curves import Steering
    from trailmark.motion.pointwise import CurveMarks, PointwiseChecker
    from trailmark.planning.warmup import ROBOTS, SMALL

    (world, ends), robot = SMALL, ROBOTS["straight"]
    a, b = (tuple(q) for q in ends.tolist())
    for steering in (None, Steering(0.4), Steering(0.4, reverse=False)):
        single = PointwiseChecker(StateChecker(world, robot), steering)
        single.valid(*a)
        single.clearance(*a)
        single.motion_valid(a, b)
        single.step_valid(*a, *b)
        if steering is not None:
            CurveMarks(single)


def _warm_up_logs() -> None:
    """Run every kernel that makes a map from a log, of scans and of detections."""
    import numpy as np

    from trailmark.estimation import Detector, MapSettings, RangeBearing, Scanner, Unicycle, map_log, simulate
    from trailmark.estimation.scan_matching import PointCloud, Window, local_map, match_covariance, search
    from trailmark.shapes import Disc
    from trailmark.world import World

    room = World("room", (0.0, 0.0, 6.0, 4.0), (Disc((2.0, 2.0), 0.2), Disc((4.0, 2.0), 0.2)))
    round_trip = [[1.0, 1.0], [5.0, 1.0], [5.0, 3.0], [1.0, 3.0], [1.0, 1.0]]
    detector, scanner = Detector(RangeBearing(0.05, 0.02)), Scanner(beams=61, period=1.0)
    log, _ = simulate(
        room, round_trip, Unicycle(0.02, 0.02, period=1.0), detector=detector, scanner=scanner, random_state=0
    )
    map_log(log)
    map_log(log, MapSettings(obstacles="detections", fit_noise=True))
    # Scans of a loop, which this log is too short for.
    points = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    area = local_map(PointCloud(points, np.zeros_like(points), np.ones(3)))
    search(area, points, np.zeros(3), Window(0.2, 0.1))
    match_covariance(area, points, np.zeros(3))
