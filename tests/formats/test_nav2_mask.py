"""Filter masks of nav2: what their cells say, against nav2's formulas written down once more, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from PIL import Image

from trailmark import KeepOutZone, SpeedZone, World
from trailmark.errors import FormatError, WorldError
from trailmark.formats.nav2_map import read_mask

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
