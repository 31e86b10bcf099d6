"""The loop of an exploration, on a simulated robot and on robots of one's own."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely
from tests.support import exploration_faults as faults

from trailmark import ConfigurationError, Rectangle, Robot, World
from trailmark.estimation.records import Record
from trailmark.estimation.virtual_sensors import Scanner
from trailmark.exploration import ExplorationProgress, ExplorationSettings, Explorer, Outlook
from trailmark.exploration.explorer import MAX_BLOCKED, MAX_STILL
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.exploration.simulated_robot import SimulatedRobot, laser_scanner
from trailmark.world import Query

ROBOT = Robot.disc(0.2)
BOUNDS = (0.0, 0.0, 6.0, 4.0)
START = (0.6, 0.6, 0.0)
SETTINGS = ExplorationSettings(cell=0.1, sense_period=0.3)


def two_rooms(door: float, long: float = 6.0, wide: float = 4.0) -> World:
    """A wall across the middle, with a door in its middle that is so wide (metres)."""
    height = 0.5 * (wide - door)
    walls = [Rectangle((0.5 * long, y), 0.2, height) for y in (0.5 * height, wide - 0.5 * height)]
    return World("rooms", (0.0, 0.0, long, wide), tuple(walls), ROBOT)


def explorer(world: World, **options: object) -> Explorer:
    given = {"start": START, "sensor_range": 3.0, "settings": SETTINGS, "noise": 0.0, "strategy": "nearest-frontier"}
    return Explorer(world, **{**given, **options})  # type: ignore[arg-type]  # by name


def check_map(result: object, world: World) -> None:
    """What is known to be free holds nothing, by shapely."""
    known = result.known  # type: ignore[attr-defined]
    free = known.centres(*np.nonzero(known.state == FREE))
    blocked = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    assert not shapely.contains_xy(blocked, free).any()


@pytest.mark.slow
def test_all_that_can_be_seen_is_seen() -> None:
    world = two_rooms(1.0)
    result = explorer(world).run()
    assert result.status == "complete"
    assert "seen" in result.reason
    assert result.evaluation is not None
    assert result.evaluation.seen > 0.99
    assert result.evaluation.collisions == 0
    assert result.history[-1].landmarks >= 1
    assert len(result.decisions) >= result.history[-1].landmarks
    free_area = (result.known.state == FREE).sum() * result.known.cell**2
    assert free_area == pytest.approx(24.0 - 2 * 1.5 * 0.2, abs=3.0)  # cells along walls are occupied
    assert np.isfinite(result.first_known).sum() == (result.known.state != UNKNOWN).sum()
    check_map(result, world)


@pytest.mark.slow
def test_where_the_robot_does_not_fit_it_looks_through() -> None:
    # hrnr/m-explore#40: the robot won't fit, but laser beams will.
    world = two_rooms(0.3, 4.0, 2.4)
    result = explorer(world).run()
    assert result.status == "complete"  # proven by where the beams ended, whatever the cells are
    assert result.evaluation is not None
    # The slot is three cells wide: along the edges of what is seen through it, cells count as not seen.
    assert result.evaluation.seen > 0.9
    truth = np.array([progress.pose for progress in result.history])
    assert truth[:, 0].max() < 2.0
    columns = result.known.cells_of(np.array([[2.5, 1.2]]))[1]
    assert (result.known.state[:, int(columns[0]) :] == FREE).any()
    check_map(result, world)


@pytest.mark.slow
def test_what_lies_behind_the_robots_back_is_looked_at() -> None:
    world = two_rooms(1.0)
    result = explorer(world, sensor=Scanner(91, 0.5 * np.pi, 3.0)).run()
    assert result.status == "complete"
    assert result.evaluation is not None
    assert result.evaluation.seen > 0.99
    check_map(result, world)


def narrow_gap() -> World:
    """Return two rooms and a gap that is 4 cm wider than the robot."""
    walls = Rectangle((2.8, 0.69), 0.5, 1.38), Rectangle((2.8, 2.91), 0.5, 1.38)
    start = Query("start", (1.0, 1.0, 0.4), (4.6, 2.6, 0.0))
    return World("gap", (0.0, 0.0, 5.6, 3.6), walls, Robot.disc(0.4), queries=(start,))


@pytest.mark.slow
def test_what_only_a_finer_map_could_tell_is_said() -> None:
    for cell, status in ((0.08, "complete-at-confidence"), (0.02, "complete")):
        settings = ExplorationSettings(cell=cell, sense_period=0.3)
        result = Explorer(narrow_gap(), sensor_range=4.0, noise=0.0, settings=settings).run()
        assert result.status == status
        assert result.evaluation is not None
        assert result.evaluation.collisions == 0
        if cell > 0.02:
            assert result.evaluation.seen < 0.95  # some of the other room, through the gap
            assert "narrower than the robot and two cells of 0.08 m" in result.reason
            assert "a smaller --cell" in result.reason
        else:
            assert result.evaluation.seen > 0.98


@pytest.mark.slow
def test_a_closed_room_stays_unknown() -> None:
    result = explorer(two_rooms(0.0)).run()
    assert result.status == "complete"
    columns = result.known.cells_of(np.array([[3.2, 2.0]]))[1]
    assert (result.known.state[:, int(columns[0]) :] == UNKNOWN).all()
    assert (result.known.state == OCCUPIED).any()


@pytest.mark.slow
def test_a_function_of_the_users_chooses() -> None:
    asked = list[Outlook]()

    def last(outlook: Outlook) -> int:
        asked.append(outlook)
        return len(outlook.landmarks) - 1

    result = explorer(two_rooms(1.0), strategy=last).run()
    assert result.status == "complete"
    assert result.strategy == "last"
    assert all(len(outlook.costs) == len(outlook.landmarks) > 0 for outlook in asked)
    with pytest.raises(ConfigurationError, match="expected the index of one of"):
        explorer(two_rooms(1.0), strategy=lambda outlook: -1).run()


@pytest.mark.slow
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


@pytest.mark.slow
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
    laser = laser_scanner(3.0, 0.1)
    robot = SimulatedRobot(world, ROBOT, START, laser, noise=0.0)
    return Explorer(
        wrap(robot),  # type: ignore[arg-type]  # it has the two methods
        ROBOT,
        robot.sensor,
        start=START,
        bounds=BOUNDS,
        settings=settings,
        strategy="nearest-frontier",
    )


@pytest.mark.slow
def test_a_silent_sensor_ends_it() -> None:
    result = faulty(lambda robot: faults.Faulty(robot, faults.silence, 2.0)).run()
    assert result.status == "silent"
    assert "no reading for" in result.reason
    assert (result.known.state == FREE).sum() * result.known.cell**2 > 3.0


def test_a_sensor_that_is_silent_from_the_first_ends_it() -> None:
    result = faulty(lambda robot: faults.Faulty(robot, faults.silence)).run()
    assert result.status == "silent"
    assert not result.world.obstacles
    assert not len(result.known.state.nonzero()[0])


@pytest.mark.slow
def test_a_clock_may_begin_at_any_time() -> None:
    def later(records: list[Record]) -> list[Record]:
        return [record._replace(t=record.t + 1.7e9) for record in records]

    exploring = faulty(lambda robot: faults.Faulty(robot, later, -1.0), settings=replace(SETTINGS, time_limit=1.2))
    result = exploring.run()
    assert result.status == "time"
    assert result.history[-1].time == pytest.approx(1.7e9 + 1.2, abs=0.2)
    assert result.history[-1].distance > 0.5


class Idle:
    """A robot that stays where it is, and says nothing of it; ``arrived`` as it says."""

    def __init__(self, robot: SimulatedRobot, arrived: bool) -> None:
        self.robot, self.arrived, self.commands = robot, arrived, 0

    def sense(self) -> object:
        return self.robot.sense()

    def drive(self, states: np.ndarray, seconds: float) -> object:
        self.commands += len(states) > 1  # else it is to stand and sense, while a way is looked for
        return self.robot.drive(np.zeros((1, 3)), seconds)._replace(arrived=self.arrived)


@pytest.mark.slow
@pytest.mark.parametrize("arrived", [False, True])
def test_a_robot_that_stays_where_it_is_is_stuck(arrived: bool) -> None:
    robots = list[Idle]()

    def wrap(robot: SimulatedRobot) -> Idle:
        robots.append(Idle(robot, arrived))
        return robots[0]

    result = faulty(wrap).run()
    assert result.status == "stuck"
    assert "stays where it is" in result.reason
    assert robots[0].commands <= MAX_STILL + 2


class Stalled:
    """A robot that says that something is in its way, always."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self.robot = robot

    def sense(self) -> object:
        return self.robot.sense()

    def drive(self, states: np.ndarray, seconds: float) -> object:
        moving = len(states) > 1
        report = self.robot.drive(np.zeros((1, 3)), seconds)
        return report._replace(blocked=moving, arrived=False)


