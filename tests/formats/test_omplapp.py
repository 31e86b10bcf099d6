from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from trailmark import FormatError, Query, World

CFG = """[problem]
name = Yard
robot = robot.dae
world = world.dae
start.x = 1.5
start.y = -2
start.theta = 0.5
goal.x = 3
goal.y = 4
goal.theta = -1e-1
volume.min.x = -55.0
volume.min.y = -50
volume.max.x = 55
volume.max.y = 50
"""


def mesh(*faces: list[tuple[float, float, float]]) -> str:
    """A Collada file, z up, of faces given by their corners (x, y, z); y is the height."""
    points = [point for face in faces for point in face]
    numbers = " ".join(repr(float(v)) for point in points for v in point)
    loops = " ".join(str(i) for i in range(len(points)))
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a">{numbers}</float_array>
<technique_common><accessor source="#a" count="{len(points)}" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist><input semantic="VERTEX" offset="0" source="#v"/><vcount>{" ".join(str(len(f)) for f in faces)}</vcount>
<p>{loops}</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def roof(xmin: float, zmin: float, xmax: float, zmax: float, y: float = 0.0) -> list[tuple[float, float, float]]:
    return [(xmin, y, zmin), (xmax, y, zmin), (xmax, y, zmax), (xmin, y, zmax)]


def wall(x0: float, z0: float, x1: float, z1: float) -> list[tuple[float, float, float]]:
    return [(x0, 0.0, z0), (x1, 0.0, z1), (x1, 3.0, z1), (x0, 3.0, z0)]


def triangles(face: list[tuple[float, float, float]]) -> list[list[tuple[float, float, float]]]:
    return [[face[0], face[i], face[i + 1]] for i in range(1, len(face) - 1)]


def problem(folder: Path, world: str = "", robot: str = "", cfg: str = CFG) -> Path:
    (folder / "yard.cfg").write_text(cfg)
    (folder / "world.dae").write_text(world or mesh(roof(10, 10, 20, 20)))
    (folder / "robot.dae").write_text(robot or mesh(roof(0, 0, 4, 2)))
    return folder / "yard.cfg"


def region(world: World) -> shapely.Geometry:
    return shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])


def footprint(world: World) -> shapely.Polygon:
    return world.robot.outline.shapely()


def test_problem(tmp_path: Path) -> None:
    world = World.load(problem(tmp_path))
    assert world.name == "Yard"
    assert world.bounds == (-55.0, -50.0, 55.0, 50.0)
    assert world.queries == (Query("problem", (1.5, -2.0, 0.5), (3.0, 4.0, -0.1)),)
    assert region(world).equals(shapely.box(10, 10, 20, 20))
    assert footprint(world).equals(shapely.box(-2, -1, 2, 1))


def test_ini_as_people_write_it(tmp_path: Path) -> None:
    cfg = (
        "# a comment\n; another\n\n"
        + CFG.replace("name = Yard\n", "").replace("start.x = 1.5", "  START.X=1.5 # metres").replace("\n", "\r\n")
        + "start.y = 7\nobjective = length\n[benchmark]\nstart.y = 9\n[planner]\nprm=\nprm=\naps\n"
    )
    world = World.load(problem(tmp_path, cfg=cfg))
    assert world.name == "yard"
    assert world.queries[0].start == (1.5, 7.0, 0.5)


def test_overlapping_roofs_become_one_polygon_with_holes(tmp_path: Path) -> None:
    frame = [roof(0, 0, 10, 1), roof(0, 9, 10, 10), roof(0, 0, 1, 10, y=2.0), roof(9, 0, 10, 10)]
    world = World.load(problem(tmp_path, world=mesh(*frame)))
    (shape,) = world.obstacles
    assert shape.polygon().shapely().equals(shapely.box(0, 0, 10, 10) - shapely.box(1, 1, 9, 9))


@pytest.mark.parametrize("split", [False, True])
def test_walls_without_a_roof_are_not_lost(tmp_path: Path, split: bool) -> None:
    faces = [roof(0, 0, 1, 1), wall(1, 1, 5, 4), wall(5, 4, 9, 4), wall(0, 0, 1, 0)]
    if split:
        faces = [triangle for face in faces for triangle in triangles(face)]
    found = region(World.load(problem(tmp_path, world=mesh(*faces))))
    line = shapely.LineString([(1, 1), (5, 4), (9, 4)])
    assert found.covers(line)
    assert found.geom_type == "Polygon"  # the walls meet the roof and each other
    thickness = 2 * 1e-6 * math.hypot(9, 4)
    assert found.area == pytest.approx(1.0 + thickness * line.length, rel=1e-5)


