"""Grid maps in pictures: their cells as an image."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

from trailmark.sketch.cells import MAX_SIDE, cells_image
from trailmark.sketch.frame import Frame
from trailmark.world import World


def test_an_occupied_cell_is_an_opaque_pixel_of_the_colour() -> None:
    occupied = np.random.default_rng(1).random((7, 11)) < 0.4
    pixels = np.array(_image(cells_image(occupied, "#123456")).convert("RGBA"))
    assert ((pixels[::-1, :, 3] == 255) == occupied).all()
    assert set(np.unique(pixels[..., 3])) == {0, 255}
    assert (pixels[..., :3] == (0x12, 0x34, 0x56)).all()


def test_of_a_large_map_pixels_show_shares() -> None:
    occupied = np.zeros((3, 2 * MAX_SIDE), np.bool_)
    occupied[2, ::2] = True  # The upper of its two rows of pixels is the row with the largest y, and its neighbour's.
    occupied[0] = True
    image = _image(cells_image(occupied, "#000000")).convert("RGBA")
    assert image.size == (MAX_SIDE, 2)
    above, below = np.array(image)[:, :, 3].astype(float) / 255.0
    assert above == pytest.approx(0.25, abs=0.04)
    assert below == pytest.approx(1.0)


def test_cells_lie_in_a_picture_where_their_polygons_do() -> None:
    occupied = np.zeros((4, 6), np.bool_)
    occupied[1, 2] = True
    world = World.from_grid(occupied, 0.5, (-1.0, 3.0))
    frame = Frame.around(world.bounds, 0.1, 400.0, 300.0)
    text = frame.obstacles(world.obstacles, 0.25, "#808080")
    x, y, width, height = (
        float(re.findall(rf' {name}="([-0-9.]+)"', text)[0]) for name in ("x", "y", "width", "height")
    )
    cell = np.array([width / 6, height / 4])
    polygon = frame.obstacles(tuple(world.obstacles), 0.25, "#808080")
    corners = frame.at(world.obstacles[0].polygon().vertices)
    assert "<path" in polygon
    assert corners.min(axis=0) == pytest.approx([x, y] + cell * [2, 2], abs=0.06)
    assert corners.max(axis=0) == pytest.approx([x, y] + cell * [3, 3], abs=0.06)


def _image(uri: str) -> Image.Image:
    kind, _, data = uri.partition(",")
    assert kind == "data:image/png;base64"
    return Image.open(io.BytesIO(base64.b64decode(data)))
