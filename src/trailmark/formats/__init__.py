"""File formats: worlds in trailmark YAML, nav2, MovingAI, OMPL.app and ARiADNE form; paths as JSON, CSV and plain rows.

They take and give plain data: shapes, arrays, texts, and arguments of :class:`trailmark.World` as mappings.
"""

from __future__ import annotations

from typing import Any

__all__ = ["world_json_schema"]


def world_json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the world file, with which editors complete and check it."""
    from trailmark.formats.schema import WorldFile

    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **WorldFile.model_json_schema()}
