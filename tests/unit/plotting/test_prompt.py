"""``plot`` methods: they draw into the axes that they are given, layer by layer; notebooks show pictures."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from trailmark import Disc, LandmarkPlanner, Query, Robot, World

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


@pytest.mark.slow
def test_what_shows_itself_in_a_notebook_is_a_picture(planned: Any) -> None:
    planner, result = planned
    sizes = set()
    for shown in (ROOM, ROBOT, planner.roadmap, result):
        with Image.open(io.BytesIO(shown._repr_png_())) as picture:
            assert picture.width > 200
            sizes.add(hash(picture.convert("RGB").tobytes()))
    assert len(sizes) == 4
