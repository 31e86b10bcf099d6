"""Unknown space of a map: blocked, free or at a price; masks with grades; zones from files of polygons."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

from trailmark import CostZone, FormatError, KeepOutZone, LandmarkPlanner, Robot, StateChecker, TrailmarkError, World

FREE, UNKNOWN, OCCUPIED = 254, 205, 0
MAP = "image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.15\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A map of 10 x 4 m: free, but for a band of unknown cells across and an occupied block in the band."""
    pixels = np.full((40, 100), FREE, np.uint8)
    pixels[:, 40:60] = UNKNOWN
    pixels[:15, 40:60] = OCCUPIED
    Image.fromarray(pixels).save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text(MAP)
    return tmp_path / "map.yaml"


@pytest.mark.parametrize(("unknown", "status"), [(None, "infeasible"), ("blocked", "infeasible"), ("free", "solved")])
def test_unknown_cells_are_what_they_are_said_to_be(file: Path, unknown: str | None, status: str) -> None:
    world = World.load(file, unknown=unknown)  # type: ignore[arg-type]
    result = LandmarkPlanner(world, Robot.disc(0.3), seed=0).plan((1.0, 2.0, 0.0), (9.0, 2.0, 0.0), 5.0)
    assert result.status == status
    assert not StateChecker(world, Robot.disc(0.3)).valid((5.0, 3.5, 0.0))  # occupied in any case
    areas = [region.shapely().area for region in world.unknown]
    assert areas == ([] if unknown is None else pytest.approx([2.0 * 2.5]))


def test_in_mode_scale_what_is_not_opaque_is_unknown_whatever_its_grey(file: Path) -> None:
    pixels = np.array([[[FREE, 255], [OCCUPIED, 255], [FREE, 128], [OCCUPIED, 128], [100, 0]]], np.uint8)
    Image.fromarray(pixels).save(file.parent / "map.png")
    file.write_text(MAP + "mode: scale\n")
    world = World.load(file, unknown="free")
    assert [region.bounding_box() for region in world.unknown] == [pytest.approx((0.2, 0.0, 0.5, 0.1))]
    assert [shape.bounding_box() for shape in world.obstacles] == [pytest.approx((0.1, 0.0, 0.2, 0.1))]


def test_a_metre_in_unknown_cells_costs_more(file: Path) -> None:
    free, priced = (World.load(file, unknown=unknown) for unknown in ("free", 4.0))
    assert [zone.factor for zone in priced.zones if isinstance(zone, CostZone)] == [4.0]
    costs = [
        LandmarkPlanner(world, Robot.disc(0.3), seed=0).plan((1.0, 1.0, 0.0), (9.0, 1.0, 0.0), 5.0).cost
        for world in (free, priced)
    ]
    assert costs == pytest.approx([8.0, 6.0 + 4.0 * 2.0], rel=1e-3)


@pytest.mark.parametrize("wrong", ["perhaps", 0.0, -1.0, float("nan")])
def test_another_price_is_refused_in_one_line(file: Path, wrong: object) -> None:
    with pytest.raises(TrailmarkError, match="unknown: expected"):
        World.load(file, unknown=wrong)  # type: ignore[arg-type]


def test_only_a_map_has_unknown_cells(worlds: Path) -> None:
    with pytest.raises(TrailmarkError, match="expected a nav2 map"):
        World.load(worlds / "office.yaml", unknown="free")


def test_a_mask_is_graded_below_its_threshold(file: Path) -> None:
    values = np.zeros((40, 100), np.uint8)
    values[:, 10:20], values[:, 30:40], values[:, 50:60] = 25, 60, 100
    Image.fromarray(values).save(file.parent / "mask.png")
    (file.parent / "mask.yaml").write_text(MAP.replace("map.png", "mask.png") + "mode: raw\n")
    world = World.load(file)
    plain = world.with_mask(file.parent / "mask.yaml").zones
    assert [type(zone) for zone in plain] == [KeepOutZone]
    graded = world.with_mask(file.parent / "mask.yaml", threshold=60.0, max_factor=5.0).zones
    assert sorted(zone.region.bounding_box()[0] for zone in graded if isinstance(zone, KeepOutZone)) == [3.0, 5.0]
    assert [(zone.factor, zone.region.bounding_box()[0]) for zone in graded if isinstance(zone, CostZone)] == [
        (2.0, 1.0)
    ]
    with pytest.raises(TrailmarkError, match="mask: threshold: expected"):
        world.with_mask(file.parent / "mask.yaml", threshold=0.0)


