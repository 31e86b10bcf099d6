"""What may go wrong beside the node: goals that cross, maps that change under way, garbage on every topic."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.slow.ros.support import (
    CORNERS,
    FROM,
    LONG,
    SQUARE,
    TO,
    Client,
    collides,
    facts,
    filled,
    grid,
    name_space,
    room,
    running,
    slit,
    stamped,
    states,
)

from action_msgs.msg import GoalStatus  # isort: skip
from builtin_interfaces.msg import Time  # isort: skip
from diagnostic_msgs.msg import DiagnosticArray  # isort: skip
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped  # isort: skip
from map_msgs.msg import OccupancyGridUpdate  # isort: skip
from nav2_msgs.action import ComputePathThroughPoses  # isort: skip
from nav2_msgs.srv import IsPathValid  # isort: skip
from nav_msgs.msg import OccupancyGrid, Odometry, Path  # isort: skip
from nav_msgs.srv import GetPlan  # isort: skip
from visualization_msgs.msg import Marker, MarkerArray  # isort: skip

HERE, THERE = (2.0, 2.0, 0.3), (17.0, 10.0, -1.2)
SECONDS = 6.0


@pytest.fixture
def puzzled(client: Client) -> Client:
    """A client whose node may search for two minutes."""
    assert client.set(footprint=LONG, time_limit=120.0) == []
    client.show(slit())
    return client


EASY = (8.0, 1.6, 0.0)


def test_a_newer_goal_ends_the_older_one(puzzled: Client) -> None:
    paths = puzzled.hear(Path, "plan")
    older = puzzled.goal(TO, FROM)
    puzzled.spin(0.5)
    newer = puzzled.plan(FROM, EASY)
    assert newer.error_code == 0, newer.error_msg
    assert puzzled.result(older).error_code == newer.UNKNOWN
    puzzled.spin(0.5)
    assert np.allclose(states(paths[-1])[-1], EASY)


def test_of_eight_goals_at_once_the_last_is_planned_and_all_can_be_cancelled(puzzled: Client) -> None:
    """They are more than the node has threads."""
    futures = [puzzled.send(TO, FROM) for _ in range(7)] + [puzzled.send(EASY, FROM)]
    results = [puzzled.result(puzzled.wait(future)) for future in futures]
    assert [result.error_code for result in results[:-1]] == [200] * 7
    assert results[-1].error_code == 0, results[-1].error_msg
    handles = [puzzled.goal(TO, FROM) for _ in range(8)]
    puzzled.spin(0.5)
    for handle in handles:
        puzzled.wait(handle.cancel_goal_async())
    ends = [puzzled.wait(handle.get_result_async()).status for handle in handles]
    assert ends[-1] == GoalStatus.STATUS_CANCELED
    assert set(ends) <= {GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED}
    assert puzzled.plan(FROM, EASY).error_code == 0


def test_a_map_that_comes_while_it_plans_is_planned_in(puzzled: Client) -> None:
    """The new map has a way, the old one has none."""
    handle = puzzled.goal(TO, FROM)
    puzzled.spin(0.5)
    cells = np.zeros_like(slit())
    cells[50:60, 20:80] = True
    puzzled.publish("map", grid(cells))
    puzzled.shown = None
    puzzled.spin(0.5)
    puzzled.wait(handle.cancel_goal_async())
    puzzled.result(handle)
    result = puzzled.plan(FROM, TO)
    assert result.error_code == 0, result.error_msg
    long = np.array([[-1.2, -0.2], [1.2, -0.2], [1.2, 0.2], [-1.2, 0.2]])
    assert not collides(filled(states(result.path), 0.02), cells, long)


def test_following_gives_way_to_a_newer_goal(puzzled: Client) -> None:
    """A map comes in which the plan that is followed has no way, and no proof of that."""
    puzzled.show(np.zeros_like(slit()))
    assert puzzled.plan(FROM, TO).error_code == 0
    puzzled.publish("map", grid(slit()))
    puzzled.shown = None
    puzzled.spin(1.0)
    assert puzzled.plan(FROM, EASY).error_code == 0


class Judge:
    """Remembers maps of 1,000 x 1,000 cells by their stamps, and looks at every path on the map that it was made in."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.base = np.zeros((1000, 1000), np.bool_)
        self.base[[0, -1]] = self.base[:, [0, -1]] = self.base[:400, 500:510] = self.base[600:, 500:510] = True
        self.windows: dict[str, NDArray[np.bool_]] = {}
        self.paths, self.told = client.hear(Path, "plan"), client.hear(DiagnosticArray, "/diagnostics")

    def cells(self, window: NDArray[np.bool_]) -> NDArray[np.bool_]:
        cells = self.base.copy()
        cells[400:600, 400:600] = window
        return cells

    def publish(self, rng: np.random.Generator, seconds: float, *, whole: bool) -> None:
        """Publish maps, or what changed of them, 20 times a second."""
        for n in range(int(20 * seconds)):
            due = time.monotonic() + 0.05
            window, stamp = np.zeros((200, 200), np.bool_), self.client.now()
            for (x, y), half in zip(rng.integers(0, 200, (12, 2)), rng.integers(4, 16, 12), strict=True):
                window[max(0, y - half) : y + half, max(0, x - half) : x + half] = True
            self.windows[f"{stamp.sec}.{stamp.nanosec:09d}"] = window
            message: Any = grid(self.cells(window), 0.05)
            if not whole and n:
                message = OccupancyGridUpdate(x=400, y=400, width=200, height=200)
                message.header.frame_id = "map"
                message.data.frombytes((window * np.int8(100)).tobytes())
            message.header.stamp = stamp
            self.client.publish("map_updates" if not whole and n else "map", message)
            self.client.spin(due - time.monotonic())

    def latencies(self) -> list[float]:
        """Judge all paths; return the seconds from maps to the paths in them."""
        found, by_stamp = [], {seconds_of(path): path for path in self.paths}
        for message in self.told:
            told = facts(message)
            window, path = self.windows.get(told["map stamp"]), by_stamp.get(float(told["path stamp"] or 0.0))
            if window is not None and path is not None:
                found.append(seconds_of(message) - float(told["map stamp"]))
                assert not path.poses or not collides(filled(states(path), 0.04), self.cells(window), CORNERS, 0.05)
        return found


