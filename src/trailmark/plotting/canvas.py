"""What every picture is made of: what it is of, colours, figures and axes, filled regions, lines, legends, files."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import shapely
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from trailmark import se2
from trailmark.errors import ConfigurationError, OutputError
from trailmark.shown import TEXT
from trailmark.world import Robot, World

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.path import Path
    from trailmark.planning import PlanResult
    from trailmark.roadmap import Roadmap

__all__ = [
    "DPI",
    "LONG_SIDE",
    "PICTURE_SUFFIXES",
    "Scene",
    "annotate",
    "draw_legend",
    "draw_lines",
    "figure_of",
    "fill",
    "picture_of",
    "plan_facts",
    "points_per_metre",
    "scene_of",
    "set_limits",
    "tidy",
    "view",
    "world_facts",
    "write",
]

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")

LONG_SIDE = 7.5  # inches of the axes
DPI = 160
_LEGEND = [
    "start",
    "goal",
    "path",
    "robot",
    "robot along the path",
    "collides",
    "least clearance",
    "repaired path",
    "landmark",
    "edge, certified",
    "edge, not checked",
]
_LEGEND += ["obstacle", "C-obstacle at every heading", "outside", "keep-out zone", "one-way zone"]
_LEGEND += ["avoid (cost zone)", "prefer (cost zone)", "speed zone"]


def view(world: World) -> tuple[float, float, float, float]:
    """Return the part of the plane that a picture of the world shows: xmin, ymin, xmax, ymax in metres."""
    xmin, ymin, xmax, ymax = world.bounds
    pad = 0.03 * max(xmax - xmin, ymax - ymin)
    return xmin - pad, ymin - pad, xmax + pad, ymax + pad


def set_limits(axes: Axes, world: World, *, labels: bool = True) -> None:
    """Let axes show the world, with an equal aspect and, if ``labels``, the names of x and y."""
    xmin, ymin, xmax, ymax = view(world)
    axes.set(xlim=(xmin, xmax), ylim=(ymin, ymax), aspect="equal")
    if labels:
        axes.set(xlabel="x [m]", ylabel="y [m]")


def tidy(axes: Axes, font_size: float) -> None:
    """Draw axes without a frame, with small grey tick labels."""
    axes.tick_params(labelsize=font_size, color=TEXT, labelcolor=TEXT)
    axes.spines[:].set_visible(False)


def figure_of(world: World, new_figure: Callable[..., Figure] = Figure) -> tuple[Figure, Axes]:
    """Return a figure with one pair of axes that fit the world's shape; ``new_figure`` makes it, as ``Figure`` does."""
    xmin, ymin, xmax, ymax = view(world)
    ratio = max((xmax - xmin) / (ymax - ymin), (ymax - ymin) / (xmax - xmin))
    # Long and thin worlds are drawn larger.
    scale = LONG_SIDE * min(1.5, max(1.0, math.sqrt(0.4 * ratio))) / max(xmax - xmin, ymax - ymin)
    width, height = max(0.8, (xmax - xmin) * scale), max(0.8, (ymax - ymin) * scale)
    left, bottom, right, top = 0.7, 0.6, 0.2, 0.6
    whole = left + width + right, bottom + height + top
    figure = new_figure(figsize=whole, facecolor="white", **({"dpi": DPI} if new_figure is Figure else {}))
    axes = figure.add_axes((left / whole[0], bottom / whole[1], width / whole[0], height / whole[1]))
    tidy(axes, 8)
    return figure, axes


def annotate(figure: Figure, axes: Axes, title: str, facts: str) -> None:
    """Write title and facts above the axes and the legend beside or, where they are wide, below."""
    lines: list[tuple[str, int, dict[str, Any]]] = [
        (title, 20, {"fontsize": 12, "fontweight": "bold"}),
        (facts, 6, {"fontsize": 9, "color": TEXT}),
    ]
    for text, up, style in lines:
        room = max(72, int(axes.bbox.width * 72.0 / figure.dpi / (0.6 * style["fontsize"])))
        short = text if len(text) <= room else text[: room - 1] + "…"
        note = axes.annotate(short, (0.0, 1.0), xytext=(0, up), xycoords="axes fraction", textcoords="offset points")
        note.set(va="bottom", ha="left", parse_math=False, **style)
    artists, labels = axes.get_legend_handles_labels()
    entries = {label: artists[labels.index(label)] for label in sorted(set(labels), key=_LEGEND.index)}
    draw_legend(figure, axes, entries)


