"""TUM trajectories: a row ``t x y z qx qy qz qw`` for each pose, as evo and other evaluation programs read them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from trailmark.checked import checked_arguments, shaped
from trailmark.errors import WorldError
from trailmark.formats.files import write_atomically

__all__ = ["write_tum"]


@checked_arguments(WorldError)
def write_tum(path: str | Path, trajectory: Annotated[ArrayLike, shaped(None, 4)]) -> None:
    """Write a trajectory.

    Args:
        path: the file.
        trajectory: shape (n, 4), rows t (seconds), x, y (metres), theta (radians).

    Raises:
        WorldError: another shape, not finite.
        OutputError: the path cannot be written.
    """
    rows = np.asarray(trajectory)
    half = 0.5 * rows[:, 3]
    lines = [
        f"{t!r} {x!r} {y!r} 0 0 0 {qz!r} {qw!r}\n"
        for t, x, y, qz, qw in np.column_stack([rows[:, :3], np.sin(half), np.cos(half)]).tolist()
    ]
    write_atomically(Path(path), "".join(lines))
