"""Zones in pictures: each is drawn where it is, named in the legend, and noted where there is room."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from trailmark import CostZone, KeepOutZone, OneWayZone, Polygon, SpeedZone, World
from trailmark.plotting.world import draw_world
from trailmark.zones import Zone


def square(x: float, y: float, side: float = 3.0) -> Polygon:
    return Polygon(np.array([[x, y], [x + side, y], [x + side, y + side], [x, y + side]]))


ZONES: tuple[Zone, ...] = (
    CostZone(square(1, 1), 3.0),
    CostZone(square(6, 1), 0.5),
    KeepOutZone(square(11, 1)),
    OneWayZone(square(1, 6), math.pi / 2, 0.5),
    SpeedZone(square(6, 6), 0.25),
    SpeedZone(square(100, 100), 0.5),  # beyond the picture
    SpeedZone(square(11, 6, 0.01), 0.5),  # too small for a text
)


@pytest.mark.slow
def test_zones_are_drawn_where_they_are() -> None:
    figure = Figure(figsize=(8.0, 5.0), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    draw_world(axes, World("w", (0.0, 0.0, 16.0, 10.0), zones=ZONES))
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[::-1, :, :3] / 255.0

    def colours(x: float, y: float) -> np.ndarray:
        left, low = axes.transData.transform((x, y)).astype(int)
        return pixels[low : low + 40, left : left + 40].reshape(-1, 3)

    assert (colours(4.3, 4.3) == 1.0).all()  # nothing is there
    avoid, prefer = np.median(colours(1.2, 1.2), axis=0), np.median(colours(6.2, 1.2), axis=0)
    assert avoid[0] > avoid[1] > avoid[2]  # orange
    assert prefer[1] > prefer[0]  # green
    red = colours(11.2, 1.2)
    assert 0.05 < ((red[:, 0] > 0.6) & (red[:, 1] < 0.4)).mean() < 0.6  # hatched
    assert (colours(1.2, 6.2) != 1.0).any(axis=1).all()
    assert (colours(6.2, 6.2) != 1.0).any(axis=1).all()
    _, labels = axes.get_legend_handles_labels()
    assert set(labels) >= {"keep-out zone", "one-way zone", "speed zone", "avoid (cost zone)", "prefer (cost zone)"}
    assert sorted(text.get_text() for text in axes.texts) == ["", "× 0.5", "× 3", "≤ 0.25 m/s"]
