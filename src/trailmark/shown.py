"""Shown: worlds, robots, roadmaps and results show themselves at a prompt and in a notebook."""

from __future__ import annotations

from typing import Any

__all__ = ["Shown"]


class Shown:
    """Draws itself into axes of matplotlib, and as a small picture where a notebook shows it."""

    def plot(self, ax: Any = None, *, robot: Any = None, roadmap: Any = None, **layers: bool) -> Any:
        """Draw this with matplotlib, and return the axes.

        Args:
            ax: :class:`matplotlib.axes.Axes` to draw on: limits and aspect are set, title and legend are left to you
                (``ax.legend()``). By default those of a new figure of :mod:`matplotlib.pyplot`, with both.
            robot: the :class:`trailmark.Robot` to draw; by default the one that this was made for.
            roadmap: a :class:`trailmark.Roadmap` to draw as well, such as ``planner.roadmap``.
            layers: what to show or not, such as ``margin=False``: :class:`trailmark.layers.Layers`.

        Raises:
            ConfigurationError: an unknown layer, or a result that does not know its world.
        """
        from trailmark.plotting.canvas import scene_of
        from trailmark.plotting.prompt import plot

        return plot(scene_of(self, robot, roadmap), ax, layers)

    def _repr_png_(self) -> bytes:
        from trailmark.plotting.canvas import scene_of
        from trailmark.plotting.prompt import png_of

        return png_of(scene_of(self))
