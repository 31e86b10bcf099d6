from __future__ import annotations

import math
import struct
import zlib
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from trailmark import Disc, FormatError, KeepOutZone, Polygon, Rectangle, SpeedZone, WorldError
from trailmark.formats.nav2_map import free_cells, read_mask, save_nav2_map
from trailmark.formats.schema import MapFile
from trailmark.world import ObstacleEstimate, World


def obstacles_at(world: World, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    union = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    shapely.prepare(union)
    return np.asarray(shapely.contains_xy(union, points[..., 0], points[..., 1]))


def pixel_centres(shape: tuple[int, int], resolution: float, origin: tuple[float, float, float]) -> NDArray[np.float64]:
    """Where DESIGN.md section 5 puts each pixel: the first image row has the largest y."""
    rows, columns = np.indices(shape)
    x, y = (columns + 0.5) * resolution, (shape[0] - 1 - rows + 0.5) * resolution
    cos, sin = math.cos(origin[2]), math.sin(origin[2])
    return np.stack([origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y], axis=-1)


def write_map(folder: Path, picture: Image.Image | bytes, name: str = "map.pgm", **keys: Any) -> Path:
    if isinstance(picture, bytes):
        (folder / name).write_bytes(picture)
    else:
        picture.save(folder / name)
    fields = {"image": name, "resolution": 0.5, "origin": [0.0, 0.0, 0.0], **keys}
    file = folder / "map.yaml"
    file.write_text("".join(f"{key}: {value}\n" for key, value in fields.items() if value is not None))
    return file


def grey(*rows: list[int]) -> Image.Image:
    return Image.fromarray(np.array(rows, dtype=np.uint8))


def test_yaw_turns_the_map_about_its_origin(tmp_path: Path) -> None:
    image = np.full((4, 6), 254, dtype=np.uint8)
    image[1, 2] = image[3, 5] = 0
    origin = (3.0, -2.0, 0.7)
    world = World.load(write_map(tmp_path, Image.fromarray(image), origin=list(origin)))
    points = pixel_centres((4, 6), 0.5, origin)
    assert np.array_equal(obstacles_at(world, points), image == 0)
    region = world.boundary.shapely()
    assert region.area == pytest.approx(3.0 * 2.0)
    assert shapely.contains_xy(region, points[..., 0], points[..., 1]).all()
    assert world.bounds == pytest.approx(region.bounds)


def test_an_image_is_read_without_a_map_file(tmp_path: Path) -> None:
    image = grey([0, 254, 205], [254, 100, 254])
    file = write_map(tmp_path, image, origin=[1, 2, 0.5])
    alone = World.from_image(tmp_path / "map.pgm", 0.5, (1, 2, 0.5))
    assert alone == World.load(file)
    assert alone.sources == ((tmp_path / "map.pgm").absolute(),)
    lenient = World.from_image(tmp_path / "map.pgm", 0.5, (1, 2), free_thresh=0.64, occupied_thresh=0.65)
    assert sum(shape.area for shape in lenient.obstacles) == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("arguments", "keys", "problem"),
    [
        ((0,), {}, "resolution: "),
        (("1",), {}, "resolution: "),
        ((1, (0,)), {}, "origin: "),
        ((1, "here"), {}, "origin: "),
        ((1, (0, math.nan)), {}, r"origin\[1\]: "),
        ((1,), {"mode": "binary"}, "mode: "),
    ],
)
def test_an_image_with_wrong_fields(
    tmp_path: Path, arguments: tuple[Any, ...], keys: dict[str, Any], problem: str
) -> None:
    grey([0, 254]).save(tmp_path / "map.png")
    with pytest.raises(FormatError, match=problem) as caught:
        World.from_image(tmp_path / "map.png", *arguments, **keys)
    assert "map.png" in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "free"),
    [
        ({"negate": "no"}, True),
        ({"negate": "True"}, False),
        ({"mode": "Trinary"}, True),
        ({"image": "~/map.pgm"}, True),
    ],
)
def test_values_as_nav2_reads_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keys: dict[str, Any], free: bool
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert (World.load(write_map(tmp_path, grey([254]), **keys)).obstacles == ()) is free


