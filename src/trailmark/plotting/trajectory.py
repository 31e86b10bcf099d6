"""A robot along its trajectory: as an animation, or as a page of its own with a slider."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from trailmark.colours import BODY, GOAL, OBSTACLE, OUTSIDE, PATH, START, TEXT
from trailmark.errors import OutputError, expected_name
from trailmark.plotting.animation import Frame, save_animation
from trailmark.plotting.canvas import picture_of, view
from trailmark.shapes import Disc

if TYPE_CHECKING:
    from trailmark.se2 import FloatArray
    from trailmark.shapes import Polygon
    from trailmark.trajectories import Trajectory
    from trailmark.world import Robot, World

__all__ = ["save_trajectory_animation"]

FRAME_SECONDS, MAX_FRAMES = 0.1, 150
"""Of a GIF: how long a frame is shown; a longer drive is shown faster than it is."""

MAX_PLACES = 1500
"""Rows of time and configuration in a page, which joins them by straight lines."""

TOLERANCE = 0.005
"""Metres by which a disc's outline in a page may lie off it."""


def save_trajectory_animation(file: str | FilePath, trajectory: Trajectory, world: World, robot: Robot) -> None:
    """Write a robot's drive, whole or not at all: a GIF, or one HTML file with a slider that needs no other.

    Args:
        file: ends in ``.gif`` or ``.html``.
        trajectory: that is driven.
        world: around it.
        robot: that drives.

    Raises:
        OutputError: another suffix, a file that cannot be written, or one that the world was read from.
    """
    target = picture_of(world, file)
    suffix = target.suffix.lower()
    if suffix == ".html":
        from trailmark.formats.files import write_atomically

        write_atomically(target, _page(trajectory, world, robot))
    elif suffix == ".gif":
        count = int(np.clip(np.ceil(trajectory.duration / FRAME_SECONDS), 1, MAX_FRAMES)) + 1
        t = np.linspace(0.0, trajectory.duration, count)
        speed = np.hypot(*trajectory.velocity(t)[:, :2].T)
        frames = (
            Frame(world, q, trajectory.path, f"{now:.1f} s, {pace:.2f} m/s")
            for now, q, pace in zip(t, trajectory.at(t), speed, strict=True)
        )
        save_animation(target, frames, robot, trajectory.path.states[-1], seconds=FRAME_SECONDS)
    else:
        raise OutputError(f"{file}: suffix: {expected_name(suffix, ('.gif', '.html'))}")


