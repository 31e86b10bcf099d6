"""The report of the field of moving discs: table, JSON and picture."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.arena_scene import DISC_RADIUS, SIZE
from benchmarks.machine import describe_machine, markdown_table
from trailmark.formats.files import write_atomically

if TYPE_CHECKING:
    from benchmarks.arena import Drive

__all__ = ["summary", "write_report"]

PICTURED = "disc, 50"

RESULTS = Path(__file__).resolve().parent / "results"

PUBLISHED = ("SMART (published, a point; C++)", "39 of 60", "65 %", "", "", "0.16", "", "", "")
"""A replanner's figures as they were measured on a machine of the same kind; its discs turn in a way of their own."""


def summary(drives: Sequence[Drive]) -> dict[str, Any]:
    """Return the figures of one way to cross the field."""
    looks, replans = (np.array([ms for d in drives for ms in getattr(d, name)]) for name in ("looks", "replans"))
    seconds = [d.seconds for d in drives if d.reached]
    found: dict[str, Any] = {
        "scenes": len(drives),
        "reached": sum(d.reached for d in drives),
        "contacts": sum(d.contact is not None for d in drives),
        "late": sum(not d.reached and d.contact is None for d in drives),
        "seconds": float(np.median(seconds)) if seconds else None,
        "failed": [d.seed for d in drives if not d.reached],
    }
    if len(looks):
        for name, values in (("look", looks), ("replan", replans)):
            found[name] = {str(p): float(np.percentile(values, p)) for p in (50, 95, 99, 100)}
        found["margins"] = np.sum([d.margins for d in drives], axis=0).tolist()
    return found


def write_report(name: str, drives: Sequence[Drive], first_seed: int) -> None:
    """Write table, JSON and picture with one more case."""
    file = RESULTS / "arena.json"
    record: dict[str, Any] = json.loads(file.read_text()) if file.exists() else {"cases": {}}
    record["cases"][name] = summary(drives) | {"first_seed": first_seed, "machine": describe_machine()}
    write_atomically(file, (json.dumps(record, indent=1) + "\n").encode())
    rows = []
    for case, s in record["cases"].items():
        times = [f"{s[kind][p]:.2f}" if kind in s else "" for kind in ("replan", "look") for p in ("50", "95")]
        share = f"{100 * s['reached'] / s['scenes']:.0f} %"
        seconds = "" if s["seconds"] is None else f"{s['seconds']:.1f}"
        rows.append((case, f"{s['reached']} of {s['scenes']}", share, str(s["late"]), seconds, *times))
    header = ("", "reached", "", "too late", "s across", "ms replan", "95 %", "ms look", "95 %")
    table = markdown_table(header, [*rows, PUBLISHED])
    machines = "\n".join(f"- {case}: {s['machine']}" for case, s in record["cases"].items())
    first = min(s["first_seed"] for s in record["cases"].values())
    text = TEXT.format(table=table, machines=machines, first=first)
    write_atomically(RESULTS / "arena.md", text.encode())
    if PICTURED in name:
        _draw(name, drives, RESULTS / "arena.png")


TEXT = """# A field of moving discs

`python -m benchmarks.arena`: 32 x 32 m inside walls, 15 discs of 0.7 m (1 m with the robot's 0.3 m) at 4 m/s, which
bounce off the walls and each take another direction, any, on the mean every 1.5 s (Poisson); a robot from corner to
corner (42.4 m; the disc at 4 m/s, the rectangle of 1.2 x 0.8 m at 2 m/s). It sees the discs' places alone. Scenes
from {first} on; the program's choices were made on others (0 to 59). Contact is judged in continuous time by code of
its own (`benchmarks/arena_scene.py`); who takes more than 60 s is too late. Who stands has reached if nothing met it.

The program foresees each disc for 1.2 s (the rectangle 2 s) at the velocity between the last two looks, with bounces,
0.6 m larger than it is; where no path is found, 0.25 m and 0.05 m larger. *replan* is the time in `update` and
`replan(speed=...)` at one look, retries included; *look* that from the discs' places to the path, with the making of
the world's obstacles. Times are the thread's own (the machine runs other programs too); the first look, which takes up
the model of what stands, counts as well. The robot moves as if all that took no time.

{table}

![Paths of the disc](arena.png)

{machines}
"""


def _draw(name: str, drives: Sequence[Drive], path: Path) -> None:
    """Draw the robot's paths across the field, and the discs at the end of one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 5.2), layout="constrained")
    axes = figure.add_subplot()
    for d in drives[:60]:
        axes.plot(*d.trace.T, color="tab:blue" if d.reached else "tab:red", lw=0.6, alpha=0.6)
        if d.contact is not None:
            axes.plot(*d.trace[-1], "x", color="tab:red", ms=5)
    for place in drives[0].discs:
        axes.add_patch(_circle(place))
    axes.set(xlim=(0, SIZE), ylim=(0, SIZE), aspect="equal", xlabel="x [m]", ylabel="y [m]", title=name)
    figure.savefig(path, dpi=110, metadata={"Description": describe_machine()})


def _circle(place: np.ndarray) -> Any:
    from matplotlib.patches import Circle

    return Circle((float(place[0]), float(place[1])), DISC_RADIUS, color="0.6", alpha=0.7)
