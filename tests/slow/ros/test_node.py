"""What the node answers, by a client in another process; paths are judged by shapely alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from tests.slow.ros.support import CORNERS, SQUARE, collides, facts, filled, room, stamped, states, turned

from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped  # isort: skip
from nav2_msgs.action import ComputePathThroughPoses  # isort: skip
from nav2_msgs.srv import IsPathValid  # isort: skip
from nav_msgs.msg import Odometry, Path  # isort: skip
from nav_msgs.srv import GetPlan  # isort: skip
from visualization_msgs.msg import Marker, MarkerArray  # isort: skip

HERE, THERE = (2.0, 2.0, 0.3), (17.0, 10.0, -1.2)
WALL = 10.0, 6.0, 0.0


def free(path: Any, **options: Any) -> bool:
    return not collides(filled(states(path), 0.02), room(), CORNERS, **options)


def test_a_path_is_free_from_its_start_to_its_goal(client: Any) -> None:
    published = client.hear(Path, "plan")
    client.diagnostics.clear()
    result = client.plan(HERE, THERE)
    assert result.error_code == 0
    path = states(result.path)
    assert np.allclose(path[[0, -1]], [HERE, THERE])
    assert np.hypot(*np.diff(path[:, :2], axis=0).T).max() <= 0.05 + 1e-9
    assert free(result.path)
    assert result.planning_time.sec + result.planning_time.nanosec > 0
    assert result.path.header.frame_id == "map"
    client.until(lambda: published and published[-1] == result.path)
    stamp = f"{result.path.header.stamp.sec}.{result.path.header.stamp.nanosec:09d}"
    client.until(lambda: client.diagnostics and facts(client.diagnostics[-1])["path stamp"] == stamp)
    told = facts(client.diagnostics[-1])
    assert 0.0 < float(told["lower bound"]) <= float(told["cost"])


def test_a_disc_faces_its_way_and_at_its_end_the_goal(client: Any) -> None:
    assert client.set(robot_radius=0.3, footprint="") == []
    result = client.plan(HERE, THERE)
    path = states(result.path)
    assert np.allclose(path[[0, -1], :2], [HERE[:2], THERE[:2]])
    assert turned(path[-1, 2] - THERE[2]) == pytest.approx(0.0)
    move = np.diff(path[:, :2], axis=0)
    assert np.allclose(turned(np.arctan2(move[:, 1], move[:, 0]) - path[:-1, 2]), 0.0, atol=1e-6)
    assert not collides(filled(path, 0.02), room(), 0.3)


@pytest.mark.parametrize("model", ["differential", "dubins", "reeds_shepp"])
def test_a_path_can_be_driven(client: Any, model: str) -> None:
    assert client.set(motion_model=model, minimum_turning_radius=0.7) == []
    result = client.plan(HERE, THERE)
    assert result.error_code == 0, result.error_msg
    path = states(result.path)
    assert np.allclose(path[[0, -1]], [HERE, THERE])
    assert not collides(path, room(), CORNERS)
    assert client.call(IsPathValid, "is_path_valid", path=result.path).is_valid
    move, turn = np.diff(path[:, :2], axis=0), turned(np.diff(path[:, 2]))
    heading = path[:-1, 2] + 0.5 * turn
    along = (move * np.column_stack([np.cos(heading), np.sin(heading)])).sum(1)
    across = (move * np.column_stack([-np.sin(heading), np.cos(heading)])).sum(1)
    assert np.abs(across).max() < 1e-3
    if model != "differential":
        assert np.all(2.0 * 0.7 * np.sin(0.5 * np.abs(turn)) <= np.abs(along) + 1e-3)
    if model == "dubins":
        assert along.min() >= 0.0


@pytest.mark.parametrize(
    ("start", "goal", "code"),
    [
        (WALL, THERE, "START_OCCUPIED"),
        (HERE, WALL, "GOAL_OCCUPIED"),
        ((-1.0, 2.0, 0.0), THERE, "START_OUTSIDE_MAP"),
        (HERE, (30.0, 2.0, 0.0), "GOAL_OUTSIDE_MAP"),
        (stamped(HERE, "nowhere"), THERE, "TF_ERROR"),
        (HERE, stamped(THERE, "nowhere"), "TF_ERROR"),
    ],
)
def test_what_cannot_be_planned_has_its_code(client: Any, start: Any, goal: Any, code: str) -> None:
    result = client.plan(start, goal)
    assert result.error_code == getattr(type(result), code), result.error_msg
    assert result.error_msg
    assert not result.path.poses


def test_that_no_way_leads_through_the_doors_is_proven(client: Any) -> None:
    assert client.set(robot_radius=0.85, footprint="", time_limit=20.0) == []
    result = client.plan(HERE, THERE)
    assert result.error_code == result.NO_VALID_PATH
    assert "proven" in result.error_msg


def test_a_path_leads_through_poses_in_their_order(client: Any) -> None:
    goals = [(5.0, 9.0, 2.0), (15.0, 3.0, 0.0), (4.0, 4.0, -3.0)]
    result = client.plan(HERE, goals, ComputePathThroughPoses)
    assert result.error_code == 0, result.error_msg
    path = states(result.path)
    at = [int(np.argmin(np.abs(path - goal).sum(1))) for goal in goals]
    assert np.allclose(path[[0, *at]], [HERE, *goals])
    assert at == sorted(at)
    assert at[-1] == len(path) - 1
    assert free(result.path)
    assert client.plan(HERE, [goals[0], WALL], ComputePathThroughPoses).error_code == result.GOAL_OCCUPIED
    assert client.plan(HERE, [], ComputePathThroughPoses).error_code == result.NO_VIAPOINTS_GIVEN


def test_poses_with_a_tolerance_are_passed_where_the_whole_path_is_short(client: Any) -> None:
    goals = [(5.0, 9.0, 2.0), (15.0, 3.0, 0.0)]
    assert client.set(improvement_time=0.2) == []
    exact = states(client.plan(HERE, goals, ComputePathThroughPoses).path)
    assert client.plan(HERE, THERE).error_code == 0  # else the plan that is followed would be kept
    assert client.set(tolerance=0.5) == []
    result = client.plan(HERE, goals, ComputePathThroughPoses)
    assert client.set(tolerance=0.0, improvement_time=0.003) == []
    path = states(result.path)
    near = [np.hypot(*(path[:, :2] - goal[:2]).T) for goal in goals]
    assert np.flatnonzero(near[0] <= 0.5 + 1e-6)[0] < np.flatnonzero(near[1] <= 0.5 + 1e-6)[0]
    assert near[1][-1] <= 0.5 + 1e-6
    assert free(result.path)
    lengths = [np.hypot(*np.diff(each[:, :2], axis=0).T).sum() for each in (path, exact)]
    assert lengths[0] < lengths[1] - 0.5


def test_a_robot_in_a_wall_is_led_out_if_it_may(client: Any) -> None:
    assert client.set(escape=True) == []
    results = client.plan(WALL, THERE), client.plan(WALL, [HERE, THERE], ComputePathThroughPoses)
    assert client.set(escape=False) == []
    for result in results:
        assert result.error_code == 0, result.error_msg
        path = states(result.path)
        assert np.allclose(path[[0, -1]], [WALL, THERE])
        hits = [collides(filled(path[i : i + 2], 0.02), room(), CORNERS) for i in range(len(path) - 1)]
        out = hits.index(False)
        assert 0 < out < len(hits)
        assert not any(hits[out:])


def test_is_path_valid_says_where_a_path_meets_a_wall(client: Any) -> None:
    def valid(poses: Any) -> Any:
        return client.call(IsPathValid, "is_path_valid", path=Path(poses=[stamped(pose) for pose in poses]))

    result = client.plan(HERE, THERE)
    assert valid(result.path.poses).is_valid
    through = np.column_stack([np.linspace(2.0, 17.0, 151), np.full(151, 6.05), np.zeros(151)])
    answer = valid(through)
    first = next(i for i in range(1, 151) if collides(filled(through[i - 1 : i + 1], 1e-3), room(), CORNERS))
    assert not answer.is_valid
    assert answer.invalid_pose_indices[0] == first
    assert not valid([]).is_valid
    assert not valid([HERE, (np.nan, 0.0, 0.0)]).is_valid
    assert not valid([HERE, (np.inf, 0.0, 0.0)]).is_valid
    assert not valid([stamped(HERE), PoseStamped()]).is_valid
    # The service of before nav2 answers, and nobody follows its path.
    published = client.hear(Path, "plan")
    path = client.call(GetPlan, "get_plan", start=stamped(HERE), goal=stamped(THERE)).plan
    assert np.allclose(states(path)[[0, -1]], [HERE, THERE])
    assert free(path)
    assert not client.call(GetPlan, "get_plan", start=stamped(HERE), goal=stamped(WALL)).plan.poses
    assert path not in published


@pytest.mark.parametrize("topic", ["initialpose", "amcl_pose"])
def test_a_goal_of_rviz_is_planned_from_the_pose_and_what_was_driven_since(client: Any, topic: str) -> None:
    def drive(pose: Any) -> None:
        message = Odometry()
        message.pose.pose = stamped(pose).pose
        client.publish("odom", message)
        client.spin(0.3)

    published = client.hear(Path, "plan")
    drive((5.0, 5.0, np.pi / 2))
    told = PoseWithCovarianceStamped()
    told.header.frame_id, told.pose.pose = "map", stamped((3.0, 3.0, 0.0)).pose
    client.publish(topic, told)
    client.spin(0.3)
    published.clear()
    drive((5.0, 7.0, np.pi))  # two metres ahead, and a quarter turn to the left
    client.publish("goal_pose", stamped(THERE))
    client.until(lambda: published)
    assert np.allclose(states(published[-1])[[0, -1]], [(5.0, 3.0, np.pi / 2), THERE])
    assert free(published[-1])


def marker(kind: int, points: Any = (), scale: Any = (0.0, 0.0), pose: Any = (0.0, 0.0, 0.0)) -> Marker:
    made = Marker(type=kind, id=kind, pose=stamped(pose).pose, points=[Point(x=x, y=y) for x, y in points])
    made.header.frame_id = "map"
    made.scale.x, made.scale.y = scale
    return made


@pytest.mark.parametrize("kind", ["LINE_STRIP", "TRIANGLE_LIST", "CYLINDER", "CUBE"])
def test_a_path_leads_around_obstacles_until_they_are_deleted(client: Any, kind: str) -> None:
    """Both doors of the room: one in the way is the long way round."""
    corners = [(9.3, 1.5), (10.7, 1.5), (10.7, 4.0), (9.3, 4.0)]
    shown = {
        "LINE_STRIP": marker(Marker.LINE_STRIP, [*corners, corners[0]]),
        "TRIANGLE_LIST": marker(Marker.TRIANGLE_LIST, [*corners[:3], *corners[2:], corners[0]]),
        "CYLINDER": marker(Marker.CYLINDER, scale=(1.4, 1.4), pose=(10.0, 2.6, 0.0)),
        "CUBE": marker(Marker.CUBE, scale=(2.5, 1.4), pose=(10.0, 2.75, np.pi / 2)),
    }[kind]
    start, goal = (8.0, 2.0, 0.0), (12.0, 2.0, 0.0)
    paths = client.hear(Path, "plan")

    def shows(action: int, long: bool) -> Any:
        shown.action = action
        client.publish("obstacles", MarkerArray(markers=[shown]))
        client.until(lambda: paths and (states(paths[-1])[:, 1].max(initial=0.0) > 8.0) == long)
        return states(paths[-1])

    assert states(client.plan(start, goal).path)[:, 1].max() < 4.0
    around = shows(Marker.ADD, long=True)
    body = shapely.Point(10.0, 2.6).buffer(0.7) if kind == "CYLINDER" else shapely.Polygon(corners)
    assert shapely.distance(shapely.MultiPoint(around[:, :2]), body) >= 0.2
    assert not collides(filled(around, 0.02), room(), CORNERS)
    back = shows(Marker.DELETEALL if kind == "CUBE" else Marker.DELETE, long=False)
    assert np.allclose(back[-1], goal)


def test_a_map_may_be_turned(client: Any) -> None:
    origin = 3.0, -2.0, 0.3
    c, s = np.cos(0.3), np.sin(0.3)
    start, goal = ((3.0 + c * x - s * y, -2.0 + s * x + c * y, t + 0.3) for x, y, t in (HERE, THERE))
    client.show(room(), origin=origin)
    result = client.plan(start, goal)
    assert np.allclose(states(result.path)[[0, -1]], [start, goal])
    assert free(result.path, origin=origin)


def test_who_subscribes_sees_roadmap_landmarks_and_footprints(client: Any) -> None:
    heard = [client.hear(MarkerArray, name) for name in ("roadmap", "landmarks", "swept_footprint")]
    client.spin(0.5)
    path = client.plan(HERE, (16.0, 3.0, 1.0)).path
    client.until(lambda: all(heard))
    edges, landmarks, swept = (messages[-1].markers[0] for messages in heard)
    assert len(edges.points) % 2 == 0
    assert {(p.x, p.y) for p in edges.points} <= {(p.x, p.y) for p in landmarks.points}
    assert len(swept.points) == len(path.poses) * 2 * len(CORNERS)
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    assert np.allclose((swept.points[0].x, swept.points[0].y), HERE[:2] + turn @ CORNERS[0])


WRONG: list[tuple[str, Any, str]] = [
    ("footprint", "[[0, 0], [1, 1]]", "different points"),
    ("footprint", "a square", "expected"),
    ("robot_radius", -1.0, "0 to"),
    ("robot_radius", float("nan"), "0 to"),
    ("robot_radius", "wide", "number"),
    ("motion_model", "hovercraft", "omnidirectional"),
    ("minimum_turning_radius", 0.0, "0.001"),
    ("clearance", float("inf"), "0 to"),
    ("objective", "beauty", "length"),
    ("tolerance", -0.1, "0 to"),
    ("time_limit", 0.0, "0.001"),
    ("improvement_time", [1.0], "number"),
    ("lethal_cost_threshold", 101, "1 to 100"),
    ("allow_unknown", "perhaps", "true or false"),
    ("zones_file", "no/such/file.yaml", "no/such/file.yaml"),
    ("zones_file", "/", "/"),
    ("path_spacing", 0.0, "0.001"),
    ("robot_base_frame", 3, "text"),
]


def test_a_wrong_value_is_refused_with_the_reason(client: Any) -> None:
    for name, value, reason in WRONG:
        (refused,) = client.set(**{name: value})
        assert reason in refused, name
    assert client.plan(HERE, THERE).error_code == 0


def test_after_a_change_of_footprint_the_plan_is_certified_for_the_new_one(client: Any) -> None:
    """The new robot fits through the wider door alone."""
    start, goal = (8.0, 9.5, 0.0), (12.0, 9.5, 0.0)
    assert states(client.plan(start, goal).path)[:, 1].min() > 8.0
    paths = client.hear(Path, "plan")
    wide = [[-0.55, -0.55], [0.55, -0.55], [0.55, 0.55], [-0.55, 0.55]]
    assert client.set(footprint=str(wide)) == []
    client.until(lambda: paths and states(paths[-1])[:, 1].min(initial=9.0) < 4.0)
    for path in (paths[-1], client.plan(start, goal).path):
        assert states(path)[:, 1].min() < 4.0
        assert not collides(filled(states(path), 0.02), room(), wide)


def test_cells_count_by_their_threshold_and_unknown_ones_as_told(client: Any) -> None:
    cells = room() * np.int8(100)
    cells[18:34, 98:102], cells[90:100, 98:102] = 60, -1
    client.show(cells)
    start, goal = (8.0, 2.6, 0.0), (12.0, 2.6, 0.0)
    result = client.plan(start, goal)
    assert result.error_code == 0, result.error_msg
    assert states(result.path)[:, 1].max() < 4.0
    assert client.set(lethal_cost_threshold=60) == []
    assert client.plan(start, goal).error_code == 208
    assert client.set(allow_unknown=True) == []
    assert states(client.plan(start, goal).path)[:, 1].max() > 8.0
    assert client.set(lethal_cost_threshold=100, allow_unknown=False, footprint=SQUARE) == []
