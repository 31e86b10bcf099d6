"""``plot`` methods: they draw into the axes that they are given, layer by layer, and labels do not collide."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from trailmark import Disc, LandmarkPlanner, Query, Robot, World
from trailmark.errors import ConfigurationError
from trailmark.plotting.canvas import figure_of
from trailmark.plotting.world import draw_world

ROBOT = Robot.rectangle(0.8, 0.4)
QUERY = Query("over", (1.0, 1.0, 0.0), (9.0, 5.0, 1.5))
ROOM = World("room", (0.0, 0.0, 10.0, 6.0), (Disc((5.0, 3.0), 1.0),), ROBOT, queries=(QUERY,))


@pytest.fixture(scope="module")
def planned() -> Any:
    planner = LandmarkPlanner(ROOM, seed=0)
    planner.build(40).certify_all()
    return planner, planner.plan(QUERY.start, QUERY.goal, 60.0, max_iterations=1)


@pytest.mark.slow
def test_they_draw_into_the_axes_given_and_return_them(planned: Any) -> None:
    planner, result = planned
    for shown in (ROOM, ROBOT, planner.roadmap, result):
        axes = Figure().add_subplot()
        assert shown.plot(ax=axes) is axes
        assert axes.get_legend() is None
        assert axes.has_data()
        assert axes.get_aspect() == 1.0


def test_new_axes_have_title_and_legend(planned: Any) -> None:
    with mpl.rc_context({"backend": "agg"}):
        from matplotlib import pyplot

        axes = planned[1].plot(roadmap=planned[0].roadmap)
        assert axes.figure is pyplot.gcf()
        labels = {text.get_text() for text in axes.get_legend().get_texts()}
        pyplot.close(axes.figure)
    assert {"path", "start", "goal", "obstacle", "landmark", "edge, certified"} <= labels


LABELS = {
    "obstacles": "obstacle",
    "margin": "C-obstacle at every heading",
    "outside": "outside",
    "edges": "edge, certified",
    "landmarks": "landmark",
    "path": "path",
    "footprints": "robot along the path",
    "ends": "start",
}


@pytest.mark.parametrize("layer", LABELS)
def test_each_layer_can_be_switched_off(planned: Any, layer: str) -> None:
    planner, result = planned
    drawn = []
    for options in ({}, {layer: False}):
        axes = result.plot(Figure().add_subplot(), roadmap=planner.roadmap, **options)
        drawn.append(set(axes.get_legend_handles_labels()[1]))
    assert drawn[0] - drawn[1] == {LABELS[layer], *(("goal",) if layer == "ends" else ())}


@pytest.mark.slow
def test_clearance_is_a_layer_of_its_own() -> None:
    without, with_it = (ROOM.plot(Figure().add_subplot(), clearance=shown) for shown in (False, True))
    assert not without.images
    (image,) = with_it.images
    values = np.asarray(image.get_array())
    assert values.max() == pytest.approx(2.0, abs=0.1)  # between disc and wall, as far from either
    assert with_it.get_xlim() == without.get_xlim()


def test_unknown_layers_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"did you mean 'obstacles'\?"):
        ROOM.plot(obstacle=False)


BOUNDS = [
    *[(0, 0, 10, 80), (0, 0, 80, 10), (0, 0, 2, 100), (0, 0, 100, 2), (1e6, 1e6, 1e6 + 20, 1e6 + 12)],
    *[(0, 0, 1e-3, 6e-4), (-12345.6, 3, -12340.1, 60), (456789.3, 5.1e6, 456839.3, 5.1e6 + 7), (-1e6, -1e6, 1e6, 1e6)],
    *[(0, 0, 7e-5, 7e-4), (5, 5, 5.001, 5.002)],
]


def collisions(figure: Figure, *all_axes: Any) -> list[tuple[str, str]]:
    """Return the pairs of tick labels that touch each other, or a text beside the axes, where they are drawn."""
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    found = []
    for axis in (axis for axes in all_axes for axis in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        labels = [tick.label1 for tick in ticks if tick.label1.get_text()]
        assert labels
        assert axis.get_offset_text().get_text() == ""
        boxes = [(label.get_text(), label.get_window_extent(renderer)) for label in labels]
        found += [(a, b) for (a, box), (b, other) in pairwise(boxes) if box.overlaps(other)]
        name = axis.label.get_window_extent(renderer)
        found += [(a, "name") for a, box in boxes if box.overlaps(name)]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("bounds", BOUNDS)
def test_tick_labels_do_not_collide(bounds: Any) -> None:
    world = World("w", bounds)
    figure, axes = figure_of(world)
    draw_world(axes, world)
    assert collisions(figure, axes) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bounds", "size"), [*((each, (3.0, 2.0)) for each in BOUNDS), *((each, (6.4, 4.8)) for each in BOUNDS[::2])]
)
def test_tick_labels_do_not_collide_in_the_users_axes(bounds: Any, size: tuple[float, float]) -> None:
    figure = Figure(figsize=size)
    all_axes = figure.subplots(1, 2)
    for axes in all_axes:
        World("w", bounds).plot(axes)
    assert collisions(figure, *all_axes) == []


def test_labels_tell_where_things_are_far_from_the_origin() -> None:
    figure, axes = figure_of(world := World("w", (1e6, 0, 1e6 + 20, 12)))
    draw_world(axes, world)
    assert collisions(figure, axes) == []
    assert axes.get_xlabel() == "x − 1000000 [m]"
    assert axes.get_ylabel() == "y [m]"
    assert [tick.get_text() for tick in axes.get_xticklabels()][-1] == "20"