def free_by_definition(v: int, file: MapFile) -> bool:
    """DESIGN.md section 5 for a grey pixel, in exact arithmetic."""
    if file.mode == "raw":
        p = Fraction(v, 100)
        return v <= 100 and p <= Fraction(str(file.free_thresh)) and p < Fraction(str(file.occupied_thresh))
    p = Fraction(v if file.negate else 255 - v, 255)
    return p <= Fraction(str(file.free_thresh)) and p < Fraction(str(file.occupied_thresh))


@pytest.mark.slow
@given(
    st.sampled_from(["trinary", "scale", "raw"]),
    st.sampled_from([0, 1]),
    st.integers(0, 100).map(lambda percent: percent / 100),
    st.integers(0, 100).map(lambda percent: percent / 100),
)
def test_every_grey_value_in_every_mode(mode: str, negate: int, occupied: float, free: float) -> None:
    file = MapFile.model_validate(
        {
            "image": "x",
            "resolution": 1,
            "mode": mode,
            "negate": negate,
            "occupied_thresh": occupied,
            "free_thresh": free,
        }
    )
    values = np.arange(256, dtype=np.uint8).reshape(16, 16)
    expected = [[free_by_definition(int(v), file) for v in row] for row in values]
    assert free_cells(Image.fromarray(values), file).tolist() == expected


def thresholds(**keys: Any) -> MapFile:
    return MapFile.model_validate({"image": "x", "resolution": 1, **keys})


@pytest.mark.parametrize(
    ("mode", "pixel", "free"),
    [
        ("trinary", (255, 255, 255, 255), True),
        ("trinary", (255, 255, 255, 0), False),  # alpha is a fourth colour: p = 1/4
        ("trinary", (255, 255, 255, 60), True),  # p = 0.191
        ("trinary", (255, 255, 255, 50), False),  # p = 0.201
        ("scale", (255, 255, 255, 255), True),
        ("scale", (255, 255, 255, 254), False),  # not opaque: unknown
        ("scale", (200, 200, 230, 255), True),  # p = 0.176
        ("scale", (130, 130, 130, 255), False),  # graded, hence not known to be free
        ("raw", (0, 0, 0, 255), True),
        ("raw", (20, 20, 20, 0), False),  # p = 0.2
        ("raw", (19, 19, 19, 0), True),
        ("raw", (255, 255, 255, 255), False),
    ],
)
def test_colours_and_alpha(mode: str, pixel: tuple[int, ...], free: bool) -> None:
    assert free_cells(Image.new("RGBA", (1, 1), pixel), thresholds(mode=mode)).item() is free


@pytest.mark.parametrize(
    ("image", "free"),
    [
        (Image.new("1", (1, 1), 1), True),
        (Image.new("1", (1, 1), 0), False),
        (Image.new("P", (1, 1), 0), False),  # the palette begins with black
        (Image.new("LA", (1, 1), (255, 255)), True),
        (Image.new("LA", (1, 1), (255, 0)), False),
        (Image.new("RGB", (1, 1), (255, 255, 0)), False),
        (Image.new("I;16", (1, 1), 65535), True),
        (Image.new("I;16", (1, 1), 52428), False),  # p = 0.2
    ],
)
def test_other_pixel_kinds(image: Image.Image, free: bool) -> None:
    assert free_cells(image, thresholds()).item() is free


BOARD = Image.fromarray(np.kron([[0, 255]], np.ones((8, 8))).astype(np.uint8))