def _page(trajectory: Trajectory, world: World, robot: Robot) -> str:
    xmin, ymin, xmax, ymax = view(world)
    west, south, east, north = world.bounds
    inside = f"M{west} {south}H{east}V{north}H{west}Z" if world.boundary is None else _outline(world.boundary)
    obstacles = "".join(
        _outline(shape.polygon(TOLERANCE) if isinstance(shape, Disc) else shape.polygon()) for shape in world.obstacles
    )
    zones = "".join(_outline(zone.region) for zone in world.zones)
    t = np.union1d(
        np.linspace(0.0, trajectory.duration, MAX_PLACES // 2),
        trajectory.t[:: max(1, 2 * len(trajectory.t) // MAX_PLACES)],
    )
    q, speed = trajectory.at(t), np.hypot(*trajectory.velocity(t)[:, :2].T)
    rows = np.column_stack([t, q[:, :2], np.unwrap(q[:, 2]), speed])
    decimals = max(3, int(np.ceil(3.0 - np.log10(max(xmax - xmin, ymax - ymin, 1e-9)))) + 2)
    return (
        _PAGE.replace("@name@", escape(world.name))
        .replace("@view@", f"{xmin:g} {-ymax:g} {xmax - xmin:g} {ymax - ymin:g}")
        .replace("@inside@", inside)
        .replace("@obstacles@", obstacles)
        .replace("@zones@", zones)
        .replace("@path@", _line(trajectory.path.states[:, :2]))
        .replace("@robot@", _line(robot.outline.vertices) + "Z")
        .replace("@nose@", f"{0.5 * robot.circumradius:g}")
        .replace("@rows@", json.dumps(np.round(rows, decimals).tolist(), separators=(",", ":")))
    )


def _line(points: FloatArray) -> str:
    return "M" + "L".join(f"{x:.6g} {y:.6g}" for x, y in points.tolist())


def _outline(polygon: Polygon) -> str:
    return "".join(f"{_line(np.asarray(ring))}Z" for ring in (polygon.vertices, *polygon.holes))


_PAGE = f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="trailmark">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>@name@</title>
<style>
body {{ font: 15px sans-serif; color: {TEXT}; margin: 1em; }}
svg {{ display: block; width: 100%; max-height: 82vh; background: {OUTSIDE}; }}
svg path, svg line {{ vector-effect: non-scaling-stroke; }}
form {{ display: flex; gap: 1em; align-items: center; margin-top: .8em; }}
input {{ flex: 1; }} output {{ min-width: 15em; font-variant-numeric: tabular-nums; }}
</style></head><body>
<svg viewBox="@view@" role="img" aria-label="The robot along its trajectory"><g transform="scale(1,-1)">
<path d="@inside@" fill="white"/><path d="@obstacles@" fill="{OBSTACLE}" fill-rule="evenodd"/>
<path d="@zones@" fill="{GOAL}" fill-opacity=".08" stroke="{GOAL}" stroke-dasharray="6 4"/>
<path d="@path@" fill="none" stroke="{PATH}" stroke-width="2"/>
<g id="start"><path d="@robot@" fill="none" stroke="{START}" stroke-width="2"/></g>
<g id="goal"><path d="@robot@" fill="none" stroke="{GOAL}" stroke-width="2"/></g>
<g id="robot"><path d="@robot@" fill="{BODY}" stroke="{PATH}" stroke-width="2"/>
<line x2="@nose@" stroke="{PATH}" stroke-width="2"/></g>
</g></svg>
<form onsubmit="return false"><button id="play" type="button">Play</button>
<input id="time" type="range" min="0" step="any" value="0" aria-label="Time"><output id="says"></output></form>
<script>
const rows = @rows@, end = rows[rows.length - 1][0];
const time = document.getElementById("time"), play = document.getElementById("play");
time.max = end;
function at(t) {{
  let low = 0, high = rows.length - 1;
  while (high - low > 1) {{ const k = (low + high) >> 1; if (rows[k][0] <= t) low = k; else high = k; }}
  const a = rows[low], b = rows[high], f = b[0] > a[0] ? Math.min(1, (t - a[0]) / (b[0] - a[0])) : 0;
  return a.map((value, k) => value + f * (b[k] - value));
}}
function put(id, row) {{
  const place = `translate(${{row[1]}} ${{row[2]}}) rotate(${{row[3] * 180 / Math.PI}})`;
  document.getElementById(id).setAttribute("transform", place);
}}
function show() {{
  const row = at(+time.value);
  put("robot", row);
  const now = `${{(+time.value).toFixed(1)}} of ${{end.toFixed(1)}} s`;
  document.getElementById("says").value = `${{now}}, ${{row[4].toFixed(2)}} m/s`;
}}
let before = null;
function step(now) {{
  if (before === null) return;
  time.value = +time.value + (now - before) / 1000;
  before = now;
  show();
  if (+time.value >= end) stop(); else requestAnimationFrame(step);
}}
function stop() {{ before = null; play.textContent = "Play"; }}
play.onclick = () => {{
  if (before !== null) return stop();
  if (+time.value >= end) time.value = 0;
  before = performance.now();
  play.textContent = "Pause";
  requestAnimationFrame(step);
}};
time.oninput = show;
put("start", rows[0]); put("goal", rows[rows.length - 1]); show();
</script></body></html>
"""