def seconds_of(message: Any) -> float:
    return float(f"{message.header.stamp.sec}.{message.header.stamp.nanosec:09d}")


def test_every_path_is_free_in_its_map_at_twenty_maps_a_second_and_memory_does_not_grow() -> None:
    space = name_space()
    with running(space, footprint=f"'{SQUARE}'") as node:
        client, rng = Client(space), np.random.default_rng(7)
        judge = Judge(client)
        client.show(judge.cells(np.zeros((200, 200), np.bool_)), 0.05)
        assert client.plan((5.0, 25.0, 0.0), (45.0, 26.0, 1.0)).error_code == 0
        for whole in (True, False):
            judge.publish(rng, SECONDS / 6, whole=whole)
        before, warm = node.memory(), len(judge.windows)
        for whole in (True, False):
            judge.publish(rng, SECONDS / 3, whole=whole)
        client.spin(1.0)
        growth = node.memory() - before
        assert len(judge.latencies()) > warm / 4
        assert growth < 20.0
        assert "Traceback" not in node.said(), node.said()


NAN, INF = float("nan"), float("inf")
POSES = [(NAN, 0.0, 0.0), (INF, 1.0, 0.0), (1.0, -INF, 0.0), (1e300, 1e300, 0.0), (2.0, 2.0, NAN)]


def poses() -> list[PoseStamped]:
    lying = stamped(HERE)
    lying.pose.orientation.x = lying.pose.orientation.w = 1e200
    return [*map(stamped, POSES), PoseStamped(), stamped(HERE, "elsewhere"), stamped(HERE, "map\n\0x"[:4]), lying]


def test_garbage_for_poses_is_refused_and_the_node_lives(client: Client) -> None:
    for pose in poses():
        for start, goal in ((pose, THERE), (HERE, pose)):
            assert client.plan(start, goal).error_code != 0
            assert client.plan(start, [goal, HERE], ComputePathThroughPoses).error_code != 0
            assert (
                not client.call(GetPlan, "get_plan", start=stamped(start), goal=stamped(goal)).plan.poses
                or start is pose
            )
        client.publish("goal_pose", pose)
        told = PoseWithCovarianceStamped(header=pose.header)
        told.pose.pose = pose.pose
        client.publish("initialpose", told)
        client.publish("amcl_pose", told)
        odometry = Odometry(header=pose.header)
        odometry.pose.pose = pose.pose
        client.publish("odom", odometry)
        path = Path(header=pose.header, poses=[stamped(HERE), pose])
        assert not client.call(IsPathValid, "is_path_valid", path=path).is_valid
    assert client.plan(HERE, THERE).error_code == 0