SQUARE = "POLYGON ((1 1, 2 1, 2 2, 1 2, 1 1))"
GEOMETRY = '{"type": "Polygon", "coordinates": [[[1, 1], [2, 1], [2, 2], [1, 2], [1, 1]]]}'
FEATURE = f'{{"type": "Feature", "properties": {{}}, "geometry": {GEOMETRY}}}'
NOWHERE = '{"type": "Feature", "properties": {}, "geometry": null}'
CROSSED = "POLYGON ((0 0, 2 2, 2 0, 0 2, 0 0))"
CURVED = "CURVEPOLYGON (CIRCULARSTRING (0 0, 4 0, 4 4, 0 4, 0 0))"


@pytest.mark.parametrize(
    ("text", "areas"),
    [
        (SQUARE, [1.0]),
        (f"{SQUARE}\n\nMULTIPOLYGON (((3 1, 4 1, 4 2, 3 1)), ((5 1, 6 1, 6 2, 5 1)))\n", [1.0, 0.5, 0.5]),
        (FEATURE, [1.0]),
        (f'{{"type": "FeatureCollection", "features": [{FEATURE}, {FEATURE}]}}', [1.0, 1.0]),
        (f'{{"type": "FeatureCollection", "features": [{FEATURE}, {NOWHERE}]}}', [1.0]),
    ],
)
def test_polygons_of_files_become_keep_out_zones(tmp_path: Path, text: str, areas: list[float]) -> None:
    file = tmp_path / "zones.txt"
    file.write_text(text)
    world = World("field", (0.0, 0.0, 10.0, 10.0)).with_zones(file, CostZone([(7, 7), (8, 7), (8, 8)], 2.0))  # type: ignore[arg-type]
    assert [zone.region.shapely().area for zone in world.zones[:-1]] == pytest.approx(areas)
    assert {zone.kind for zone in world.zones[:-1]} == {"keep-out"}
    assert world.zones[-1].kind == "cost"
    assert file in world.sources


@pytest.mark.parametrize(
    "text",
    [
        *["", "POLYGON((1 1", "kitchen", '{"type": "Point", "coordinates": [1, 2]}', "{", "[" * 9999, CURVED],
        f"{SQUARE}\n{CROSSED}",  # whose halves make up no area, but a zone was meant
    ],
)
def test_a_file_without_polygons_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "zones.wkt").write_text(text)
    with pytest.raises(FormatError, match="expected polygons as GeoJSON or WKT, got"):
        World("field", (0.0, 0.0, 10.0, 10.0)).with_zones(tmp_path / "zones.wkt")


def test_geometries_come_with_zones() -> None:
    import shapely

    zone = KeepOutZone([(1, 1), (2, 1), (2, 2)])  # type: ignore[arg-type]
    world = World.from_geometries([shapely.box(4, 4, 5, 5)], (0, 0, 9, 9), zones=[zone])
    assert (len(world.obstacles), world.zones) == (1, (zone,))


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"zones": None}, "zones: expected a sequence, got None"),
        ({"zones": KeepOutZone(shapely.box(1, 1, 2, 2))}, "zones: expected a sequence, got KeepOutZone"),
        ({"bounds": 5}, "bounds: expected four numbers"),
    ],
)
def test_other_zones_and_bounds_than_a_sequence_are_refused_in_one_line(options: dict[str, object], fault: str) -> None:
    with pytest.raises(TrailmarkError, match=f"^{fault}"):
        World.from_geometries(shapely.box(4, 4, 5, 5), **options)  # type: ignore[arg-type]
