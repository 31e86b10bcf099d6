"""Pictures of cars' plans: what is drawn follows the curves."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from trailmark.collision import StateChecker
from trailmark.curves import CurvePath, Steering
from trailmark.plotting import draw_plan
from trailmark.roadmap import Roadmap
from trailmark.world import Robot, World

CAR = Robot.rectangle(2.0, 1.0).steered(2.0)
WORLD = World("open", (0.0, 0.0, 20.0, 20.0), robot=CAR)
KNOTS = np.array([(3.0, 3.0, 0.0), (10.0, 12.0, 3.0), (16.0, 5.0, -1.5)])


def axes() -> Axes:
    made = Figure().add_subplot()
    made.set(xlim=(0, 20), ylim=(0, 20))
    return made


def test_the_path_drawn_is_the_curve() -> None:
    drawn, path = axes(), CurvePath(KNOTS, Steering(2.0))
    draw_plan(drawn, CAR, path)
    (line,) = [line for line in drawn.lines if line.get_label() == "path"]
    x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    assert np.hypot(np.diff(x), np.diff(y)).sum() > 0.999 * path.length
    where = path.at(np.linspace(0.0, 1.0, 500))[:, :2]
    gaps = np.hypot(where[:, None, 0] - x, where[:, None, 1] - y).min(axis=1)
    assert np.quantile(gaps, 0.3) < 0.1


def test_a_roadmap_of_curves_is_drawn_as_curves() -> None:
    drawn = axes()
    roadmap = Roadmap(StateChecker(WORLD, CAR))
    roadmap.add(KNOTS)
    roadmap.certify_all()
    draw_plan(drawn, CAR, roadmap=roadmap)
    patches = [artist for artist in drawn.get_children() if isinstance(artist, PathPatch)]
    points = max(len(np.asarray(patch.get_path().vertices)) for patch in patches)
    # Two points for each of twelve lines an edge, not two for an edge.
    assert points >= 24 * np.count_nonzero(roadmap.certified) > 0
