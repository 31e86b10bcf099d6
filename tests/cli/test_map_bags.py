"""trailmark map on ROS bags that the test itself writes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.world import World

Shell = Callable[..., Any]
Terminal = Callable[..., Any]


def record(shell: Shell, *words: object) -> dict[str, Any]:
    run = shell("map", *words, "--json")
    assert (run.status, run.err) == (0, "")
    found = json.loads(run.out)
    assert isinstance(found, dict)
    return found


@pytest.mark.slow
def test_bags(shell: Shell, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra trailmark[ros] is not installed")
    write_bag(tmp_path / "drive", scans=True)
    write_bag(tmp_path / "blind", scans=False)
    file = tmp_path / "world.yaml"
    found = record(shell, tmp_path / "drive", "--output", file, "--confidence", "0.9")
    assert found["records"] | {"poses": 1} == found["records"] | {"scans": 12}
    assert found["poses"] == "match"
    assert found["obstacles"]["walls"] >= 1
    World.load(file)
    settings = tmp_path / "settings.yaml"
    settings.write_text("log: {scan_topic: /scan, odometry_topic: /odom}")
    words = ["--settings", settings]
    assert record(shell, tmp_path / "drive", "--output", file, *words)["records"]["scans"] == 12
    settings.write_text("log: {scan_topic: /scann}")
    run = shell("map", tmp_path / "drive", "--output", file, *words)
    assert "got '/scann'" in run.problem
    file.unlink()
    run = shell("map", tmp_path / "blind", "--output", file)
    assert run.status == 2
    assert run.problem.startswith(
        f"{tmp_path / 'blind'}: no topic of type sensor_msgs/LaserScan in the bag; it has: /odom"
    )
    assert not file.exists()


def write_bag(path: Path, scans: bool) -> None:
    """Write a ROS 2 bag of a robot that drives along a wall 2 m to its left."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)

    def make(name: str, **fields: Any) -> Any:
        return store.types[name](**fields)

    def header(t: float, frame: str) -> Any:
        stamp = make("builtin_interfaces/msg/Time", sec=int(t), nanosec=round((t - int(t)) * 1e9))
        return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def odometry(t: float, x: float) -> Any:
        zero = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        point = make("geometry_msgs/msg/Point", x=x, y=0.0, z=0.0)
        ahead = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        pose = make("geometry_msgs/msg/Pose", position=point, orientation=ahead)
        twist = make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        return make(
            "nav_msgs/msg/Odometry",
            header=header(t, "odom"),
            child_frame_id="base_link",
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )

    def scan(t: float) -> Any:
        angles = np.linspace(-1.5, 1.5, 121)
        ranges = np.where(angles > 0.3, 2.0 / np.sin(np.maximum(angles, 0.3)), 11.0)
        return make(
            "sensor_msgs/msg/LaserScan",
            header=header(t, "base_link"),
            ranges=ranges.astype(np.float32),
            intensities=np.zeros(0, dtype=np.float32),
            angle_min=-1.5,
            angle_max=1.5,
            angle_increment=0.025,
            time_increment=0.0,
            scan_time=0.1,
            range_min=0.1,
            range_max=10.0,
        )

    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        odom = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        laser = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=store) if scans else None
        for i in range(1, 13):
            t, x = 100.0 + 0.5 * i, 0.3 * i
            nanoseconds = round(1e9 * t)
            writer.write(odom, nanoseconds, store.serialize_cdr(odometry(t, x), "nav_msgs/msg/Odometry"))
            if laser is not None:
                writer.write(laser, nanoseconds, store.serialize_cdr(scan(t), "sensor_msgs/msg/LaserScan"))