@pytest.mark.parametrize(
    ("image", "name", "keys", "bounds", "blocked"),
    [
        *((BOARD, f"map.{kind}", {}, (8.0, 4.0), [(0.0, 0.0, 4.0, 4.0)]) for kind in ("png", "bmp", "jpg", "ppm")),
        (b"P2\n# made by hand\n3 1\n10\n10 0 9\n", "map.pgm", {}, (1.5, 0.5), [(0.5, 0.0, 1.0, 0.5)]),
        # 205 is what map savers write for unknown: p = 0.19608 > 0.196.
        (
            Image.fromarray(np.array([[205, 206, 254]], np.uint8)),
            "map.pgm",
            {"origin": None, "elevation": "x.tif"},
            (1.5, 0.5),
            [(0.0, 0.0, 0.5, 0.5)],
        ),
        # Sixteen bits are not cut to eight: p on both sides of 0.196.
        (b"P5 2 1 65535\n" + struct.pack(">2H", 52691, 52690), "map.pgm", {}, (1.0, 0.5), [(0.5, 0.0, 1.0, 0.5)]),
    ],
)
def test_image_kinds_and_defaults(
    tmp_path: Path, image: Any, name: str, keys: dict[str, Any], bounds: tuple[float, float], blocked: list[Any]
) -> None:
    world = World.load(write_map(tmp_path, image, name, **keys))
    assert world.bounds == (0.0, 0.0, *bounds)
    assert [shape.bounding_box() for shape in world.obstacles] == blocked
    file = write_map(tmp_path, image, name, **keys | {"image": str(tmp_path / name)})  # an absolute path
    assert World.load(file).obstacles == world.obstacles


def png_header(width: int, height: int) -> bytes:
    chunks = (b"IHDR" + struct.pack(">2I5B", width, height, 1, 0, 0, 0, 0), b"IDAT" + zlib.compress(b""))
    data = (struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(data)


def truncated(name: str) -> bytes:
    import io

    out = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64), dtype=np.uint8)).save(out, name)
    return out.getvalue()[:1200]


@pytest.mark.parametrize(
    ("image", "problem"),
    [
        (b"this is a text", "not an image that can be read; expected an image of the kinds PGM/PBM/PPM, PNG, BMP,"),
        (b"", "not an image that can be read"),
        (b"GIF89a" + bytes(20), "not an image that can be read"),
        (b"P5 4 4 255\n1234", "damaged image"),
        (b"P2 2 2 255\n1 2 x 4", "damaged image"),
        (b"P5 2 2 0\n1234", "image"),
        (truncated("PNG"), "damaged image"),
        (truncated("JPEG"), "damaged image"),
        (truncated("BMP"), "damaged image"),
        (b"P5 9000 9000 255\n", "expected 1 to 64,000,000 cells, got 9000 x 9000"),
        (png_header(9000, 9000), "expected 1 to 64,000,000 cells, got 9000 x 9000"),
        (png_header(100_000, 100_000), "expected at most 64,000,000"),
        (b"Pf 1 1 -1.0\n" + struct.pack("<f", 0.5), "expected grey or colours of 8 or 16 bits, got pixels of mode F"),
    ],
)
def test_bad_images(tmp_path: Path, image: bytes, problem: str) -> None:
    file = write_map(tmp_path, image, "map.png")
    with pytest.raises(FormatError) as caught:
        World.load(file)
    assert str(caught.value).startswith(f"{tmp_path / 'map.png'}: ")
    assert problem in str(caught.value)


def test_images_that_are_none_or_noise(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"none\.png: image cannot be read: No such file or directory"):
        World.load(write_map(tmp_path, grey([0]), image="none.png"))
    with pytest.raises(FormatError, match="image cannot be read: Is a directory; expected an image of the kinds PGM"):
        World.load(write_map(tmp_path, grey([0]), image="."))
    board = Image.fromarray((np.indices((708, 708)).sum(axis=0) % 2 * 255).astype(np.uint8))
    with pytest.raises(FormatError, match=r"map\.pgm: map: expected outlines with at most 1,000,000 corners, got 1,0"):
        World.load(write_map(tmp_path, board))


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        *(({"resolution": value}, "resolution: ") for value in (None, 0, "'0.05'", ".nan")),
        ({"origin": "[0, 0]"}, "origin: "),
        ({"origin": "[0, 0, .inf]"}, "origin[2]: "),
        ({"negate": 2}, "negate: "),
        ({"occupied_thresh": 65}, "occupied_thresh: "),
        ({"free_thresh": -0.1}, "free_thresh: "),
        ({"mode": "binary"}, "mode: "),
        *(({"image": value}, "image: ") for value in ("", "''", "[a]")),
    ],
)
def test_bad_fields(tmp_path: Path, keys: dict[str, Any], problem: str) -> None:
    with pytest.raises(FormatError) as caught:
        World.load(write_map(tmp_path, grey([0]), **keys))
    assert str(caught.value).startswith(f"{tmp_path / 'map.yaml'}: {problem}")


