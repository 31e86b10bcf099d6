"""Logs for the tests of ``trailmark map``: a simulated drive among posts, a small MRCLAM folder, a ROS 2 bag."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.estimation import Detector, Log, RangeBearing, Scanner, Unicycle, simulate
from trailmark.shapes import Disc
from trailmark.world import World

POSTS = [(2.0, 2.2), (5.0, 1.0), (9.5, 1.5), (10.5, 5.0), (7.0, 6.5), (3.0, 6.8), (1.0, 5.0), (6.0, 3.8)]
WAY = [[1.0, 1.0], [8.0, 2.6], [9.0, 5.0], [4.5, 5.3], [2.2, 4.0], [1.2, 1.6], [8.0, 2.4]]
START = f"1,1,{math.atan2(1.6, 7.0)}"  # a drive to waypoints begins towards the second

ODOMETRY = [f"{0.1 * i:.1f} 0.2 {0.1 * math.sin(0.05 * i):.4f}" for i in range(200)]
MEASUREMENTS = [
    f"{0.5 * i + 0.05:.2f} {(25, 63)[i % 2]} {(2.0, 3.0)[i % 2]:.1f} {(0.4, -0.6)[i % 2]:.1f}" for i in range(6)
]
BARCODES = ["6 25", "7 63", "1 5"]


@cache
def recorded(scanner: bool = False) -> Log:
    """Return a drive's log, with detections or scans."""
    world = World("yard", (0.0, 0.0, 12.0, 8.0), tuple(Disc(centre, 0.15) for centre in POSTS))
    detector = None if scanner else Detector(RangeBearing(0.03, 0.01), 7.0, period=1.5)
    eyes = Scanner(beams=121, max_range=9.0, period=2.0) if scanner else None
    motion = Unicycle(0.01, 0.002, period=1.0)
    return simulate(world, WAY, motion, detector=detector, scanner=eyes, period=0.3, random_state=3).log


def write_mrclam(folder: Path) -> None:
    """Write the files of one robot that sees two landmarks."""
    folder.mkdir()
    for name, lines in (
        ("Robot1_Odometry.dat", ["# t v omega", *ODOMETRY]),
        ("Robot1_Measurement.dat", MEASUREMENTS),
        ("Barcodes.dat", BARCODES),
    ):
        (folder / name).write_text("\n".join(lines) + "\n")


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