def test_a_robot_that_cannot_move_is_stuck() -> None:
    result = faulty(Stalled).run()
    assert result.status == "stuck"
    assert sum(progress.path is not None for progress in result.history) <= MAX_BLOCKED + 2


def test_a_door_that_closes_ends_what_lies_behind() -> None:
    open_door, closed = two_rooms(1.0), two_rooms(0.0)
    robots = list[SimulatedRobot]()

    def wrap(robot: SimulatedRobot) -> SimulatedRobot:
        robots.append(robot)
        return robot

    exploring = faulty(wrap, open_door)
    while exploring.ended is None:
        progress = exploring.step()
        if progress.distance > 0.4 and robots[0].world is open_door:
            robots[0].change_world(closed)
        assert progress.time < 120.0
    assert exploring.ended[0] == "complete"
    assert max(progress.pose[0] for progress in exploring.history) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize(("wall", "status"), [(2.0, "complete"), (4.5, "complete-at-confidence")])
def test_a_door_that_closes_behind_the_robot_is_not_driven_into(wall: float, status: str) -> None:
    # Where most of what is known lies behind the door, the map may be wrong there: that is no proof of the end.
    open_door, closed = (replace(two_rooms(door), obstacles=moved(two_rooms(door), wall)) for door in (1.0, 0.0))
    robot = SimulatedRobot(open_door, ROBOT, START, laser_scanner(1.2, 0.1), noise=0.0)

    def farthest(outlook: Outlook) -> int:
        return int(np.argmax(outlook.landmarks[:, 0]))

    settings = replace(SETTINGS, planning_time=0.3)
    exploring = Explorer(robot, ROBOT, robot.sensor, start=START, bounds=BOUNDS, settings=settings, strategy=farthest)
    while exploring.ended is None:
        progress = exploring.step()
        if progress.pose[0] > wall + 0.6 and robot.world is open_door:
            robot.change_world(closed)
        assert progress.time < 600.0
    assert robot.world is closed
    result = exploring.result()
    assert result.evaluation is not None
    assert result.evaluation.collisions == 0
    assert (result.known.state[:, : int(10.0 * wall) - 2] == UNKNOWN).mean() > 0.1
    assert result.status == status


