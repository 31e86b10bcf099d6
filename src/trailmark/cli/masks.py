"""Options for nav2's filter masks, which add zones to a world."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from trailmark.cli.options import option

if TYPE_CHECKING:
    from trailmark.world import World

__all__ = ["KeepoutOption", "SpeedMaskOption", "with_masks"]

KeepoutOption = Annotated[
    str | None, option("--keepout", "MASK.yaml", "A nav2 keep-out mask: its occupied cells become keep-out zones.")
]
SpeedMaskOption = Annotated[
    str | None,
    option(
        "--speed-mask", "MASK.yaml", "A nav2 speed mask: its cells become speed zones, shares of --max-speed or 1 m/s."
    ),
]


def with_masks(world: World, keepout: str | None, speed: str | None, max_speed: float = 1.0) -> World:
    """Return the world with the zones of the masks that are given.

    Args:
        world: as loaded.
        keepout: file of a keep-out mask.
        speed: file of a speed mask.
        max_speed: metres per second, of which the speed mask allows shares.

    Raises:
        FormatError: a mask cannot be read.
    """
    if keepout is not None:
        world = world.with_mask(keepout, "keep-out")
    return world if speed is None else world.with_mask(speed, "speed", max_speed=max_speed)
