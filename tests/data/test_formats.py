"""Maps, problems and paths that others published."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from PIL import Image

from trailmark import SpeedZone, World
from trailmark.formats.any_path import read_any_path


def region(world: World) -> shapely.Geometry:
    found = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    shapely.prepare(found)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["8room_000", "Berlin_0_256"])
def test_movingai_maps(shared_data: Path, name: str) -> None:
    file = shared_data / "movingai" / f"{name}.map"
    world = World.load(file)
    rows = file.read_text().split("map\n", 1)[1].split()
    height, width = len(rows), len(rows[0])
    blocked = np.array([[cell not in ".GS" for cell in row] for row in rows])
    y, x = np.indices((height, width))
    union = region(world)
    assert np.array_equal(shapely.contains_xy(union, x + 0.5, height - y - 0.5), blocked)
    assert sum(shape.area for shape in world.obstacles) == blocked.sum()
    assert world.bounds == (0.0, 0.0, width, height)

    scenarios = file.with_name(file.name + ".scen").read_text().splitlines()[1:]
    assert [query.name for query in world.queries] == [str(i) for i in range(len(scenarios))]
    for query, line in zip(world.queries, scenarios, strict=True):
        sx, sy, gx, gy = map(int, line.split("\t")[4:8])
        assert query.start == (sx + 0.5, height - sy - 0.5, 0.0)
        assert query.goal == (gx + 0.5, height - gy - 0.5, 0.0)
    assert not shapely.contains_xy(union, *np.array([query.start[:2] for query in world.queries]).T).any()


def pixel_centres(shape: tuple[int, int], resolution: float, origin: tuple[float, float, float]) -> NDArray[np.float64]:
    """Where each pixel is: the first image row has the largest y."""
    rows, columns = np.indices(shape)
    x, y = (columns + 0.5) * resolution, (shape[0] - 1 - rows + 0.5) * resolution
    cos, sin = math.cos(origin[2]), math.sin(origin[2])
    return np.stack([origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y], axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "free_at_most", "origin"),
    [("depot", "0.25", (0.0, 0.0, 0.0)), ("tb3_sandbox", "0.196", (-10.0, -10.0, 0.0))],
)
def test_nav2_maps(shared_data: Path, name: str, free_at_most: str, origin: tuple[float, float, float]) -> None:
    world = World.load(shared_data / "nav2" / f"{name}.yaml")
    assert ["8,894 cells" in note for note in world.notes] == ([True] if name == "depot" else [])
    header, pixels = (shared_data / "nav2" / f"{name}.pgm").read_bytes().split(b"\n255\n", 1)
    width, height = map(int, header.split(b"\n")[-1].split())
    image = np.frombuffer(pixels, dtype=np.uint8).reshape(height, width)
    free = np.array([Fraction(255 - v, 255) <= Fraction(free_at_most) for v in range(256)])[image]
    points = pixel_centres((height, width), 0.05, origin)
    assert np.array_equal(shapely.contains_xy(region(world), points[..., 0], points[..., 1]), ~free)
    assert sum(shape.area for shape in world.obstacles) == pytest.approx((~free).sum() * 0.05**2, rel=1e-9)
    assert world.bounds == pytest.approx((*origin[:2], origin[0] + width * 0.05, origin[1] + height * 0.05))
    assert world.name == name
    assert world.robot is None
    assert world.boundary is None


def test_published_masks(shared_data: Path) -> None:
    """Against the pixels themselves, at a sample of their centres."""
    folder = shared_data / "nav2"
    world = World.load(folder / "depot.yaml")
    slow = world.with_mask(folder / "depot_speed.yaml", "speed")
    closed = world.with_mask(folder / "depot_keepout.yaml")
    assert {round(zone.limit, 9) for zone in slow.zones if isinstance(zone, SpeedZone)} == {0.5, 0.75, 0.8}
    rng = np.random.default_rng(0)
    for name, zones in (("speed", slow.zones), ("keepout", closed.zones)):
        pixels = np.asarray(Image.open(folder / f"depot_{name}.pgm"))[::-1]
        rows, columns = (rng.integers(n, size=2000) for n in pixels.shape)
        inside = np.zeros(2000, bool)
        for zone in zones:
            inside |= shapely.contains_xy(zone.region.shapely(), 0.05 * (columns + 0.5), 0.05 * (rows + 0.5))
        expected = np.isin(pixels[rows, columns], [127, 191, 205] if name == "speed" else [0])
        assert np.array_equal(inside, expected)


def poses(rows: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """States along published rows, as OMPL interpolates them."""
    pieces = []
    for a, b in pairwise(rows):
        turn = math.remainder(b[2] - a[2], 2.0 * math.pi)
        t = np.linspace(0.0, 1.0, 2 + int(np.hypot(*(b - a)[:2]) / step))[:, None]
        pieces.append(np.hstack([a[:2] + t * (b - a)[:2], a[2] + t * turn]))
    return np.concatenate(pieces)


def placed(outline: NDArray[np.float64], states: NDArray[np.float64]) -> NDArray[np.object_]:
    cos, sin = np.cos(states[:, 2, None]), np.sin(states[:, 2, None])
    x = states[:, :1] + cos * outline[:, 0] - sin * outline[:, 1]
    y = states[:, 1:2] + sin * outline[:, 0] + cos * outline[:, 1]
    return np.asarray(shapely.polygons(np.stack([x, y], axis=-1)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Maze", "RandomPolygons"])
def test_published_solutions_are_free(shared_data: Path, name: str) -> None:
    world = World.load(shared_data / "omplapp" / f"{name}_planar.cfg")
    states = poses(np.loadtxt(shared_data / "omplapp" / f"{name}_planar.path"), 0.02)
    bodies = placed(world.robot.outline.vertices, states)
    obstacles = region(world)
    assert not shapely.intersects(obstacles, bodies).any()
    if name == "Maze":  # but with theta the other way round some collide
        turned = placed(world.robot.outline.vertices, states * (1.0, 1.0, -1.0))
        assert shapely.intersects(obstacles, turned).any()
    assert shapely.covers(shapely.box(*world.bounds), bodies).all()
    assert world.name == name
    assert world.queries[0].start == pytest.approx(states[0])


@pytest.mark.slow
def test_a_wall_that_lacks_its_roof_in_published_data(shared_data: Path) -> None:
    """A roof triangle is missing in RandomPolygons, but the wall before the notch stands."""
    world = World.load(shared_data / "omplapp" / "RandomPolygons_planar.cfg")
    assert region(world).covers(shapely.LineString([(36.09739, -13.63669), (35.26931, -13.50349)]))


def test_published_rows(shared_data: Path) -> None:
    file = shared_data / "omplapp" / "Maze_planar.path"
    assert np.allclose(read_any_path(file).states, np.loadtxt(file), atol=1e-12)


@pytest.mark.slow
def test_worlds_of_ariadne(shared_data: Path) -> None:
    files = sorted((shared_data / "explore").glob("ariadne_*.png"))
    assert len(files) >= 15
    for file in files[::5]:
        world = World.load(file)
        pixels = np.asarray(Image.open(file).convert("RGB")).astype(int)
        points = pixel_centres(pixels.shape[:2], 1.0, (0.0, 0.0, 0.0))
        assert np.array_equal(
            shapely.contains_xy(region(world), points[..., 0], points[..., 1]), (pixels == 127).all(axis=-1)
        )
        x, y, _ = world.query().start
        marked = (pixels == [255, 216, 0]).all(axis=-1)
        assert marked[pixels.shape[0] - 1 - int(y), int(x)]
        rows, columns = np.nonzero(marked)
        assert abs(int(x) - columns.mean()) <= 1.0
        assert abs(pixels.shape[0] - 1 - int(y) - rows.mean()) <= 1.0
