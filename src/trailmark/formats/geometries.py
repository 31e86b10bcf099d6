"""Polygons as GeoJSON or WKT."""

from __future__ import annotations

import json
from pathlib import Path

from trailmark.errors import FormatError, ShapeError
from trailmark.formats.files import read_text
from trailmark.shapes import Polygon, shapes_of

__all__ = ["read_polygons"]

ALLOWED = "expected polygons as GeoJSON or WKT"


def read_polygons(path: Path) -> list[Polygon]:
    """Return the polygons of a file, in metres of the world; properties, points, lines and nulls are left aside.

    Args:
        path: GeoJSON (a geometry, a feature, a collection), or a text of WKT, one geometry in each line.

    Raises:
        FormatError: the file is missing, is neither, or holds no polygon; or a polygon is not valid.
    """
    import shapely

    text = read_text(path, ALLOWED)
    try:
        if text.lstrip()[:1] == "{":
            data = json.loads(text)
            items = data.get("features", [data]) if isinstance(data, dict) else []
            placed = (item for item in items if not isinstance(item, dict) or item.get("geometry", item) is not None)
            shapes = [shapely.from_geojson(json.dumps(item)) for item in placed]
        else:
            shapes = [shapely.from_wkt(line) for line in text.splitlines() if line.strip()]
        every = [part for part in shapely.get_parts(shapely.get_parts(shapes)) if not part.is_empty]
        # One that crosses itself may have no area, and is not to be left aside.
        parts = [part for part in every if part.geom_type == "Polygon" or part.area > 0.0]
        found = [shape.polygon() for i, part in enumerate(parts) for shape in shapes_of(part, f"polygon {i}")]
    except (
        shapely.errors.ShapelyError,
        ShapeError,
        ValueError,
        TypeError,
        RecursionError,
        NotImplementedError,  # shapely knows no curves of WKT
    ) as error:
        raise FormatError(path, f"{ALLOWED}, got {' '.join(str(error).split())[:120]}") from None
    if not found:
        raise FormatError(path, f"{ALLOWED}, got none with an area")
    return found
