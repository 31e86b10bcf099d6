"""GeoJSON in metres, in the map's frame, as nav2's route server has it: features, and paths as lines."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.path import Path

__all__ = ["collection_text", "feature", "path_text"]


def feature(properties: dict[str, Any], kind: str, coordinates: list[Any]) -> dict[str, Any]:
    """Return a feature whose geometry is of a kind such as ``Point``."""
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def collection_text(features: list[dict[str, Any]]) -> str:
    """Return features as a FeatureCollection, one on a line; every number with all its digits."""
    lines = ",\n".join(json.dumps(item, allow_nan=False) for item in features)
    return f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'


def path_text(path: Path, frame: str) -> str:
    """Return a path as one line, with its headings as ``properties.theta`` (radians, one for each position).

    A path of one state becomes a line of two equal ones, for a line has two positions or more.
    """
    states = path.states.tolist() * (2 if len(path) == 1 else 1)
    facts = {"frame": frame, "cost": path.cost, "length": path.length, "rotation": path.rotation}
    properties = {**facts, "theta": [state[2] for state in states]}
    return collection_text([feature(properties, "LineString", [state[:2] for state in states])])