def moved(world: World, wall: float) -> tuple[Rectangle, ...]:
    return tuple(Rectangle((wall, o.center[1]), o.length, o.width) for o in world.obstacles if isinstance(o, Rectangle))


class Careless(Stalled):
    """A robot that returns what is no record, and no report."""

    def __init__(self, robot: SimulatedRobot, sensed: object = None) -> None:
        super().__init__(robot)
        self.sensed = sensed

    def sense(self) -> object:
        return super().sense() if self.sensed is None else self.sensed

    def drive(self, states: np.ndarray, seconds: float) -> object:
        super().drive(states, seconds)
        return None


@pytest.mark.parametrize(
    ("sensed", "message"),
    [(None, "drive: expected"), (3, "sense: expected a sequence"), (["beep"], r"sense\[0\]: expected")],
)
def test_a_robot_has_to_say_what_is_asked_of_it(sensed: object, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        faulty(lambda robot: Careless(robot, sensed)).run()


@pytest.mark.slow
def test_where_no_way_is_found_in_time_it_is_told() -> None:
    # The gap is passed when headed through it, which takes longer to find than 0.1 ms.
    walls = Rectangle((4.0, 1.2), 0.4, 2.4), Rectangle((4.0, 4.6), 0.4, 2.8)
    world, robot = World("gap", (0.0, 0.0, 8.0, 6.0), walls), Robot.rectangle(1.6, 0.7)
    explorer = Explorer(
        world,
        robot,
        start=(1.2, 3.0, 1.57),
        sensor_range=6.0,
        noise=0.0,
        settings=ExplorationSettings(cell=0.07, planning_time=1e-4, sense_period=0.3),
    )
    result = explorer.run()
    assert result.status == "complete-at-confidence"
    assert "to which no way was found" in result.reason


@pytest.mark.slow
def test_the_sigma_told_is_that_in_the_frame_of_the_start() -> None:
    exploring = explorer(two_rooms(1.2), noise=3.0, settings=replace(SETTINGS, time_limit=12.0))
    exploring.run()
    told = exploring.history[-1].sigma
    largest = float(np.sqrt(np.linalg.eigvalsh(exploring.mapper.covariances[-1][:2, :2])[-1]))
    assert 0.7 * largest < told < 2.0 * largest


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False])
def test_a_robot_that_cannot_drive_backwards_goes_nowhere_where_it_cannot_turn_round(reverse: bool) -> None:
    corridor = Rectangle((3.25, 0.36), 2.5, 0.72), Rectangle((3.25, 1.64), 2.5, 0.72)
    robot = Robot.rectangle(0.5, 0.3).differential(reverse=reverse)
    world, settings = World("hall", (0.0, 0.0, 4.5, 2.0), corridor, robot), replace(SETTINGS, cell=0.04)
    result = explorer(world, start=(1.0, 1.0, 0.0), sensor_range=1.5, settings=settings).run()
    assert result.status.startswith("complete")
    assert result.evaluation is not None
    assert result.evaluation.collisions == 0
    assert (max(progress.pose[0] for progress in result.history) > 2.5) == reverse
