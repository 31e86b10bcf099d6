"""Pictures of audits: red where the path collides, a mark where it is narrowest."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest
from tests.support.pictures import colours_of, is_colour

from trailmark.audit import check_path
from trailmark.colours import COLLISION, REPAIRED
from trailmark.moving import Moving
from trailmark.path import Path
from trailmark.plotting import OBSTACLE, save_audit_figure, save_world_figure
from trailmark.shapes import Disc, Rectangle
from trailmark.world import Robot, World

WORLD = World("room", (0.0, 0.0, 10.0, 6.0), (Disc((5, 3), 1.0),), Robot.rectangle(0.8, 0.4))
ROBOT = Robot.rectangle(0.8, 0.4)


def share(file: FilePath, colour: str) -> float:
    """Return the share of a picture's pixels that have a colour."""
    rgb, counts = colours_of(file)
    return float(counts[is_colour(rgb, colour, 0.02)].sum() / counts.sum())


@pytest.mark.slow
def test_a_collision_is_red_and_a_repaired_path_is_drawn(tmp_path: FilePath) -> None:
    file = tmp_path / "a.png"
    audit = check_path(WORLD, ROBOT, [[1, 3, 0], [9, 3, 0]])
    save_audit_figure(file, WORLD, ROBOT, audit, Path(np.array([[1, 3, 0], [5, 5, 0], [9, 3, 0.0]])))
    assert share(file, COLLISION) > 0.001
    assert share(file, REPAIRED) > 0.001


@pytest.mark.slow
def test_a_free_path_has_no_red(tmp_path: FilePath) -> None:
    file = tmp_path / "a.png"
    save_audit_figure(file, WORLD, ROBOT, check_path(WORLD, ROBOT, [[1, 1, 0], [9, 1, 0]]))
    assert share(file, COLLISION) == 0.0


@pytest.mark.slow
def test_a_turn_in_place_that_collides_is_marked(tmp_path: FilePath) -> None:
    file = tmp_path / "a.png"
    audit = check_path(WORLD, ROBOT, [[5, 4.3, 0], [5, 4.3, 3.0]])
    assert not audit.free
    save_audit_figure(file, WORLD, ROBOT, audit)
    assert share(file, COLLISION) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("velocity", [(1.0, 0.3), (0.0, 0.0)])
def test_a_moving_obstacle_has_an_arrow(tmp_path: FilePath, velocity: tuple[float, float]) -> None:
    still, moving = tmp_path / "still.png", tmp_path / "moving.png"
    motion = Moving(Rectangle((2, 2), 1.5, 1), velocity, 4.0)
    world = World("room", (0.0, 0.0, 10.0, 6.0), (motion,))  # type: ignore[arg-type]  # worlds take moving ones apart
    save_world_figure(moving, world)
    save_world_figure(still, World("room", (0.0, 0.0, 10.0, 6.0), world.obstacles))
    assert 0.0 < share(moving, OBSTACLE) < share(still, OBSTACLE)
