"""The panel of cost over time: what it draws, and that it keeps clear of plan and legend."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path as FilePath

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from trailmark import plotting
from trailmark.path import Path
from trailmark.planning.result import PlanResult, Status
from trailmark.plotting.canvas import annotate, figure_of
from trailmark.plotting.plan import add_progress
from trailmark.world import Robot, World

HISTORY = ((0.004, 12.0), (0.05, 11.0), (0.2, 10.5))


def test_steps_from_the_first_path_to_the_end_above_the_bound() -> None:
    axes = Figure().subplots()
    plotting.draw_progress(axes, HISTORY, 0.5, 10.0)
    steps, improved, bound = axes.lines
    np.testing.assert_allclose(
        np.asarray(steps.get_xydata(), dtype=float), [[4.0, 12.0], [50.0, 11.0], [200.0, 10.5], [500.0, 10.5]]
    )
    assert steps.get_drawstyle() == "steps-post"
    np.testing.assert_allclose(
        np.asarray(improved.get_xydata(), dtype=float), [[4.0, 12.0], [50.0, 11.0], [200.0, 10.5]]
    )
    assert set(np.asarray(bound.get_ydata()).tolist()) == {10.0}
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    assert 0.0 < left < 4.0
    assert right > 500.0
    assert low < 10.0
    assert high > 12.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "entries"),
    [
        *(((10.0, 10.0), 1), ((60.0, 4.0), 1), ((4.0, 60.0), 1)),
        *((size, 8) for size in [(10.0, 10.0), (20.0, 12.0), (60.0, 4.0), (4.0, 60.0), (9.0, 10.0)]),
    ],
)
def test_the_panel_keeps_clear_of_plan_and_legend(size: tuple[float, float], entries: int) -> None:
    labels = ["start", "goal", "path", "landmark", "edge, certified", "edge, not checked", "obstacle", "outside"]
    figure, axes = figure_of(World("room", (0.0, 0.0, *size)))
    for label in labels[:entries]:
        axes.plot([], [], label=label)
    annotate(figure, axes, "room", "facts")
    add_progress(figure, axes, HISTORY, 0.5, 10.0)
    plan, panel = figure.axes
    legend = plan.get_legend()
    assert legend is not None
    parts = [plan.get_window_extent(), legend.get_window_extent(), panel.get_tightbbox()]
    for a, b in combinations(parts, 2):
        assert a is not None
        assert b is not None
        shared = Bbox.intersection(a, b)
        assert shared is None or shared.width * shared.height < 1.0


@pytest.mark.slow
def test_pictures_of_plans_have_it_if_there_is_a_path(tmp_path: FilePath) -> None:
    path = Path(np.array([[1.0, 1.0, 0.0], [9.0, 5.0, 0.0]]))
    for found, history in ((path, HISTORY), (None, ())):
        status: Status = "solved" if found else "timeout"
        result = PlanResult(status, found, 0, 8.5, None, None, 0, 0, history=history, time={"total": 0.5})
        file = tmp_path / "plan.svg"
        plotting.save_plan_figure(file, World("room", (0.0, 0.0, 10.0, 6.0)), Robot.disc(0.3), result)
        text = file.read_text()
        for label in ("planning time [ms]", "lower bound"):
            assert (f"<!-- {label} -->" in text) == (found is not None)
