from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from PIL import Image

from trailmark import FormatError, Query, World

GREY, FREE, YELLOW = (127, 127, 127, 255), (195, 195, 194, 255), (255, 216, 0, 255)
KINDS = {"#": GREY, ".": FREE, "s": YELLOW}


def picture(*rows: str) -> Image.Image:
    return Image.fromarray(np.array([[KINDS[pixel] for pixel in row] for row in rows], dtype=np.uint8))


def saved(folder: Path, image: Image.Image) -> Path:
    image.save(folder / "cave.png")
    return folder / "cave.png"


def blocked(world: World, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Which pixels' centres lie in an obstacle, by shapely, row 0 on top."""
    rows, columns = np.indices(shape)
    union = shapely.union_all([obstacle.polygon().shapely() for obstacle in world.obstacles])
    return np.asarray(shapely.contains_xy(union, columns + 0.5, shape[0] - 1 - rows + 0.5))


def test_a_pixel_is_a_metre_and_the_start_is_free(tmp_path: Path) -> None:
    rows = ("#####", "#..s#", "#.###", "#####")
    world = World.load(saved(tmp_path, picture(*rows)))
    assert world.name == "cave"
    assert world.bounds == (0.0, 0.0, 5.0, 4.0)
    assert world.queries == (Query("start", (3.5, 2.5, 0.0), (3.5, 2.5, 0.0)),)
    assert world.robot is None
    assert world.sources == (tmp_path / "cave.png",)
    assert np.array_equal(blocked(world, (4, 5)), [[pixel == "#" for pixel in row] for row in rows])


def test_the_start_lies_amid_its_block(tmp_path: Path) -> None:
    world = World.load(saved(tmp_path, picture("sss.", "sss.", "sss.")))
    assert world.query().start == (1.5, 1.5, 0.0)
    ring = World.load(saved(tmp_path, picture("sss", "s#s", "sss")))
    x, y, _ = ring.query().start
    assert not blocked(ring, (3, 3))[2 - int(y), int(x)]


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA", "P"])
def test_modes_of_the_same_picture(tmp_path: Path, mode: str) -> None:
    values = np.array([[127, 195, 208], [0, 255, 151]], dtype=np.uint8)
    world = World.load(saved(tmp_path, Image.fromarray(values).convert(mode)))
    assert world.query().start == (2.5, 1.5, 0.0)
    assert np.array_equal(blocked(world, (2, 3)), [[True, False, False], [True, False, False]])


def test_no_start_and_two(tmp_path: Path) -> None:
    expected = "expected one block of pixels of brightness 208 that marks the start, got"
    with pytest.raises(FormatError, match=f"cave.png: {expected} 0"):
        World.load(saved(tmp_path, picture("#..")))
    with pytest.raises(FormatError, match=f"cave.png: {expected} 2"):
        World.load(saved(tmp_path, picture("s.s")))


@pytest.mark.slow
def test_images_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    deep = Image.fromarray(np.full((2, 2), 208, dtype=np.uint16))
    with pytest.raises(FormatError, match="expected grey or colours of 8 bits, got pixels of mode I"):
        World.load(saved(tmp_path, deep))
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 200, (40, 40)).astype(np.uint8))
    file = saved(tmp_path, noise)
    whole = file.read_bytes()
    file.write_bytes(whole[:900])
    with pytest.raises(FormatError, match=r"cave.png: damaged image"):
        World.load(file)
    file.write_bytes(whole[:8])
    with pytest.raises(FormatError, match=r"cave.png: not an image that can be read"):
        World.load(file)
    file = saved(tmp_path, Image.new("L", (8001, 8000)))
    with pytest.raises(FormatError, match="expected 1 to 64,000,000 cells, got 8001 x 8000"):
        World.load(file)
