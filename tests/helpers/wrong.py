"""Values that are wrong wherever a number, an array or an object of trailmark's is expected."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np
import shapely

from trailmark import Disc, Robot, World

__all__ = ["WRONG"]

ROOM = World("room", (0.0, 0.0, 6.0, 4.0), (Disc((3.0, 2.0), 0.5),), Robot.rectangle(0.6, 0.4))
MASKED: Any = np.ma.masked_array(np.array([1.0, 1.0, 0.0]), mask=[False, True, False])

WRONG: list[Any] = [
    None,
    "",
    "1",
    "disc:1",
    b"1",
    True,
    -1,
    1.5,
    float("nan"),
    float("inf"),
    10**400,
    1j,
    object(),
    [],
    {},
    {1, 2},
    [[1.0], [2.0, 3.0]],
    np.array([1.0, 2.0]),
    MASKED,
    np.datetime64("2026-01-01"),
    np.timedelta64(1, "s"),
    np.array(["2026-01-01"] * 3, dtype="datetime64[s]"),
    datetime(2026, 1, 1),
    ("1", "1", "0"),
    shapely.box(0, 0, 1, 1),
    [shapely.box(0, 0, 1, 1)],
    lambda *_: None,
    Robot.disc(0.2),
    ROOM,
]