@pytest.mark.parametrize("keys", [{"resolution": "1e-320"}, {"resolution": "1e-9", "origin": "[1e12, 0, 0]"}])
def test_cells_too_small_to_tell_apart(tmp_path: Path, keys: dict[str, Any]) -> None:
    with pytest.raises(FormatError, match=r"map\.yaml: "):
        World.load(write_map(tmp_path, grey([0, 254]), **keys))


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_unknown_cells_that_a_threshold_makes_free_are_warned_of(tmp_path: Path, mode: str) -> None:
    picture = grey([205, 205, 254], [0, 205, 254])
    quiet: list[tuple[Image.Image, dict[str, Any]]]
    quiet = [(picture, {"free_thresh": 0.196}), (picture, {"negate": 1}), (grey([206, 254]), {})]
    for image, keys in quiet:
        assert not World.load(write_map(tmp_path, image, mode=mode, **{"free_thresh": 0.25, **keys})).notes
    (note,) = World.load(write_map(tmp_path, picture, mode=mode, free_thresh=0.25)).notes
    assert "3 cells of grey 205, which map savers write for unknown, are free" in note


BOUNDS = (-1.0, 2.0, 5.0, 6.0)
WALL, POST = Rectangle((2.0, 4.0), 2.0, 0.04, 0.3), Disc((0.0, 3.0), 0.4)
HIDDEN = Polygon(np.array([[4.0, 5.0], [5.0, 5.0], [5.0, 6.0], [4.0, 6.0]]))


def test_a_saved_map_holds_the_obstacles_and_hardly_more(tmp_path: Path) -> None:
    known = tuple(ObstacleEstimate(shape, 1e-4 * np.eye(2)) for shape in (WALL, POST))
    world = World("w", BOUNDS, (WALL, POST, HIDDEN), estimates=(*known, None))
    files = save_nav2_map(world, tmp_path / "map.yaml", 0.05)
    assert files == (tmp_path / "map.yaml", tmp_path / "map.pgm")
    read = World.load(files[0])
    assert np.allclose(read.bounds, BOUNDS)
    blocked = shapely.union_all([shape.polygon().shapely() for shape in read.obstacles])
    for shape in (WALL, POST, HIDDEN):
        assert shapely.covers(shapely.buffer(blocked, 1e-6), shape.polygon(1e-4).shapely())
    outside = shapely.union_all([shape.polygon(1e-4).shapely().buffer(0.12) for shape in (WALL, POST, HIDDEN)])
    assert shapely.covers(outside, blocked)
    image = np.frombuffer(files[1].read_bytes()[-120 * 80 :], dtype=np.uint8).reshape(80, 120)
    assert set(np.unique(image)) == {0, 205, 254}
    assert image[5, 110] == 205  # the first row has the largest y
    assert (image == 205).sum() == 400


def test_without_estimates_all_obstacles_are_solid(tmp_path: Path) -> None:
    boundary = Polygon(np.array([[-1.0, 2.0], [5.0, 2.0], [5.0, 4.0], [-1.0, 4.0]]))
    _, image = save_nav2_map(World("w", BOUNDS, (POST,), boundary=boundary), tmp_path / "map.yaml", 0.1)
    cells = np.frombuffer(image.read_bytes()[-60 * 40 :], dtype=np.uint8).reshape(40, 60)
    assert cells[29, 10] == 0
    assert (cells[:20] == 205).all()
    assert cells[39, 59] == 254


PLAIN = World("w", (0.0, 0.0, 9.0, 9.0))


def write_mask(folder: Path, rows: list[list[int]], **keys: Any) -> Path:
    Image.fromarray(np.array(rows, dtype=np.uint8)).save(folder / "mask.pgm")
    fields = {"image": "mask.pgm", "resolution": 0.5, "origin": [1.0, 2.0, 0.0], **keys}
    file = folder / "mask.yaml"
    file.write_text("".join(f"{key}: {value}\n" for key, value in fields.items()))
    return file


