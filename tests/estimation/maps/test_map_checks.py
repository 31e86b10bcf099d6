"""What a map's fit to its log is judged by, and the warnings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimation.logs.records import Scan
from trailmark.estimation.maps.map_checks import duration, explained_share, scan_warnings, top_speed
from trailmark.estimation.maps.map_settings import MappingSettings
from trailmark.shapes import Disc, Polygon
from trailmark.world import World


def test_explained_is_what_ends_near_an_outline() -> None:
    outline = np.array([[2.0, -2.0], [3.0, -2.0], [3.0, 2.0], [2.0, 2.0]])
    hole = np.array([[2.3, -0.5], [2.3, 0.5], [2.7, 0.5], [2.7, -0.5]])
    wall = Polygon(outline, (hole,))
    world = World("w", (-5.0, -5.0, 5.0, 5.0), (wall, Disc((0.0, 3.0), 0.5)))
    # On the wall, 0.1 m before it, amid it, on its hole's outline, on the disc, nowhere, and nothing met.
    angles = [0.0, 0.0, 0.0, 0.0, 90.0, 180.0, 200.0]
    ranges = [2.0, 1.9, 2.2, 2.3, 2.5, 3.0, 8.0]
    scans = [Scan(0.0, np.array([r]), math.radians(a), 0.1, 8.0) for r, a in zip(ranges, angles, strict=True)]
    # 2.2 m lies within 0.15 m of the hole.
    assert explained_share(world, scans, np.zeros((7, 3)), MappingSettings()) == pytest.approx(5 / 6)
    assert math.isnan(explained_share(world, scans[-1:], np.zeros((1, 3)), MappingSettings()))
    assert explained_share(World("e", world.bounds), scans, np.zeros((7, 3)), MappingSettings()) == 0.0


def test_durations_leave_out_what_no_clock_says() -> None:
    assert duration(np.array([3.0, 4.5, 9.0])) == 6.0
    assert duration(np.array([0.0, 4294967296.0, 4294967301.0])) == 5.0
    assert duration(np.repeat([1.13486e9, 1.13487e9], 200)) is None
    assert duration(np.empty(0)) == 0.0


def test_warnings_say_what_is_wrong_and_what_to_try() -> None:
    t = 0.5 * np.arange(100)
    slow = np.column_stack([t, t, np.zeros((100, 2))])
    assert top_speed(slow) == pytest.approx(1.0)
    assert scan_warnings(0.95, slow, "match") == []
    assert scan_warnings(math.nan, slow, "match") == []
    (poor,) = scan_warnings(0.48, slow, "odometry")
    assert "48%" in poor
    assert "--poses match" in poor
    fast = slow * [1.0, 40.0, 1.0, 1.0]
    (speed,) = scan_warnings(0.95, fast, "match")
    assert "40 m/s" in speed