def test_non_convex_faces(tmp_path: Path) -> None:
    corner = [(0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (4.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 0.0, 4.0), (0.0, 0.0, 4.0)]
    world = World.load(problem(tmp_path, robot=mesh(corner)))
    assert world.robot is not None
    middle = np.mean([(x, z) for x, _, z in corner], axis=0)
    expected = shapely.Polygon(np.array([(x, z) for x, _, z in corner]) - middle)
    assert footprint(world).equals(expected)


def test_the_robot_is_centred_by_the_mean_of_its_vertices(tmp_path: Path) -> None:
    # Four corners below, and a fifth and sixth above one side: the mean is not the middle.
    world = World.load(problem(tmp_path, robot=mesh(roof(0, 0, 4, 2), wall(4, 0, 4, 2))))
    # Different positions: 4 of the roof, of which the wall shares 2, and 2 above.
    mean = np.mean([(0, 0), (4, 0), (4, 2), (0, 2), (4, 0), (4, 2)], axis=0)
    assert footprint(world).equals_exact(shapely.box(*(-mean), *(np.array([4, 2]) - mean)), 1e-12, normalize=True)


def test_holes_in_the_robot_are_filled(tmp_path: Path) -> None:
    frame = [roof(0, 0, 10, 1), roof(0, 9, 10, 10), roof(0, 0, 1, 10), roof(9, 0, 10, 10)]
    assert footprint(World.load(problem(tmp_path, robot=mesh(*frame)))).area == pytest.approx(100.0)


def test_narrow_gaps_in_the_robot_are_filled(tmp_path: Path) -> None:
    parts = [roof(0, 0, 10, 4), roof(0, 4.05, 3, 9), roof(0, 9.02, 10, 12)]
    outline = footprint(World.load(problem(tmp_path, robot=mesh(*parts))))
    mean = np.mean([(x, z) for part in parts for x, _, z in part], axis=0)
    whole = shapely.union_all([shapely.box(p[0][0], p[0][2], p[2][0], p[2][2]) for p in parts])
    assert outline.buffer(1e-9).covers(shapely.transform(whole, lambda xy: xy - mean))
    assert np.hypot(*np.diff(outline.exterior.coords, axis=0).T).min() > 1e-3
    assert outline.area == pytest.approx(whole.area + 3 * 0.05 + 3 * 0.02, rel=1e-4)


def test_parts_that_touch_in_a_corner_are_one_robot(tmp_path: Path) -> None:
    outline = footprint(World.load(problem(tmp_path, robot=mesh(roof(0, 0, 1, 1), roof(1, 1, 2, 2)))))
    assert outline.area == pytest.approx(2.0, rel=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "problem_text"),
    [
        ("start.theta = 0.5\n", "", "[problem]: missing start.theta; expected all of robot, world, start, goal,"),
        ("robot = robot.dae\n", "", "[problem]: missing robot;"),
        ("volume.min.x = -55.0\nvolume.min.y = -50\n", "", "[problem]: missing volume.min.x, volume.min.y;"),
        ("start.x = 1.5", "start.x = abc", "yard.cfg:5: start.x: expected a finite number, got 'abc'"),
        ("start.x = 1.5", "start.x =", "yard.cfg:5: start.x: expected a finite number, got ''"),
        ("start.x = 1.5", "start.x = nan", "yard.cfg:5: start.x: expected a finite number, got 'nan'"),
        ("start.x = 1.5", "start.x 1.5", "yard.cfg:5: expected key = value, got 'start.x 1.5'"),
        ("start.x = 1.5", "start.x = 1.5\nstart.z = 0", "a problem in space given (it has z); expected problems in"),
        ("volume.max.x = 55", "volume.max.x = -60", "yard.cfg: bounds: expected xmin < xmax and ymin < ymax, got"),
        ("[problem]", "[benchmark]", "expected an OMPL.app cfg with a section [problem], got none"),
        ("world = world.dae", "world = none.dae", "none.dae: cannot be read: No such file or directory"),
        ("world = world.dae", "world = yard.cfg", "yard.cfg:1: not valid XML"),
        ("robot = robot.dae", "robot =", "cannot be read: Is a directory"),
        ("robot = robot.dae", "robot = point.dae", "point.dae: expected a mesh that covers an area or a line,"),
        ("robot = robot.dae", "robot = dust.dae", "dust.dae: expected one, or up to 100 with gaps below 1% of"),
        ("robot = robot.dae", "robot = apart.dae", "apart.dae: expected one, or up to 100 with gaps below 1% of its"),
    ],
)
def test_bad_problems(tmp_path: Path, old: str, new: str, problem_text: str) -> None:
    (tmp_path / "apart.dae").write_text(mesh(roof(0, 0, 1, 1), roof(3, 3, 4, 4)))
    (tmp_path / "dust.dae").write_text(mesh(*(roof(i, 0, i + 0.9, 1) for i in range(200))))
    (tmp_path / "point.dae").write_text(mesh(roof(1, 1, 1, 1)))
    file = problem(tmp_path, cfg=CFG.replace(old, new))
    with pytest.raises(FormatError) as caught:
        World.load(file)
    assert problem_text in str(caught.value)
