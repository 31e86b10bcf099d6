"""Simulated logs: without noise they lead to the truth, with noise they have just that; what is hidden is not seen."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from trailmark import Disc, Polygon, Rectangle, World
from trailmark.estimation import EstimationError, PoseIncrement, RangeBearing, Unicycle
from trailmark.estimation.readers import load_log, save_log
from trailmark.estimation.records import Detection, Increment, Odometry, Pose, Scan
from trailmark.estimation.simulation import Drive, Simulation, simulate
from trailmark.estimation.virtual_sensors import Detector, Scanner

FloatArray = NDArray[np.float64]

YARD = World(
    "yard",
    (0.0, 0.0, 20.0, 12.0),
    (
        Disc((5.0, 9.0), 0.2),
        Disc((12.0, 2.0), 0.3),
        Rectangle((9.0, 6.5), 2.0, 1.0, 0.4),
        Disc((16.0, 9.0), 1.5),
        Disc((10.0, 10.5), 0.1),
        Polygon(np.array([[14.0, 5.0], [18.0, 5.0], [18.0, 4.0], [15.0, 4.0], [15.0, 3.0], [14.0, 3.0]])),
    ),
    boundary=Polygon(np.array([[0.5, 0.0], [20.0, 0.0], [20.0, 12.0], [0.0, 12.0]])),
)
WAY = [[2.0, 2.0, 0.0], [7.0, 2.0, 0.5], [7.0, 8.5, 3.0], [3.0, 6.0, 2.0], [2.0, 2.0, 0.0]]
SENSOR = RangeBearing(0.05, 0.01)


def times_and_poses(simulation: Simulation) -> dict[float, FloatArray]:
    return {float(row[0]): row[1:] for row in simulation.truth}


def line_of_sight(world: World, pose: FloatArray, disc: Disc, skip: int) -> bool:
    """Whether nothing but the disc itself lies on the way to its near side; shapely regions, made a little smaller."""
    sight = np.array(disc.center) - pose[:2]
    near = pose[:2] + sight * max(0.0, 1.0 - disc.radius / math.hypot(*sight))
    line = shapely.LineString([pose[:2], near])
    others = [region for i, region in enumerate(smaller(world)) if i != skip]
    return not shapely.intersects(others, line).any() and world.boundary.shapely().buffer(1e-6).covers(line)


@cache
def smaller(world: World) -> list[shapely.Geometry]:
    return [shape.polygon(1e-6).shapely().buffer(-1e-5) for shape in world.obstacles]


@pytest.mark.slow
@pytest.mark.parametrize("motion", [Unicycle(0.0, 0.0), PoseIncrement(0.0, 0.0, 0.0)])
def test_without_noise_dead_reckoning_leads_along_the_truth(motion: Any) -> None:
    detector = Detector(SENSOR, period=0.37)
    simulation = simulate(YARD, WAY, motion, detector=detector, speed=0.7, turn_rate=0.9, period=0.13, random_state=1)
    truth = times_and_poses(simulation)
    x, y, theta = WAY[0]
    held: Odometry | None = None
    for record in simulation.log.records:
        if isinstance(record, Increment):
            x, y = (
                x + math.cos(theta) * record.dx - math.sin(theta) * record.dy,
                y + math.sin(theta) * record.dx + math.cos(theta) * record.dy,
            )
            theta += record.dtheta
        elif isinstance(record, Odometry):
            if held is not None:
                # In small steps: the reader of a log need not know arcs.
                n = 400
                for _ in range(n):
                    step = (record.t - held.t) / n
                    x += held.v * step * math.cos(theta + held.omega * step / 2)
                    y += held.v * step * math.sin(theta + held.omega * step / 2)
                    theta += held.omega * step
            held = record
        elif isinstance(record, Pose):
            assert record.truth
            assert np.array_equal(truth[record.t], record[1:4])
            off = (x - record.x, y - record.y, math.remainder(theta - record.theta, 2 * math.pi))
            assert np.abs(off).max() < 1e-5
    assert np.abs(simulation.truth[-1, 1:3] - (2.0, 2.0)).max() < 1e-5


@pytest.mark.slow
def test_the_odometrys_noise_is_the_models() -> None:
    square = [[5, 5, 0], [15, 5, 0], [15, 5, 2], [10, 8, -1]] * 10
    world = World("field", (0, 0, 20, 20))

    def records(motion: Any, kind: type) -> list[Any]:
        return [r for r in simulate(world, square, motion, random_state=0).log.records if isinstance(r, kind)]

    exact = records(Unicycle(0.0, 0.0), Odometry)
    noisy = records(Unicycle(0.05, 0.02, (0.01, 0.0, 0.0, 0.02)), Odometry)
    assert noisy[-1] == Odometry(exact[-1].t, 0.0, 0.0)
    true, off = (np.array([r[1:] for r in of[:-1]]) for of in (exact, noisy))
    velocities = (true - off) / np.sqrt(np.square([0.05, 0.02]) + [0.01, 0.02] * true**2)
    exact = records(PoseIncrement(0.0, 0.0, 0.0), Increment)
    noisy = records(PoseIncrement(0.01, 0.02, 0.005, (0.001, 0.0, 0.0)), Increment)
    steps = [(np.array(a[1:4]) - b[1:4]) / np.sqrt(np.diag(b.covariance)) for a, b in zip(exact, noisy, strict=True)]
    assert noisy[0].covariance[0, 0] == pytest.approx(0.01**2 + 0.001 * math.hypot(exact[0].dx, exact[0].dy))
    for whitened in (velocities, np.array(steps)):
        assert len(whitened) > 1000
        assert all(stats.kstest(column, "norm").pvalue > 1e-3 for column in whitened.T)
        assert np.abs(np.corrcoef(whitened.T) - np.eye(len(whitened.T))).max() < 0.15


@pytest.mark.slow
def test_what_the_detector_sees() -> None:
    detector = Detector(SENSOR, max_range=9.0, field_of_view=4.0, period=0.2, max_radius=1.0)
    simulation = simulate(YARD, WAY, Unicycle(0.0, 0.0), detector=detector, random_state=3)
    truth = times_and_poses(simulation)
    assert simulation.log.landmarks.tolist() == [[0, 5, 9], [1, 12, 2], [4, 10, 10.5]]
    found = {(r.t, r.identity): r for r in simulation.log.records if isinstance(r, Detection)}
    swept = np.arange(int(simulation.truth[-1, 0] / 0.2) + 1) * 0.2
    seen = 0
    for t in swept:
        t = min(truth, key=lambda k: abs(k - t))
        pose = truth[t]
        for i, disc in enumerate(YARD.obstacles):
            if not isinstance(disc, Disc):
                continue
            dx, dy = disc.center[0] - pose[0], disc.center[1] - pose[1]
            bearing = math.remainder(math.atan2(dy, dx) - pose[2], 2 * math.pi)
            inside = math.hypot(dx, dy) <= 9.0 and abs(bearing) <= 2.0 and disc.radius <= 1.0
            visible = inside and line_of_sight(YARD, pose, disc, i)
            assert visible == ((t, i) in found), (t, i)
            if visible:
                seen += 1
                z = found[t, i].z
                assert abs(z[0] - math.hypot(dx, dy)) < 5 * 0.05
                assert abs(math.remainder(z[1] - bearing, 2 * math.pi)) < 5 * 0.01
                assert np.asarray(found[t, i].covariance).tolist() == [[0.05**2, 0.0], [0.0, 0.01**2]]
    assert seen == len(found) > 50
    assert {i for _, i in found} == {0, 1, 4}


@pytest.mark.slow
def test_the_detectors_noise_misses_and_false_alarms() -> None:
    world = World("one", (-20, -20, 20, 20), (Disc((5.0, 0.0), 0.1),))
    detector = Detector(SENSOR, max_range=8.0, field_of_view=3.0, period=0.01, detection_rate=0.8, false_alarms=0.3)
    log = simulate(
        world, [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], Unicycle(0.0, 0.0), detector=detector, turn_rate=0.1, random_state=4
    ).log
    true_heading = {r.t: r.theta for r in log.records if isinstance(r, Pose)}
    real = [r for r in log.records if isinstance(r, Detection) and r.identity == 0]
    false = [r for r in log.records if isinstance(r, Detection) and r.identity is None]
    sweeps = len({r.t for r in log.records if isinstance(r, Pose)})
    assert abs(len(real) - 0.8 * sweeps) < 4 * math.sqrt(0.16 * sweeps)
    assert abs(len(false) - 0.3 * sweeps) < 4 * math.sqrt(0.3 * sweeps)
    assert stats.kstest([(r.z[0] - 5.0) / 0.05 for r in real], "norm").pvalue > 1e-3
    assert stats.kstest([(r.z[1] + true_heading[r.t]) / 0.01 for r in real], "norm").pvalue > 1e-3
    assert stats.kstest([(r.z[0] / 8.0) ** 2 for r in false], "uniform").pvalue > 1e-3
    assert stats.kstest([r.z[1] / 3.0 + 0.5 for r in false], "uniform").pvalue > 1e-3
    nameless = simulate(
        world, [[0, 0, 0]], Unicycle(0.0, 0.0), detector=Detector(SENSOR, identities=False), random_state=0
    )
    assert [r.identity for r in nameless.log.records if isinstance(r, Detection)] == [None]


@pytest.mark.slow
def test_scans_against_shapely() -> None:
    scanner = Scanner(beams=61, field_of_view=4.0, max_range=7.0, sigma=0.0, mount=(0.3, -0.1, 0.5))
    simulation = simulate(YARD, WAY, PoseIncrement(0.0, 0.0, 0.0), scanner=scanner, random_state=3)
    truth = times_and_poses(simulation)
    walls = [YARD.boundary.shapely().exterior, shapely.box(*YARD.bounds).exterior] if YARD.boundary else []
    solid = shapely.union_all([*(shape.polygon(1e-6).shapely() for shape in YARD.obstacles), *walls])
    missed = 0
    for scan in [r for r in simulation.log.records if isinstance(r, Scan)][::20]:
        x, y, theta = truth[scan.t]
        ox = x + 0.3 * math.cos(theta) + 0.1 * math.sin(theta)
        oy = y + 0.3 * math.sin(theta) - 0.1 * math.cos(theta)
        assert (scan.mount, scan.pose, scan.range_max) == ((0.3, -0.1, 0.5), None, 7.0)
        assert scan.angle_min == pytest.approx(-2.0)
        assert scan.angle_increment == pytest.approx(4.0 / 60)
        angle = theta + 0.5 + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        ends = np.column_stack([ox + 7.0 * np.cos(angle), oy + 7.0 * np.sin(angle)])
        rays = shapely.linestrings(np.stack([np.broadcast_to([ox, oy], ends.shape), ends], axis=1))
        met = shapely.distance(shapely.Point(ox, oy), shapely.intersection(rays, solid))
        # What is empty is at no distance.
        np.testing.assert_allclose(scan.ranges, np.where(np.isnan(met), math.inf, met), rtol=0.0, atol=1e-4)
        missed += int(np.isnan(met).sum())
    assert missed > 3


@pytest.mark.slow
def test_the_same_seed_gives_the_same_log_and_sensors_do_not_disturb_each_other(tmp_path: Path) -> None:
    full = {"detector": Detector(SENSOR), "scanner": Scanner(drop_out=0.1)}
    motion = Unicycle(0.1, 0.1)
    a = simulate(YARD, WAY, motion, **full, random_state=7)  # type: ignore[arg-type]  # a dict of two kinds
    save_log(a.log, tmp_path / "a.jsonl")
    save_log(simulate(YARD, WAY, motion, **full, random_state=7).log, tmp_path / "b.jsonl")  # type: ignore[arg-type]  # as above
    assert (tmp_path / "a.jsonl").read_bytes() == (tmp_path / "b.jsonl").read_bytes()
    loaded = load_log(tmp_path / "a.jsonl")
    assert len(loaded.records) == len(a.log.records)
    assert loaded.name == "yard"
    assert np.array_equal(loaded.landmarks, a.log.landmarks)
    one = simulate(YARD, WAY, motion, scanner=Scanner(drop_out=0.1), random_state=7)
    for kind in (Odometry, Scan):
        mine, other = ([r for r in s.log.records if isinstance(r, kind)] for s in (a, one))
        assert str(mine) == str(other)
    assert str(simulate(YARD, WAY, motion, random_state=8).log) != str(simulate(YARD, WAY, motion, random_state=7).log)


@pytest.mark.parametrize(
    ("way", "problem"),
    [
        ([[2, 2], [9, 6.5]], r"states: the path leads through obstacles\[2\] near \(8"),
        ([[5, 8], [5, 10]], r"states: the path leads through obstacles\[0\] near \(5, 8.8\)"),
        ([[2, 2], [30, 2]], r"states: the path leaves the world's bounds near \(20, 2\)"),
        ([[2, 6], [0.1, 0.5]], r"states: the path leaves the world's boundary near \(0.4"),
        ([[9, 6.5, 0.0]], r"states: the path leads through obstacles\[2\]"),
    ],
)
def test_ways_that_cannot_be_driven(way: list[list[float]], problem: str) -> None:
    with pytest.raises(EstimationError, match=problem):
        simulate(YARD, way, Unicycle(0.0, 0.0))


def test_touching_is_allowed() -> None:
    # Along the lower edge of the rectangle and past the disc at its very rim.
    world = World("touch", (0, 0, 10, 10), (Rectangle((5, 5), 2, 2), Disc((5.0, 3.5), 0.5)))
    simulate(world, [[1, 4], [9, 4]], Unicycle(0.0, 0.0))
    simulate(world, [[0, 0], [10, 0], [10, 10]], Unicycle(0.0, 0.0))


places = st.floats(-20.0, 20.0)
headings = st.floats(-math.pi, math.pi, exclude_min=True)
states = st.lists(st.tuples(places, places, headings), min_size=1, max_size=6).map(np.array)


def turn(a: float, b: float) -> float:
    """The angle between two headings."""
    return abs(math.remainder(a - b, 2 * math.pi))


@pytest.mark.slow
@given(q=states, speed=st.floats(0.1, 5.0), rate=st.floats(0.1, 5.0), holonomic=st.booleans())
def test_each_configuration_is_reached_in_order(q: FloatArray, speed: float, rate: float, holonomic: bool) -> None:
    drive = Drive(q, speed, rate, holonomic=holonomic)
    reached = drive.poses(drive.times)
    at = 0
    for x, y, theta in q:
        while math.hypot(*(reached[at, :2] - (x, y))) > 1e-5 or turn(reached[at, 2], theta) > 1e-5:
            at += 1
            assert at < len(reached), (x, y, theta)
    # Before and after, the robot stands.
    assert np.array_equal(drive.poses([-1.0, drive.times[-1] + 1.0]), reached[[0, -1]])
    assert np.abs(drive.velocities([-1.0, drive.times[-1] + 1.0])).max() == 0.0


@pytest.mark.slow
@given(q=states, speed=st.floats(0.1, 5.0), rate=st.floats(0.1, 5.0))
def test_velocities_are_the_poses_derivative(q: FloatArray, speed: float, rate: float) -> None:
    drive = Drive(q, speed, rate)
    middle = 0.5 * (drive.times[1:] + drive.times[:-1])
    middle = middle[np.diff(drive.times) > 1e-3]
    h = 1e-5
    before, after = drive.poses(middle - h), drive.poses(middle + h)
    here = drive.poses(middle)
    v, omega = drive.velocities(middle).T
    assert (np.abs(v) <= speed * (1 + 1e-9)).all()
    assert (np.abs(omega) <= rate * (1 + 1e-9)).all()
    dx, dy = ((after - before)[:, :2] / (2 * h)).T
    assert np.abs(dx - v * np.cos(here[:, 2])).max(initial=0.0) < 1e-5
    assert np.abs(dy - v * np.sin(here[:, 2])).max(initial=0.0) < 1e-5
    dtheta = np.angle(np.exp(1j * (after[:, 2] - before[:, 2]))) / (2 * h)
    assert np.abs(dtheta - omega).max(initial=0.0) < 1e-5


def test_a_circle_is_driven_as_arcs() -> None:
    angle = np.linspace(0.0, 3.0, 40)
    circle = np.column_stack([5 * np.sin(angle), 5 - 5 * np.cos(angle), angle])
    drive = Drive(circle, 2.0, 10.0)
    assert len(drive.times) == 40
    assert drive.times[-1] == pytest.approx(15.0 / 2.0)
    poses = drive.poses(np.linspace(0.0, drive.times[-1], 500))
    assert np.abs(np.hypot(poses[:, 0], poses[:, 1] - 5.0) - 5.0).max() < 1e-9
    assert drive.velocities([1.0])[0] == pytest.approx([2.0, 0.4])
    back = Drive(circle[::-1], 2.0, 10.0)
    assert len(back.times) == 40
    assert back.velocities([1.0])[0] == pytest.approx([-2.0, -0.4])
