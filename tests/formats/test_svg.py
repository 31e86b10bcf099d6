"""Drawings to scale: their coordinates are the world's, exactly."""

from __future__ import annotations

import re
from pathlib import Path as FilePath
from xml.etree import ElementTree as ET

import numpy as np
import shapely

from trailmark.formats.outputs import require_replaceable
from trailmark.formats.svg import drawing_text
from trailmark.path import Path
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Robot, World
from trailmark.zones import CostZone, KeepOutZone

SQUARE = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]])
WORLD = World(
    "yard <& shed>",
    (-2.0, 0.5, 10.0, 6.5),
    (Disc((5.0, 3.0), 0.75), Rectangle((8.0, 2.0), 1.0, 0.5, 0.3), Polygon(2.0 * SQUARE, (2.0 * SQUARE * 0.25 + 2.0,))),
    boundary=Polygon(np.array([[-1.0, 1.0], [9.0, 1.0], [9.0, 6.0]])),
    zones=(CostZone(Polygon(SQUARE), 2.0), KeepOutZone(Polygon(SQUARE + 5.0))),
)
PATH = Path(np.array([[0.1, 1e-7, 0.0], [4.0, 1.5, 3.0], [8.0, 5.0, -3.0]]))


def elements(text: str) -> dict[str, list[ET.Element]]:
    found: dict[str, list[ET.Element]] = {}
    for element in ET.fromstring(text).iter():  # noqa: S314  # our own
        found.setdefault(element.get("class", element.tag.split("}")[1]), []).append(element)
    return found


def rings(element: ET.Element) -> list[list[list[float]]]:
    texts = [text for text in re.split("[MZ]", element.get("d", "")) if text]
    return [[[float(v) for v in point.split(" ")] for point in text.split("L")] for text in texts]


def test_everything_is_where_it_is_in_the_world() -> None:
    found = elements(drawing_text(WORLD, Robot.rectangle(0.6, 0.4), PATH))
    assert found["title"][-1].text == "yard <& shed>"
    disc, rectangle, holed = found["obstacle"]
    assert [float(disc.get(key, "")) for key in ("cx", "cy", "r")] == [5.0, 3.0, 0.75]
    assert shapely.Polygon(rings(rectangle)[0]).equals(WORLD.obstacles[1].polygon().shapely())
    outline, hole = rings(holed)
    assert shapely.Polygon(outline, [hole]).equals(WORLD.obstacles[2].polygon().shapely())
    assert rings(found["path"][0]) == [PATH.states[:, :2].tolist()]
    assert shapely.Polygon(rings(found["bounds"][0])[0]).equals(shapely.box(*WORLD.bounds))
    assert len(found["boundary"]) == len(found["zone cost"]) == len(found["zone keep-out"]) == 1
    bodies = [shapely.Polygon(rings(body)[0]) for body in found["robot"]]
    assert len(bodies) == int(PATH.cost / np.hypot(0.6, 0.4)) + 1
    np.testing.assert_allclose([body.area for body in bodies], 0.24)
    np.testing.assert_allclose(shapely.get_coordinates(bodies[-1].centroid), [[8.0, 5.0]])


def test_the_drawing_is_to_scale() -> None:
    root = ET.fromstring(drawing_text(WORLD, Robot.disc(0.2), None))  # noqa: S314  # our own
    left, top, width, height = map(float, root.get("viewBox", "").split())
    assert (root.get("width"), root.get("height")) == (f"{width!r}cm", f"{height!r}cm")
    xmin, ymin, xmax, ymax = WORLD.bounds
    assert left < xmin < xmax < left + width
    assert top < -ymax < -ymin < top + height
    assert "path" not in {element.get("class") for element in root.iter()}


def test_it_may_be_written_again(tmp_path: FilePath) -> None:
    (tmp_path / "a.svg").write_text(drawing_text(WORLD, Robot.disc(0.2), PATH))
    require_replaceable(tmp_path / "a.svg")
