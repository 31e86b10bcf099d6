"""What every picture is made of: figures and axes, filled regions, lines, cells, legends, files."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import shapely
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from trailmark import se2
from trailmark.errors import OutputError
from trailmark.shown import TEXT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.world import World

__all__ = [
    "DPI",
    "LONG_SIDE",
    "PICTURE_SUFFIXES",
    "annotate",
    "draw_lines",
    "draw_note",
    "entries_of",
    "figure_of",
    "fill",
    "picture_of",
    "points_per_metre",
    "set_limits",
    "show_image",
    "tidy",
    "view",
    "write",
]

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")

LONG_SIDE = 7.5  # inches of the axes
DPI = 160

WIDE = 1.15
"""Width by height of axes from which the legend stands below."""


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


def figure_of(world: World, new_figure: Callable[..., Figure] = Figure, *, room: float = 0.0) -> tuple[Figure, Axes]:
    """Return a figure with one pair of axes that fit the world's shape; ``new_figure`` makes it, as ``Figure`` does.

    Writing a picture makes it as large as what is in it; else ``room`` (inches) is left where :func:`annotate` puts the
    legend: half of it below axes that are wide, or all beside others.
    """
    xmin, ymin, xmax, ymax = view(world)
    ratio = max((xmax - xmin) / (ymax - ymin), (ymax - ymin) / (xmax - xmin))
    # Long and thin worlds are drawn larger.
    scale = LONG_SIDE * min(1.5, max(1.0, math.sqrt(0.4 * ratio))) / max(xmax - xmin, ymax - ymin)
    width, height = max(0.8, (xmax - xmin) * scale), max(0.8, (ymax - ymin) * scale)
    wide = width > WIDE * height
    left, bottom, right, top = 0.7, 0.6 + (0.5 * room if wide else 0.0), 0.2 + (0.0 if wide else room), 0.6
    whole = left + width + right, bottom + height + top
    figure = new_figure(figsize=whole, facecolor="white", **({"dpi": DPI} if new_figure is Figure else {}))
    axes = figure.add_axes((left / whole[0], bottom / whole[1], width / whole[0], height / whole[1]))
    tidy(axes, 8)
    return figure, axes


def annotate(figure: Figure, axes: Axes, title: str, facts: str) -> None:
    """Write title and facts above the axes and the legend beside or, where they are wide, below."""
    for text, up, size, weight, colour in ((title, 20, 12, "bold", "black"), (facts, 6, 9, "normal", TEXT)):
        room = max(72, int(axes.bbox.width * 72.0 / figure.dpi / (0.6 * size)))
        note = draw_note(axes, text if len(text) <= room else text[: room - 1] + "…", up)
        note.set(fontsize=size, fontweight=weight, color=colour)
    wide, entries = axes.bbox.width > WIDE * axes.bbox.height, entries_of([axes])
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


def draw_note(axes: Axes, text: str, up: float) -> Any:
    """Write a line above the axes, ``up`` points from them; return it, to be set further."""
    note = axes.annotate(text, (0.0, 1.0), xytext=(0, up), xycoords="axes fraction", textcoords="offset points")
    note.set(va="bottom", ha="left", color=TEXT, parse_math=False)
    return note


def entries_of(all_axes: Sequence[Axes]) -> dict[str, Any]:
    """Return the artists of a legend by their labels, what lies on top first."""
    found: dict[str, Any] = {}
    for axes in all_axes:
        for artist, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, artist)
    return dict(sorted(found.items(), key=lambda entry: -entry[1].get_zorder()))


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


def show_image(axes: Axes, pixels: NDArray[Any], origin: tuple[float, float], cell: float, **style: Any) -> AxesImage:
    """Show cells, row 0 with the smallest y; not by axes.imshow, which sets limits and aspect anew."""
    (rows, columns), (x, y) = pixels.shape[:2], origin
    image = AxesImage(axes, origin="lower", extent=(x, x + columns * cell, y, y + rows * cell), **style)
    image.set_data(pixels)
    axes.add_image(image)
    return image


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