def test_garbage_for_maps_is_refused_and_the_map_before_it_stays(client: Client) -> None:
    wrong = [grid(room(), resolution) for resolution in (0.0, NAN, INF, -0.1, 1e-30, 1e30)]
    wrong += [grid(room(), origin=origin) for origin in POSES]
    wrong += [OccupancyGrid(), grid(room()[:0]), grid(room()[:, :0])]
    for change in (1, 1000, 2**32 - 1 - 120):
        message = grid(room())
        message.info.height += change
        wrong.append(message)
    flat = grid(room())
    flat.info.origin.orientation.w = 0.0
    for message in [*wrong, flat]:
        client.publish("map", message)
        client.spin(0.05)
    for x, y, width, height, n in (
        (190, 0, 20, 1, 20),
        (-1, 0, 1, 1, 1),
        (0, 119, 1, 2, 2),
        (0, 0, 2, 2, 3),
        (0, 0, 2**32 - 1, 1, 1),
    ):
        update = OccupancyGridUpdate(x=x, y=y, width=width, height=height)
        update.header.stamp = client.now()
        update.data.frombytes(bytes([100] * n))
        client.publish("map_updates", update)
    for stamp, frame in ((client.now(), "elsewhere"), (Time(sec=5), "map")):  # the map is newer
        update = OccupancyGridUpdate(width=200, height=120)
        update.header.stamp, update.header.frame_id = stamp, frame
        update.data.frombytes(bytes([0] * 24000))
        client.publish("map_updates", update)
    client.spin(0.3)
    result = client.plan(HERE, THERE)
    assert result.error_code == 0, result.error_msg
    assert not collides(filled(states(result.path), 0.02), room(), CORNERS)
    assert client.set(path_spacing=0.05) == []


def test_maps_of_one_cell_and_of_sixteen_million(client: Client) -> None:
    client.show(np.zeros((1, 1), np.bool_))
    assert client.plan(HERE, THERE).error_code == 203
    client.show(np.zeros((1, 1), np.bool_), 10.0)
    assert client.plan((2.0, 2.0, 0.0), (8.0, 8.0, 1.0)).error_code == 0
    cells = np.zeros((4000, 4000), np.bool_)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[:600, 2000] = True
    assert client.set(time_limit=20.0) == []
    client.show(cells, 0.05)
    result = client.plan((10.0, 10.0, 0.0), (190.0, 10.0, 1.0))
    assert result.error_code == 0, result.error_msg
    assert not collides(filled(states(result.path), 0.1), cells, CORNERS, 0.05)


def test_garbage_for_obstacles_takes_no_good_one_with_it(client: Client) -> None:
    """The good one closes the nearer door."""
    values = (NAN, INF, -1.0, 0.0, 1e300, 1e12)
    wrong = [Marker(type=kind) for kind in range(-1, 13)]
    for value in values:
        wrong += [Marker(type=kind, pose=stamped((value, 1.0, 0.0)).pose) for kind in (1, 3, 4, 11)]
        for kind in (1, 3):
            wrong.append(Marker(type=kind, pose=stamped((5.0, 9.0, 0.0)).pose))
            wrong[-1].scale.x = wrong[-1].scale.y = -1.0 if value > 1e11 else value
        corners = [Point(x=3.0, y=8.0), Point(x=value, y=9.0), Point(x=4.0, y=value)]
        wrong += [Marker(type=4, points=corners), Marker(type=4, points=corners[:2]), Marker(type=11, points=corners)]
    crossed = [Point(x=x, y=y) for x, y in ((3.0, 8.0), (4.0, 9.0), (4.0, 8.0), (3.0, 9.0))]
    wrong += [Marker(type=4, points=crossed), Marker(type=4, points=[crossed[0]] * 5), Marker(action=77)]
    for number, one in enumerate(wrong):
        one.id = number
        if one.type in (4, 11):
            one.pose.orientation.w = 1.0
    elsewhere = Marker(type=1, pose=stamped(HERE).pose)
    elsewhere.header.frame_id = "elsewhere"
    good = Marker(type=1, id=1000, pose=stamped((10.0, 2.6, 0.0)).pose)
    good.scale.x = good.scale.y = 1.6
    client.publish("obstacles", MarkerArray(markers=[*wrong, elsewhere, good]))
    client.spin(0.5)
    for one in wrong:
        client.publish("obstacles", MarkerArray(markers=[one]))
    client.spin(1.0)
    client.publish("obstacles", MarkerArray(markers=[Marker(action=Marker.DELETE, id=one.id) for one in wrong]))
    client.spin(0.5)
    result = client.plan((8.0, 2.6, 0.0), (12.0, 2.6, 0.0))
    assert result.error_code == 0, result.error_msg
    assert states(result.path)[:, 1].max() > 8.0
    client.publish("obstacles", MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
    client.spin(0.5)
    assert states(client.plan((8.0, 2.6, 0.0), (12.0, 2.6, 0.0)).path)[:, 1].max() < 4.0
