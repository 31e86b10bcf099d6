"""Keep-out zones as obstacles: the world that robots are checked in."""

from __future__ import annotations

from trailmark.errors import WorldError
from trailmark.shapes import Polygon
from trailmark.world import World
from trailmark.zones import KEEP_OUT, KeepOutZone

__all__ = ["keep_outs", "with_keep_outs"]


def keep_outs(world: World) -> dict[str, Polygon]:
    """Return the regions of a world's keep-out zones by their names: ``keep-out zone i``, i the index in ``zones``."""
    return {f"{KEEP_OUT} {i}": zone.region for i, zone in enumerate(world.zones) if isinstance(zone, KeepOutZone)}


def with_keep_outs(world: World) -> World:
    """Return the world in which each keep-out zone is also an obstacle, the zone's name its id.

    That is the world itself if it has no such zones, or if all of them stand there already.

    Raises:
        WorldError: another obstacle has such an id.
    """
    zones = keep_outs(world)
    known = dict(zip(world.ids, world.obstacles, strict=True)) if zones and world.ids else {}
    for name, region in zones.items():
        if known.get(name, region) != region:
            raise WorldError(f"ids: {name!r} is the name of a zone, expected another one for an obstacle")
    missing = {name: region for name, region in zones.items() if name not in known}
    return world.edited(add=missing) if missing else world
