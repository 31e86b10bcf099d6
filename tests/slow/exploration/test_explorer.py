"""The loop of an exploration, on a simulated robot and on robots of one's own."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from tests.helpers import exploration_faults as faults
from tests.helpers.explore_oracle import overlaps, seen_share, truth_of
from tests.helpers.trials import trials

from trailmark import ConfigurationError, LandmarkPlanner, Query, Rectangle, Robot, World
from trailmark.estimation.records import Record
from trailmark.estimation.virtual_sensors import RayCaster, Scanner
from trailmark.exploration import ExplorationProgress, ExplorationResult, ExplorationSettings, Explorer, Outlook
from trailmark.exploration.explorer import MAX_BLOCKED, MAX_STILL
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.exploration.result import keep_exploration, load_exploration
from trailmark.exploration.simulated_robot import SimulatedRobot, laser_scanner

ROBOT = Robot.disc(0.2)
BOUNDS = (0.0, 0.0, 6.0, 4.0)
START = (0.6, 0.6, 0.0)
SETTINGS = ExplorationSettings(cell=0.1, sense_period=0.3)


def two_rooms(door: float, long: float = 6.0, wide: float = 4.0, wall: float | None = None) -> World:
    """A wall across the middle, or at ``wall``, with a door in its middle that is so wide (metres)."""
    height, wall = 0.5 * (wide - door), 0.5 * long if wall is None else wall
    walls = [Rectangle((wall, y), 0.2, height) for y in (0.5 * height, wide - 0.5 * height)]
    start = Query("start", START, START)
    return World("rooms", (0.0, 0.0, long, wide), tuple(walls), ROBOT, queries=(start,))


def explorer(world: World, **options: object) -> Explorer:
    given = {"start": START, "sensor_range": 3.0, "settings": SETTINGS, "noise": 0.0, "strategy": "nearest-frontier"}
    return Explorer(world, **{**given, **options})  # type: ignore[arg-type]  # by name


def check(result: ExplorationResult, world: World, seen: float, sensor_range: float = 3.0) -> None:
    """So much of what shapely says can be seen is known, what is free holds nothing, and nothing was run into."""
    truth, known = truth_of(world, sensor_range), result.known
    assert seen_share(truth, known.state, known.origin, known.cell) >= seen
    assert result.evaluation.seen > seen - 0.02
    assert result.evaluation.collisions == 0
    assert overlaps(truth, world, np.array(result.robot_state["truth"])[:, 1:]) == 0
    # A corner between two beams may be cut.
    assert not shapely.contains_xy(
        truth.solids.buffer(-known.cell), known.centres(*np.nonzero(known.state == FREE))
    ).any()


@pytest.mark.parametrize(
    "sensor", ["laser", Scanner(91, 0.5 * np.pi, 3.0)], ids=["all around", "what lies behind its back"]
)
def test_all_that_can_be_seen_is_seen(sensor: Any) -> None:
    world = two_rooms(1.0)
    result = explorer(world, sensor=sensor).run()
    assert result.status == "complete"
    assert "seen" in result.reason
    check(result, world, 0.99)
    assert len(result.decisions) >= result.history[-1].landmarks >= 1
    assert np.isfinite(result.first_known).sum() == (result.known.state != UNKNOWN).sum()


def test_where_the_robot_does_not_fit_it_looks_through() -> None:
    # hrnr/m-explore#40: the robot won't fit, but laser beams will.
    world = two_rooms(0.3, 4.0, 2.4)
    result = explorer(world).run()
    assert result.status == "complete"  # proven by where the beams ended, whatever the cells are
    # The slot is three cells wide: along the edges of what is seen through it, cells count as not seen.
    check(result, world, 0.9)
    assert max(progress.pose[0] for progress in result.history) < 2.0
    assert (result.known.state[:, 25:] == FREE).any()
    closed = explorer(two_rooms(0.0)).run()
    assert closed.status == "complete"
    assert (closed.known.state[:, 32:] == UNKNOWN).all()


def blocks(seed: int) -> World:
    """Blocks here and there, one of them hollow, around a start."""
    rng = np.random.default_rng(seed)
    places = [(x, y, *rng.uniform(0.1, 0.45, 2)) for x, y in rng.uniform((0.2, 0.2), (3.8, 2.8), (8, 2))]
    boxes = [Rectangle((x, y), w, h) for x, y, w, h in places if x > 1.2 or y > 1.2]
    hollow = [Rectangle((3.3, y), 0.6, 0.05) for y in (2.0, 2.55)] + [
        Rectangle((x, 2.275), 0.05, 0.6) for x in (3.0, 3.6)
    ]
    return World("blocks", (0.0, 0.0, 4.0, 3.0), (*boxes, *hollow), queries=(Query("start", START, START),))


@pytest.mark.parametrize("robot", [ROBOT, Robot.rectangle(0.5, 0.3)], ids=["disc", "rectangle"])
@pytest.mark.parametrize("seed", trials(4, of=2))
def test_at_the_end_nothing_is_in_sight_from_where_the_robot_gets_to(seed: int, robot: Robot) -> None:
    world = replace(blocks(seed), robot=robot)
    result = explorer(world, sensor_range=2.0, settings=replace(SETTINGS, cell=0.04), strategy="tour").run()
    assert result.status.startswith("complete")
    check(result, world, 0.995, 2.0)
    assert (result.known.state[52:62, 77:88] == UNKNOWN).all()  # nobody sees into what is closed


def test_what_only_a_finer_map_could_tell_is_said() -> None:
    # Two rooms and a gap that is 4 cm wider than the robot.
    walls = Rectangle((2.8, 0.69), 0.5, 1.38), Rectangle((2.8, 2.91), 0.5, 1.38)
    start = Query("start", (1.0, 1.0, 0.4), (4.6, 2.6, 0.0))
    world = World("gap", (0.0, 0.0, 5.6, 3.6), walls, Robot.disc(0.4), queries=(start,))
    for cell, status in ((0.08, "complete-at-confidence"), (0.02, "complete")):
        settings = ExplorationSettings(cell=cell, sense_period=0.3)
        result = Explorer(world, sensor_range=4.0, noise=0.0, settings=settings).run()
        assert result.status == status
        assert result.evaluation.collisions == 0
        if cell > 0.02:
            assert result.evaluation.seen < 0.95  # some of the other room, through the gap
            assert "narrower than the robot and two cells of 0.08 m" in result.reason
            assert "a smaller --cell" in result.reason
        else:
            assert result.evaluation.seen > 0.98


def test_a_function_of_the_users_chooses() -> None:
    asked = list[Outlook]()

    def last(outlook: Outlook) -> int:
        asked.append(outlook)
        return len(outlook.landmarks) - 1

    result = explorer(two_rooms(1.0), strategy=last).run()
    assert (result.status, result.strategy) == ("complete", "last")
    assert all(len(outlook.costs) == len(outlook.landmarks) > 0 for outlook in asked)
    with pytest.raises(ConfigurationError, match="expected the index of one of"):
        explorer(two_rooms(1.0), strategy=lambda outlook: -1).run()


@pytest.mark.parametrize(
    ("settings", "status"),
    [({"time_limit": 1.0}, "time"), ({"distance_limit": 0.5}, "distance"), ({"return_home": True}, "complete")],
)
def test_it_ends_by_its_limits(settings: dict[str, float], status: str) -> None:
    result = explorer(two_rooms(1.0), settings=replace(SETTINGS, **settings)).run()  # type: ignore[arg-type]  # by name
    assert result.status == status
    if "return_home" in settings:
        assert np.hypot(*(result.history[-1].pose[:2] - START[:2])) < 0.01


def by_raising() -> None:
    raise KeyboardInterrupt


def by_signal() -> None:
    signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("interrupt", [by_raising, by_signal])
def test_ctrl_c_keeps_what_is_known(interrupt: Callable[[], None]) -> None:
    def stop(progress: ExplorationProgress) -> None:
        if progress.distance > 0.5:
            interrupt()

    result = explorer(two_rooms(1.0)).run(stop)
    assert result.status == "interrupted"
    assert result.history[-1].distance > 0.5
    assert (result.known.state == FREE).sum() * result.known.cell**2 > 3.0
    assert result.world.obstacles
    assert len(result.log.records) > 10


def faulty(
    wrap: Callable[[SimulatedRobot], object], world: World | None = None, settings: ExplorationSettings = SETTINGS
) -> Explorer:
    world = two_rooms(1.0) if world is None else world
    robot = SimulatedRobot(world, ROBOT, START, laser_scanner(3.0, 0.1), noise=0.0)
    own: Any = wrap(robot)  # it has the two methods
    options = {"start": START, "bounds": BOUNDS, "settings": settings, "strategy": "nearest-frontier"}
    return Explorer(own, ROBOT, robot.sensor, **options)  # type: ignore[arg-type]  # by name


def test_a_silent_sensor_ends_it() -> None:
    result = faulty(lambda robot: faults.Faulty(robot, faults.silence, 2.0)).run()
    assert result.status == "silent"
    assert "no reading for" in result.reason
    assert (result.known.state == FREE).sum() * result.known.cell**2 > 3.0
    never = faulty(lambda robot: faults.Faulty(robot, faults.silence)).run()
    assert never.status == "silent"
    assert not never.world.obstacles
    assert not never.known.state.any()


def test_a_clock_may_begin_at_any_time() -> None:
    def later(records: list[Record]) -> list[Record]:
        return [record._replace(t=record.t + 1.7e9) for record in records]

    result = faulty(lambda robot: faults.Faulty(robot, later, -1.0), settings=replace(SETTINGS, time_limit=1.2)).run()
    assert result.status == "time"
    assert result.history[-1].time == pytest.approx(1.7e9 + 1.2, abs=0.2)
    assert result.history[-1].distance > 0.5


class Idle:
    """A robot that stays where it is, and reports what it is told to; ``sensed`` in place of what it senses."""

    def __init__(self, robot: SimulatedRobot, report: dict[str, bool] | None, sensed: object = None) -> None:
        self.robot, self.report, self.sensed, self.commands = robot, report, sensed, 0

    def sense(self) -> object:
        return self.robot.sense() if self.sensed is None else self.sensed

    def drive(self, states: np.ndarray, seconds: float) -> object:
        self.commands += len(states) > 1  # else it is to stand and sense
        report = self.robot.drive(np.zeros((1, 3)), seconds)
        return None if self.report is None else report._replace(**(self.report if len(states) > 1 else {}))


@pytest.mark.parametrize(
    ("report", "said", "most"),
    [
        ({"arrived": False}, "stays where it is", MAX_STILL),
        ({"arrived": True}, "stays where it is", MAX_STILL),
        ({"arrived": False, "blocked": True}, "in the robot's way", MAX_BLOCKED),
    ],
)
def test_a_robot_that_does_not_move_is_stuck(report: dict[str, bool], said: str, most: int) -> None:
    robots = list[Idle]()
    result = faulty(lambda robot: robots.append(Idle(robot, report)) or robots[0]).run()  # type: ignore[func-returns-value]
    assert result.status == "stuck"
    assert said in result.reason or most == MAX_BLOCKED
    assert robots[0].commands <= most + 2


@pytest.mark.parametrize(
    ("sensed", "message"),
    [(None, "drive: expected"), (3, "sense: expected a sequence"), (["beep"], r"sense\[0\]: expected")],
)
def test_a_robot_has_to_say_what_is_asked_of_it(sensed: object, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        faulty(lambda robot: Idle(robot, None, sensed)).run()


@pytest.mark.parametrize(
    ("wall", "reach", "behind", "statuses"),
    [
        (3.0, 3.0, -1.0, ("complete",)),
        # Where most of what is known lies behind the door, the map may be wrong there: that is no proof of the end.
        (2.0, 1.2, 0.6, ("complete",)),
        (4.5, 1.2, 0.6, ("complete-at-confidence",)),
    ],
)
def test_a_door_that_closes_is_not_driven_into(
    wall: float, reach: float, behind: float, statuses: tuple[str, ...]
) -> None:
    opened, closed = (two_rooms(door, wall=wall) for door in (1.0, 0.0))
    robot = SimulatedRobot(opened, ROBOT, START, laser_scanner(reach, 0.1), noise=0.0)
    exploring = Explorer(
        robot,
        ROBOT,
        robot.sensor,
        start=START,
        bounds=BOUNDS,
        settings=SETTINGS,
        strategy=lambda outlook: int(np.argmax(outlook.landmarks[:, 0])),
    )
    while exploring.ended is None:
        progress = exploring.step()
        due = progress.distance > 0.4 if behind < 0.0 else progress.pose[0] > wall + behind
        if due and robot.world is opened:
            robot.change_world(closed)
        assert progress.time < 600.0
    assert robot.world is closed
    assert robot.collisions == 0
    assert exploring.ended[0] in statuses
    assert (exploring.mapper.known.state == UNKNOWN).mean() > 0.05


def test_where_no_way_is_found_in_time_it_is_told() -> None:
    # The gap is passed when headed through it, which takes longer to find than 0.1 ms.
    walls = Rectangle((4.0, 1.2), 0.4, 2.4), Rectangle((4.0, 4.6), 0.4, 2.8)
    world, robot = World("gap", (0.0, 0.0, 8.0, 6.0), walls), Robot.rectangle(1.6, 0.7)
    settings = ExplorationSettings(cell=0.07, planning_time=1e-4, sense_period=0.3)
    result = Explorer(world, robot, start=(1.2, 3.0, 1.57), sensor_range=6.0, noise=0.0, settings=settings).run()
    assert result.status == "complete-at-confidence"
    assert "to which no way was found" in result.reason


def test_ways_that_are_not_found_keep_nothing_else_from_being_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = LandmarkPlanner.plan

    def nowhere(planner: LandmarkPlanner, start: Any, goal: Any, *rest: Any, **options: Any) -> Any:
        result = plan(planner, start, goal, *rest, **options)
        return replace(result, status="timeout", path=None) if goal.pose and goal.pose[1] > 3.0 else result

    monkeypatch.setattr(LandmarkPlanner, "plan", nowhere)
    walls = Rectangle((3.5, 3.0), 5.0, 0.2), Rectangle((6.0, 0.6), 0.2, 1.2)
    world = World("halls", (0.0, 0.0, 12.0, 6.0), walls, ROBOT)
    result = explorer(world, sensor_range=2.0).run()
    assert result.status == "complete-at-confidence"
    assert (result.known.state[2:27, 2:-2] != UNKNOWN).mean() > 0.99
    assert sum("none was found" in progress.event for progress in result.history) >= 2


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_what_the_laser_does_not_see_is_run_into_once_and_explored_around(noise: float, tmp_path: Path) -> None:
    glass, seen = Rectangle((2.0, 1.6), 0.1, 1.2), two_rooms(1.2)  # in the straight way from the start to the door
    robot = SimulatedRobot(
        replace(seen, obstacles=(*seen.obstacles, glass)), ROBOT, START, laser_scanner(3.0, 0.1), noise=noise
    )
    robot._caster = RayCaster(seen)  # the glass stops the robot alone
    settings = ExplorationSettings(cell=0.1, sense_period=0.2, confidence=0.99 if noise else None)
    options: dict[str, Any] = {"start": robot.pose, "bounds": BOUNDS, "settings": settings}
    exploring = Explorer(robot, ROBOT, robot.sensor, strategy="nearest-frontier", **options)
    while exploring.ended is None:
        exploring.step()
    assert exploring.ended[0] == "complete"
    assert any("ran into something" in progress.event for progress in exploring.history)
    assert 1 <= robot.collisions <= 6
    known = exploring.mapper.known
    assert (known.state[known.cells_of(np.array([[4.0, 2.0], [5.5, 0.5], [5.5, 3.5]]))] != UNKNOWN).all()
    # Beams have gone through the glass again and again since.
    touched = known.centres(*np.nonzero(known.state == OCCUPIED))
    assert (shapely.distance(shapely.points(touched), glass.polygon().shapely()) <= 0.15).any()
    # Who goes on with it knows that too.
    keep_exploration(exploring.saved(), tmp_path / "run")
    saved = load_exploration(tmp_path / "run")
    assert len(saved.contacts) > 0
    after = Explorer(robot, ROBOT, robot.sensor, resumed=saved, **options).mapper.known
    assert np.array_equal(after.contacts, known.contacts)
    assert (after.state[after.cells_of(saved.contacts)] == OCCUPIED).all()


def test_the_sigma_told_is_that_in_the_frame_of_the_start() -> None:
    exploring = explorer(two_rooms(1.2), noise=3.0, settings=replace(SETTINGS, time_limit=12.0))
    exploring.run()
    largest = float(np.sqrt(np.linalg.eigvalsh(exploring.mapper.covariances[-1][:2, :2])[-1]))
    assert 0.7 * largest < exploring.history[-1].sigma < 2.0 * largest


@pytest.mark.parametrize("reverse", [True, False])
def test_a_robot_that_cannot_drive_backwards_goes_nowhere_where_it_cannot_turn_round(reverse: bool) -> None:
    corridor = Rectangle((3.25, 0.36), 2.5, 0.72), Rectangle((3.25, 1.64), 2.5, 0.72)
    robot = Robot.rectangle(0.5, 0.3).differential(reverse=reverse)
    world, settings = World("hall", (0.0, 0.0, 4.5, 2.0), corridor, robot), replace(SETTINGS, cell=0.04)
    result = explorer(world, start=(1.0, 1.0, 0.0), sensor_range=1.5, settings=settings).run()
    assert result.status.startswith("complete")
    assert result.evaluation.collisions == 0
    assert (max(progress.pose[0] for progress in result.history) > 2.5) == reverse