def draw_legend(figure: Figure, axes: Axes, entries: Mapping[str, Any]) -> None:
    """Draw the legend (handles by their labels) beside the axes or, where they are wide, below."""
    wide = axes.bbox.width > 1.15 * axes.bbox.height
    axes.legend(
        entries.values(),
        entries.keys(),
        loc="upper left",
        bbox_to_anchor=(0.0, -0.55 * figure.dpi / axes.bbox.height) if wide else (1.02, 1.0),
        ncols=4 if wide else 1,
        fontsize=8,
        frameon=False,
        borderaxespad=0.0,
        handlelength=1.6,
    )


def fill(axes: Axes, regions: Any, colour: str, zorder: float, **style: Any) -> None:
    """Fill polygonal regions as one patch; they may overlap (non-zero winding), and neighbours show no seam."""
    polygons = shapely.get_parts(np.asarray(regions, dtype=object))
    polygons = polygons[(shapely.get_type_id(polygons) == 3) & ~shapely.is_empty(polygons)]
    if len(polygons) == 0:
        return
    rings = shapely.get_rings(shapely.orient_polygons(polygons))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    codes = np.full(len(points), Outline.LINETO, dtype=Outline.code_type)
    last = np.append(ring[1:] != ring[:-1], True)
    codes[last] = Outline.CLOSEPOLY
    codes[np.roll(last, 1)] = Outline.MOVETO
    style = {"edgecolor": "none", "linewidth": 0.0} | style
    # Not add_patch, which looks for the limits of every edge in Python: seconds on a grid map.
    axes.add_artist(PathPatch(Outline(points, codes), facecolor=colour, zorder=zorder, **style))


def draw_lines(axes: Axes, lines: se2.FloatArray, colour: str, width: float, zorder: float) -> None:
    """Draw n line segments, shape (n, 2, 2), as one patch: tens of thousands of separate ones take seconds.

    They get thinner where their ink would fill most of the region they lie in, so that they stay a texture.
    """
    if len(lines) == 0:
        return
    scale = points_per_metre(axes)
    ink = scale * np.hypot(*(lines[:, 1] - lines[:, 0]).T).sum()
    steps = np.linspace(0.0, 1.0, 8)[:, None, None]
    cells = np.floor(scale / 12.0 * (lines[:, 0] + steps * (lines[:, 1] - lines[:, 0])))
    room = 144.0 * len(np.unique(cells @ [1.0, 1e4]))  # square points: what the lines touch, in cells of 12 points
    codes = np.tile(np.array([Outline.MOVETO, Outline.LINETO], dtype=Outline.code_type), len(lines))
    thin = min(width, max(0.05, 0.4 * room / max(ink, 1e-9)))
    axes.add_artist(
        PathPatch(Outline(lines.reshape(-1, 2), codes), fill=False, edgecolor=colour, linewidth=thin, zorder=zorder)
    )


def points_per_metre(axes: Axes) -> float:
    """Return how many typographic points a metre takes on axes whose limits are set."""
    (left, low), (right, high) = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    return float(min(abs(right - left), abs(high - low))) * 72.0 / axes.figure.dpi


def picture_of(world: World, file: str | FilePath) -> FilePath:
    """Return the file for a picture of the world.

    Raises:
        OutputError: it is one that the world was read from, such as a map's image.
    """
    from trailmark.formats.files import require_not_an_input

    path = FilePath(file)
    require_not_an_input(path, world.sources)
    return path


