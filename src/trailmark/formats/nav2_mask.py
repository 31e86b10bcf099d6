"""Filter masks of nav2: a map file and its image, whose cells say where to keep out or how fast to go.

Definitions follow nav2_map_server (map_io.cpp) for a cell's value, 0 to 100, or -1 where it is unknown, and
nav2_costmap_2d's KeepoutFilter and SpeedFilter for what it means.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from trailmark.arguments import number
from trailmark.errors import FormatError, WorldError, expected_name
from trailmark.formats.grid import grid_polygons
from trailmark.zones import KeepOutZone, SpeedZone, Zone

__all__ = ["KINDS", "MaskKind", "read_mask"]

MaskKind = Literal["keep-out", "speed"]
KINDS = ("keep-out", "speed")

LETHAL = 100
"""Value of cells that nav2 keeps out of; lower ones, which it grades into costs, are left open, as are unknown ones."""


def read_mask(
    path: Path, kind: MaskKind, *, max_speed: float = 1.0, base: float = 100.0, multiplier: float = -1.0
) -> tuple[tuple[Zone, ...], tuple[Path, ...]]:
    """Return the zones of a mask, one for each region of cells of the same value, and the files that were read.

    Cells of value 100 of a keep-out mask are kept out of. A cell of value v of a speed mask limits the speed to
    ``base + multiplier · v`` percent of ``max_speed``; where v is 0 or unknown, or that is not above 0 and at most 100,
    there is no limit. nav2's own mask of depot is read with base 100 and multiplier -1.

    Args:
        path: the YAML file, in the form of a nav2 map.
        kind: ``keep-out`` or ``speed``.
        max_speed: metres per second, above 0.
        base: percent.
        multiplier: percent for each unit of a cell's value.

    Raises:
        WorldError: another kind, a number that is not finite, or a speed that is not above 0.
        FormatError: the file or its image cannot be read, or is no nav2 map.
    """
    from trailmark.formats.files import read_text
    from trailmark.formats.nav2_map import occupancy, pixels_of
    from trailmark.formats.schema import MapFile
    from trailmark.formats.validation import validate
    from trailmark.formats.yaml_data import parse_yaml

    if kind not in KINDS:
        raise WorldError(f"mask: kind: {expected_name(str(kind), KINDS)}")
    fastest = number(max_speed, "mask: max speed:", above=0.0, unit="m/s", error=WorldError)
    base, multiplier = (
        number(v, f"mask: {name}:", error=WorldError) for v, name in ((base, "base"), (multiplier, "multiplier"))
    )
    data: Any = parse_yaml(read_text(path, "expected the YAML file of a nav2 mask"), path)
    if not isinstance(data, dict) or "image" not in data:
        raise FormatError(path, "no mask: expected nav2 map YAML (keys image, resolution, origin)")
    file = validate(MapFile, data, path)
    image = path.parent / file.image
    values = pixels_of(image, lambda pixels: occupancy(pixels, file))[::-1]
    x, y, yaw = file.origin
    zones: list[Zone] = []
    try:
        for value in np.unique(values[values > 0]).tolist():
            percent = base + multiplier * value
            if (value != LETHAL) if kind == "keep-out" else not 0.0 < percent <= 100.0:
                continue
            regions = grid_polygons(values == value, file.resolution, (x, y, yaw))
            limit = 0.01 * percent * fastest
            zones += [KeepOutZone(region) if kind == "keep-out" else SpeedZone(region, limit) for region in regions]
    except WorldError as error:
        raise FormatError(image, str(error)) from None
    return tuple(zones), (path.absolute(), image.absolute())
