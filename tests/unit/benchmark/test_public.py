"""Public suites: an even choice, which files count and what becomes of them, ends that can be planned between."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image
from tests.helpers.trials import few

from trailmark import FormatError, Robot, StateChecker, World
from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public import PUBLIC
from trailmark.benchmark.public.base import evenly
from trailmark.benchmark.public.graded import CLUTTER, SPARE
from trailmark.benchmark.public.nav2 import Places, is_map

FOLDERS = {"movingai": "movingai", "omplapp": "omplapp", "nav2": "nav2", "barn": "barn"}
"""Of the suites whose data is at hand, in the folder of real data."""


@pytest.mark.parametrize(("size", "count"), [(10, 3), (300, 7), (5, 5), (4, 9), (1000, 999)])
def test_a_choice_is_spread_evenly(size: int, count: int) -> None:
    chosen = evenly(range(size), count)
    assert len(chosen) == min(size, count)
    assert sorted(set(chosen)) == chosen
    gaps = np.diff([-1 - chosen[0], *chosen, 2 * size - 1 - chosen[-1]])[1:-1]
    assert gaps.max(initial=0) - gaps.min(initial=size) <= 1
    assert evenly(range(size), None) == list(range(size))


@pytest.mark.parametrize("name", PUBLIC)
def test_a_wrong_folder_is_told_in_one_line(name: str, tmp_path: Path) -> None:
    suite = PUBLIC[name]
    if not suite.published:
        with pytest.raises(SuiteError, match="expected no --data"):
            suite.folder(str(tmp_path))
        return
    with pytest.raises(SuiteError, match="--data is missing; expected a folder with"):
        suite.folder(None)
    with pytest.raises(SuiteError, match=r"--data: expected a folder with .*, got 'nowhere'"):
        suite.folder("nowhere")
    with pytest.raises(SuiteError, match=f"suite {name}: expected .*, got none of it"):
        list(suite.worlds(tmp_path, suite.find(tmp_path), None, None))


def posed(name: str, folder: Path = Path(), count: int | None = None, robot: Robot | None = None) -> list[World]:
    suite = PUBLIC[name]
    return list(suite.worlds(folder, suite.find(folder), count, robot))


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLIC)
def test_every_problem_has_valid_ends(name: str, shared_data: Path) -> None:
    suite, count = PUBLIC[name], few(12)
    if suite.published and name not in FOLDERS:
        pytest.skip("its data is not at hand; tests below make some")
    made = posed(name, shared_data / FOLDERS[name] if suite.published else Path(), count)
    queries = 0
    for world in made:
        checker = StateChecker(world)
        ends = np.array([end for query in world.queries for end in (query.start, query.pose())])
        assert checker.valid(ends).all(), world.name
        queries += len(world.queries)
    # OMPL.app and BARN are there in part.
    assert queries == {"omplapp": 2, "barn": 3}.get(name, count)
    assert len({(world.name, query.name) for world in made for query in world.queries}) == queries


MAP = "type octile\nheight 3\nwidth 4\nmap\n....\n.@@.\n....\n"
SCEN = "version 1\n0\ttiny.map\t4\t3\t0\t0\t3\t2\t5\n7\ttiny.map\t4\t3\t3\t0\t0\t2\t5\n"


def test_movingai_with_maps_and_scenarios_in_folders_of_their_own(tmp_path: Path) -> None:
    for folder in ("maps", "scens"):
        (tmp_path / folder).mkdir()
    (tmp_path / "maps" / "tiny.map").write_text(MAP)
    (tmp_path / "scens" / "tiny.map.scen").write_text(SCEN)
    (tmp_path / "scens" / "gone.map.scen").write_text(SCEN)
    (world,) = posed("movingai", tmp_path)
    assert [query.name for query in world.queries] == ["bucket-0-row-0", "bucket-7-row-1"]
    assert [(query.start, query.goal) for query in world.queries] == [
        ((0.5, 2.5, 0.0), (3.5, 0.5, 0.0)),
        ((3.5, 2.5, 0.0), (0.5, 0.5, 0.0)),
    ]
    assert world.robot == Robot.disc(0.4)
    (line,) = PUBLIC["movingai"].find(tmp_path).left_out
    assert line.endswith(f"gone.map.scen: no gone.map in {tmp_path}")
    (tmp_path / "maps" / "tiny.map").write_text(MAP.replace("height 3", "height 2").removesuffix("....\n"))
    with pytest.raises(SuiteError, match=r"expected rows for tiny\.map, 4 x 2 cells"):
        posed("movingai", tmp_path)


def test_omplapp_leaves_out_what_is_not_planned_for(tmp_path: Path) -> None:
    (tmp_path / "space.cfg").write_text("[problem]\nstart.theta = 0\nstart.z = 1\n")
    (tmp_path / "car.cfg").write_text("[problem]\nstart.theta = 0\ncontrol = kinematic_car\n")
    found = PUBLIC["omplapp"].find(tmp_path)
    assert list(found.problems) == []
    assert [line.rpartition(": ")[2] for line in found.left_out] == [
        "a problem for planners with controls",
        "a problem in space",
    ]


def test_pictures_are_read_with_the_lower_left_pixel_first(tmp_path: Path) -> None:
    folder = tmp_path / "forest" / "test"
    folder.mkdir(parents=True)
    pixels = np.full((201, 201), 255, dtype=np.uint8)
    pixels[190:195, 10:20] = 0  # near the picture's lower left corner
    pixels[0:5, 0:5] = 127  # below half
    pixels[0:5, 10:15] = 128
    Image.fromarray(pixels).save(folder / "9.png")
    (world,) = posed("families", tmp_path)
    assert world.name == "forest-test-9"
    blocked = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    wanted = shapely.union_all([shapely.box(10, 6, 20, 11), shapely.box(0, 196, 5, 201)])
    assert blocked.symmetric_difference(wanted).area == pytest.approx(0.0)
    assert (world.queries[0].start, world.queries[0].goal) == ((0.5, 0.5, 0.0), (200.5, 200.5, 0.0))
    Image.fromarray(pixels[:100]).save(folder / "9.png")
    with pytest.raises(FormatError, match="expected 201 x 201 pixels, got 201 x 100"):
        posed("families", tmp_path)


@pytest.mark.slow
def test_clutter_grows_from_grade_to_grade() -> None:
    made = posed("clutter", count=12)
    assert [len(world.obstacles) for world in made] == [grade for grade in CLUTTER for _ in range(2)]
    assert len({world.name for world in made}) == len(made)
    # What is made again is the same.
    assert made[:4] == posed("clutter", count=12)[:4]
    with pytest.raises(SuiteError, match="expected room for the robot near two corners, got none"):
        posed("clutter", count=1, robot=Robot.disc(40.0))


def test_passages_are_as_much_wider_than_the_robot_as_they_say() -> None:
    made = posed("passages", count=6)
    assert [world.name.split("-")[1] for world in made] == [f"{spare:g}" for spare in SPARE]
    for world, spare in zip(made, SPARE, strict=True):
        below, above = (shape.polygon().shapely() for shape in world.obstacles[:2])
        # Across the slit, whatever its tilt: the width of the robot and what is spare.
        assert shapely.distance(below, above) == pytest.approx(0.6 + spare)


def write_map(folder: Path, blocked: np.ndarray, name: str = "room") -> Path:
    """Write cells of 5 cm, row 0 with the smallest y, as a nav2 map."""
    rows, columns = blocked.shape
    pixels = np.where(blocked[::-1], 0, 254).astype(np.uint8)
    (folder / f"{name}.pgm").write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + pixels.tobytes())
    file = folder / f"{name}.yaml"
    file.write_text(f"image: {name}.pgm\nresolution: 0.05\norigin: [1.0, -2.0, 0.0]\n")
    return file


def room() -> np.ndarray:
    blocked = np.zeros((200, 240), dtype=bool)
    blocked[60:140, 100:104] = True
    blocked[20:24, 180:200] = True
    return blocked


def test_pairs_that_nothing_joins_are_drawn_anew(tmp_path: Path) -> None:
    blocked = room()
    blocked[:, 120:124] = True
    robot = Robot.rectangle(0.4, 0.2)
    world = PUBLIC["nav2"].world(tmp_path, write_map(tmp_path, blocked), range(10), robot)
    assert (world.robot, [query.name for query in world.queries]) == (robot, [f"pair-{i}" for i in range(10)])
    assert all((query.start[0] < 7.0) == (query.pose()[0] < 7.0) for query in world.queries)
    file = write_map(tmp_path, np.ones((60, 60), dtype=bool))
    with pytest.raises(SuiteError, match="expected room for 2 pairs of ends, got 0"):
        Places(file, robot).pairs(2)


def test_masks_and_parameters_are_no_maps(tmp_path: Path) -> None:
    assert is_map(write_map(tmp_path, room()))
    assert not is_map(write_map(tmp_path, room(), "depot_keepout"))
    (tmp_path / "params.yaml").write_text("planner_server: {}\n")
    assert not is_map(tmp_path / "params.yaml")
    (tmp_path / "launch.yaml").write_text("a: !tag b\n")
    assert not is_map(tmp_path / "launch.yaml")


CAR = "m 0,0 0,94 54,0 0,-94 z"
"""As first drawn: 22 to the metre, its length along y."""


def write(folder: Path, name: str, *lines: str) -> None:
    paths = "".join(f'<path d="{line}"/>' for line in lines)
    (folder / f"{name}.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{paths}</svg>')


def maze(folder: Path, unit: float, x: float, y: float) -> World:
    """Two blocks about the published ends of parking3, whose drawing begins at (153.3, 111.7) of its first units."""
    far = 153.30823 / 22.0, 111.71665 / 22.0
    square = [f"m {unit * (far[0] + x)},{unit * (far[1] + y)} {unit},0 0,{unit} {-unit},0 z"]
    square += [f"m {unit * (x - 12)},{unit * (y - 12)} {unit},0 0,{unit} {-unit},0 z"]
    square += [f"m {unit * (x + 28)},{unit * (y + 17)} {unit},0 0,{unit} {-unit},0 z"]
    write(folder, "parking3", *square)
    (world,) = posed("bench-mr", folder, 3)
    return world


@pytest.mark.parametrize(("unit", "x", "y"), [(22.0, 0.0, 0.0), (1.0, 200.0, -40.0)], ids=["units", "metres"])
def test_published_ends_in_both_versions(unit: float, x: float, y: float, tmp_path: Path) -> None:
    write(tmp_path, "car", CAR)
    world = maze(tmp_path, unit, x, y)
    (all_ten,) = posed("bench-mr", tmp_path)
    # benchmarks/parking3.json: from (15.45, -2.27) to (3.82, 0.34); a drawing's y points down.
    start, goal = all_ten.queries[0].start, all_ten.queries[0].goal
    assert np.array(start) == pytest.approx((15.45 + x, -2.27 - y, 0.0), abs=1e-3)
    assert np.array(goal) == pytest.approx((3.82 + x, 0.34 - y, 0.0), abs=1e-3)
    assert len(all_ten.queries) == 10
    assert [query.name for query in world.queries] == ["pair-1", "pair-5", "pair-8"]
    assert len(world.obstacles) == 3
    assert world.obstacles[0].area == pytest.approx(1.0)


@pytest.mark.slow
def test_the_robot_is_the_drawn_one_with_its_length_ahead_or_the_one_that_is_given(tmp_path: Path) -> None:
    with pytest.raises(SuiteError, match=r"expected car\.svg beside Bench-MR's mazes, got none"):
        maze(tmp_path, 22.0, 0.0, 0.0)
    (world,) = posed("bench-mr", tmp_path, 1, Robot.disc(0.5))
    assert world.robot == Robot.disc(0.5)
    write(tmp_path, "car", CAR)
    world = maze(tmp_path, 22.0, 0.0, 0.0)
    low, high = world.robot.outline.vertices.min(axis=0), world.robot.outline.vertices.max(axis=0)
    assert high - low == pytest.approx((94 / 22, 54 / 22))
    assert low == pytest.approx(-high)
    assert world.robot.turning_radius == 4.0
