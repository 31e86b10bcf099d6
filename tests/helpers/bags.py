"""ROS bags of both generations, of messages that say as little as a test needs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

rosbags = pytest.importorskip("rosbags", reason="the extra trailmark[ros] is not installed")

from rosbags.rosbag1 import Writer as Writer1  # noqa: E402 # after the check that rosbags is there
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

__all__ = ["KINDS", "Bag", "Kind", "Message"]

Kind = Literal["ros1", "sqlite3", "mcap"]
KINDS: tuple[Kind, ...] = ("ros1", "sqlite3", "mcap")
TRANSFORMS = "tf2_msgs/msg/TFMessage"
Message = tuple[str, str, float, Any]
"""Topic, type, when the bag received it (seconds), the message."""


@cache
def typestore(which: Stores) -> Any:
    """Return ROS's messages; what is compiled for one bag serves the others."""
    store = get_typestore(which)
    if which == Stores.ROS1_NOETIC:  # whose store leaves out tf2
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
    return store


def stamped(t: float, frame: str) -> dict[str, Any]:
    """A header."""
    return {"stamp": {"sec": int(t), "nanosec": round((t - int(t)) * 1e9)}, "frame_id": frame}


def quaternion(roll: float, yaw: float) -> dict[str, float]:
    """A turn by yaw about z after one by roll about x."""
    (sx, cx), (sz, cz) = ((math.sin(turn / 2), math.cos(turn / 2)) for turn in (roll, yaw))
    return {"x": sx * cz, "y": sx * sz, "z": cx * sz, "w": cx * cz}


class Bag:
    """Makes messages of one ROS generation and writes them."""

    def __init__(self, kind: Kind) -> None:
        self.kind = kind
        self.store = typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)

    def make(self, name: str, **given: Any) -> Any:
        """Return a message: mappings become messages of their own, what is left out is 0 or empty."""
        fields = dict[str, Any]()
        for field, (kind, detail) in self.store.fielddefs[name][1]:
            if kind.name == "NAME":
                fields[field] = self.make(detail, **given.get(field, {}))
            elif kind.name == "BASE":
                fields[field] = given.get(field, "" if detail[0] == "string" else 0)
            else:
                fields[field] = given.get(field, np.zeros(detail[1], detail[0][1][0]))
        return self.store.types[name](**fields)

    def odometry(self, t: float, pose: Sequence[float], topic: str = "/odom", stamp: float | None = None) -> Message:
        place = {"position": dict(zip("xy", map(float, pose), strict=False)), "orientation": quaternion(0.0, pose[2])}
        header = stamped(t if stamp is None else stamp, "odom")
        kind = "nav_msgs/msg/Odometry"
        return topic, kind, t, self.make(kind, header=header, child_frame_id="base_footprint", pose={"pose": place})

    def scan(self, t: float, ranges: Sequence[float], topic: str = "/scan", **changes: float) -> Message:
        beams = {"angle_min": -1.0, "angle_increment": 0.5, "range_min": 0.1, "range_max": 10.0, **changes}
        kind, met = "sensor_msgs/msg/LaserScan", np.array(ranges, dtype=np.float32)
        return topic, kind, t, self.make(kind, header=stamped(t, "laser"), ranges=met, **beams)

    def transform(
        self,
        parent: str,
        child: str,
        shift: Sequence[float],
        roll: float = 0.0,
        yaw: float = 0.0,
        topic: str = "/tf_static",
        t: float = 1.0,
    ) -> Message:
        place = {"translation": dict(zip("xyz", shift, strict=True)), "rotation": quaternion(roll, yaw)}
        kind = "geometry_msgs/msg/TransformStamped"
        entry = self.make(kind, header=stamped(t, parent), child_frame_id=child, transform=place)
        return topic, TRANSFORMS, t, self.make(TRANSFORMS, transforms=[entry])

    def write(self, folder: Path, messages: Sequence[Message]) -> Path:
        """Write a bag and return its path."""
        path = folder / ("drive.bag" if self.kind == "ros1" else "drive")
        writer: Any
        if self.kind == "ros1":
            writer = Writer1(path)
        else:
            plugin = StoragePlugin.SQLITE3 if self.kind == "sqlite3" else StoragePlugin.MCAP
            writer = Writer2(path, version=8, storage_plugin=plugin)
        serialize = self.store.serialize_ros1 if self.kind == "ros1" else self.store.serialize_cdr
        with writer:
            connections: dict[tuple[str, str], Any] = {}
            for topic, kind, t, message in messages:
                if (topic, kind) not in connections:
                    connections[topic, kind] = writer.add_connection(topic, kind, typestore=self.store)
                writer.write(connections[topic, kind], round(t * 1e9), serialize(message, kind))
        return path