def test_occupied_cells_are_kept_out_of(tmp_path: Path) -> None:
    # Free, unknown, and two regions of occupied cells, which meet in a corner only.
    file = write_mask(tmp_path, [[254, 205, 0], [0, 0, 254]], mode="trinary", occupied_thresh=0.65, free_thresh=0.1)
    world = PLAIN.with_mask(file)
    assert all(isinstance(zone, KeepOutZone) for zone in world.zones)
    assert sorted(zone.region.bounding_box() for zone in world.zones) == [(1.0, 2.0, 2.0, 2.5), (2.0, 2.5, 2.5, 3.0)]
    assert set(world.sources) == {file, tmp_path / "mask.pgm"}


@pytest.mark.parametrize(("mode", "column"), [("scale", 0), ("raw", 3)])
def test_grades_are_left_open(tmp_path: Path, mode: str, column: int) -> None:
    file = write_mask(tmp_path, [[1, 50, 99, 100, 101, 254]], mode=mode, occupied_thresh=0.99, free_thresh=0.1)
    (zone,) = PLAIN.with_mask(file).zones
    assert zone.region.bounding_box() == (1.0 + 0.5 * column, 2.0, 1.5 + 0.5 * column, 2.5)


@pytest.mark.slow
def test_speeds_are_shares_of_the_maximum(tmp_path: Path) -> None:
    grades = list(range(0, 256, 5))
    file = write_mask(tmp_path, [grades], mode="scale", occupied_thresh=1.0, free_thresh=0.0)
    world = PLAIN.with_mask(file, "speed", max_speed=2.0)
    expected = {}
    for column, grade in enumerate(grades):
        value = round(100.0 * (1.0 - grade / 255.0))
        if 0 < value < 100:  # 0 is no limit, and so is a limit of 0 %
            expected[1.25 + 0.5 * column] = 2.0 * (100 - value) / 100
    for column in range(len(grades)):
        x = 1.25 + 0.5 * column
        limits = [zone.limit for zone in world.zones if isinstance(zone, SpeedZone) and holds(zone, x)]
        assert limits == pytest.approx([expected[x]] if x in expected else [])


def holds(zone: SpeedZone, x: float) -> bool:
    return bool(shapely.contains_xy(zone.region.shapely(), x, 2.25))


def test_base_and_multiplier(tmp_path: Path) -> None:
    file = write_mask(tmp_path, [[0, 20, 40, 90, 100, 101]], mode="raw")
    zones = PLAIN.with_mask(file, "speed", base=10.0, multiplier=1.0).zones
    limits = sorted(zone.limit for zone in zones if isinstance(zone, SpeedZone))
    assert limits == pytest.approx([0.3, 0.5, 1.0])  # 10 + 100 % is beyond the maximum: no limit


def test_what_is_no_mask_is_refused(tmp_path: Path) -> None:
    file = write_mask(tmp_path, [[0, 254]])
    with pytest.raises(WorldError, match=r"mask: kind: expected keep-out, speed, got 'sped' \(did you"):
        PLAIN.with_mask(file, "sped")  # type: ignore[arg-type]
    with pytest.raises(WorldError, match="mask: max speed: expected a finite number above 0, got 0"):
        PLAIN.with_mask(file, "speed", max_speed=0.0)
    with pytest.raises(WorldError, match="mask: base: expected a finite number, got nan"):
        read_mask(file, "speed", base=float("nan"))
    with pytest.raises(FormatError, match="image cannot be read"):
        PLAIN.with_mask(write_mask(tmp_path, [[0]], image="none.pgm"))
    (tmp_path / "world.yaml").write_text("trailmark: 1\nbounds: [0, 0, 1, 1]\n")
    with pytest.raises(FormatError, match="no mask: expected nav2 map YAML"):
        PLAIN.with_mask(tmp_path / "world.yaml")
    with pytest.raises(FormatError, match=r"none\.yaml"):
        PLAIN.with_mask(tmp_path / "none.yaml")
