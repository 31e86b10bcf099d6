"""Ticks of axes in metres: round values within the world's bounds, as many as have room for their labels."""

# Tested by tests/plotting/test_prompt.py.
from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axis import Axis
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import Formatter, MaxNLocator

__all__ = ["label_metres", "label_room"]

MAX_TICKS = 9
LETTER = 0.65
"""Width of a digit as a share of the font's size; DejaVu Sans's is 0.64."""

FAR = 1e3
"""Times the world's size: farther from zero, labels count from a round value that the axis's name tells."""


def label_metres(axis: Axis, name: str, low: float, high: float) -> None:
    """Name an axis and label it in metres.

    Args:
        axis: of x or y.
        name: of the axis.
        low: metres; ticks lie between here and ``high``, however far the axis reaches beyond.
        high: metres.
    """
    power = 10.0 ** math.ceil(math.log10(high - low))
    base = math.floor(low / power) * power if max(abs(low), abs(high)) > FAR * (high - low) else 0.0
    axis.set_major_formatter(_From(base))
    axis.set_major_locator(_Fitting(low, high))
    axis.set_label_text(f"{name} [m]" if base == 0.0 else f"{name} − {base:.12g} [m]")


def label_room(labels: Iterable[str], size: float) -> float:
    """Return the width (points) that the longest of some labels needs, with a gap to the next."""
    return size * (LETTER * max(map(len, labels), default=0) + 0.5)


class _From(Formatter):
    """Writes values less a base, in few digits."""

    def __init__(self, base: float) -> None:
        self.base = base

    def __call__(self, x: float, pos: int | None = None) -> str:  # matplotlib's signature
        # Steps are a twentieth of the range at least, which is at least a thousandth of the value.
        return f"{x - self.base:.6g}".replace("-", "−")


class _Fitting(MaxNLocator):
    """Round values between two others, so many that their labels do not touch."""

    def __init__(self, low: float, high: float) -> None:
        super().__init__(steps=[1, 2, 5, 10])
        self.low, self.high = low, high

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Return the ticks of an axis that shows the values from ``vmin`` to ``vmax``."""
        axis = self.axis
        assert isinstance(axis, Axis)  # noqa: S101  # label_metres gives it to one
        box = axis.axes.bbox
        along_x = axis.axis_name == "x"  # type: ignore[attr-defined]  # of XAxis and YAxis
        points = (box.width if along_x else box.height) * 72.0 / axis.axes.figure.dpi
        size = FontProperties(size=axis.get_tick_params().get("labelsize", "medium")).get_size_in_points()
        low, high = max(self.low, min(vmin, vmax)), min(self.high, max(vmin, vmax))
        ticks = np.empty(0)
        for count in range(MAX_TICKS, 0, -1):
            self.set_params(nbins=count, min_n_ticks=1)
            values = np.asarray(super().tick_values(low, high))
            slack = 1e-9 * (high - low)
            ticks = values[(values >= low - slack) & (values <= high + slack)]
            room = label_room(axis.get_major_formatter().format_ticks(ticks.tolist()), size) if along_x else 2.0 * size
            if len(ticks) < 2 or (ticks[1] - ticks[0]) / abs(vmax - vmin) * points >= room:
                return ticks
        return ticks[:1]
