"""GeoJSON in metres: what any reader of it finds."""

from __future__ import annotations

import json

import numpy as np
import shapely

from trailmark.formats.path_files import geojson_feature, geojson_text, path_text
from trailmark.path import Path

STATES = np.array([[0.1, -2.0, 0.0], [1e-7, 3.5, 3.0], [1.0, 1.0, -3.0]])


def test_a_path_is_a_line_with_headings() -> None:
    path = Path(STATES)
    text = path_text(path, "odom")
    (line,) = json.loads(text)["features"]
    assert shapely.get_coordinates(shapely.from_geojson(text)).tolist() == STATES[:, :2].tolist()
    assert line["properties"]["theta"] == STATES[:, 2].tolist()
    assert line["properties"]["frame"] == "odom"
    assert line["properties"]["cost"] == path.cost


def test_a_line_has_two_positions_or_more() -> None:
    (line,) = json.loads(path_text(Path(STATES[:1]), "map"))["features"]
    assert line["geometry"]["coordinates"] == [[0.1, -2.0]] * 2


def test_features_stand_on_lines_of_their_own() -> None:
    text = geojson_text([geojson_feature({"id": i}, "Point", [i, 0.5]) for i in range(3)])
    assert text.count("\n") == 5
    assert [item["properties"]["id"] for item in json.loads(text)["features"]] == [0, 1, 2]