def write(figure: Figure, file: FilePath) -> None:
    """Write a figure, whole or not at all; the same figure gives the same bytes.

    Raises:
        OutputError: a suffix other than PICTURE_SUFFIXES, or a file that cannot be written.
    """
    from trailmark.formats.files import write_atomically

    kind = file.suffix.lower()
    if kind not in PICTURE_SUFFIXES:
        raise OutputError(f"{file}: suffix: expected {', '.join(PICTURE_SUFFIXES)}, got {file.suffix!r}")
    buffer = io.BytesIO()
    undated: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    metadata = undated.get(kind)
    with matplotlib.rc_context({"svg.hashsalt": "trailmark"}):
        figure.savefig(buffer, format=kind[1:], dpi=DPI, bbox_inches="tight", pad_inches=0.12, metadata=metadata)
    write_atomically(file, buffer.getvalue())


@dataclass(frozen=True)
class Scene:
    """What a picture is of.

    Attributes:
        title: a name.
        facts: a line about it.
        world: None for a robot on its own.
        robot: None if there is none.
        roadmap: None if there is none.
        path: None if there is none.
        start: configuration; None if there is none.
        goal: configuration, or goals; None if there is none.
        queries: whether the world's queries belong to it.
    """

    title: str
    facts: str
    world: World | None = None
    robot: Robot | None = None
    roadmap: Roadmap | None = None
    path: Path | None = None
    start: tuple[float, float, float] | None = None
    goal: Any = None
    queries: bool = False


def scene_of(shown: object, robot: Robot | None = None, roadmap: Roadmap | None = None) -> Scene:
    """Return the picture of a world, a robot, a roadmap or a result.

    Args:
        shown: what is shown.
        robot: in the place of its own.
        roadmap: shown as well.

    Raises:
        ConfigurationError: something else, or a result that does not know its world and robot.
    """
    if isinstance(shown, Robot):
        return Scene("robot", shown.describe(), robot=shown)
    if isinstance(shown, World):
        body = robot or shown.robot
        return Scene(shown.name, world_facts(shown), shown, body, roadmap, queries=True)
    # Later, since these bring in all that plans.
    from trailmark.planning import PlanResult
    from trailmark.roadmap import Roadmap

    if isinstance(shown, Roadmap):
        world, body = shown.checker.world, robot or shown.checker.robot
        facts = f"{len(shown):,} landmarks · {len(shown.edges):,} edges · {body.describe()}"
        return Scene(world.name, facts, world, body, shown)
    if not isinstance(shown, PlanResult) or shown.world is None or shown.robot is None:
        raise ConfigurationError(f"picture: expected a result that knows its world and robot, got {shown!r:.80}")
    body = robot or shown.robot
    facts = plan_facts(shown, body)
    return Scene(shown.world.name, facts, shown.world, body, roadmap, shown.path, shown.start, shown.target)


def world_facts(world: World) -> str:
    """Return size, obstacles, queries and robot of a world in a line."""
    facts = [f"{world.bounds[2] - world.bounds[0]:g} × {world.bounds[3] - world.bounds[1]:g} m"]
    facts.append(f"{len(world.obstacles):,} obstacle{'' if len(world.obstacles) == 1 else 's'}")
    facts.append(f"{len(world.queries):,} quer{'y' if len(world.queries) == 1 else 'ies'}")
    facts.append(world.robot.describe() if world.robot else "no robot")
    return " · ".join(facts)


def plan_facts(result: PlanResult, robot: Robot) -> str:
    """Return what a plan found in a line: cost, length, turning, time and robot."""
    from trailmark.curves import CurvePath

    seconds = f"{result.time.get('total') or math.nan:.3g} s"
    if result.path is not None:
        path = result.path
        facts = f"cost {path.cost:.4g} = {path.length:.4g} m + {se2.ROTATION_WEIGHT:g} × {path.rotation:.3g} rad"
        if result.objective is not None or result.goal is not None:
            # Not the sum of length and turning alone.
            facts = f"cost {result.cost:.4g}, {path.length:.4g} m, {path.rotation:.3g} rad"
        if isinstance(path, CurvePath):
            facts = f"{path.length:.4g} m, {path.cusps} changes of direction"
        return f"{facts} · {seconds} · {robot.describe()}"
    why = "no path exists (proven)" if result.status == "infeasible" else f"no path found in {seconds}"
    return f"{why} · {robot.describe()}"
