"""ROS bags that the test itself writes: both generations, stamps, transforms, and what is wrong with a bag."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from trailmark.errors import FormatError
from trailmark.estimation.readers import load_log
from trailmark.estimation.records import Increment, Pose, Scan

rosbags = pytest.importorskip("rosbags", reason="the extra trailmark[ros] is not installed")

from rosbags.rosbag1 import Writer as Writer1  # noqa: E402 # after the check that rosbags is there
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

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


def drive(bag: Bag) -> list[Message]:
    """Two metres ahead, a left turn on the spot, one metre ahead; three scans."""
    return [
        bag.odometry(10.0, (1.0, 2.0, 0.0)),
        bag.scan(10.0, [1.0, 2.0, 3.0, 4.0]),
        bag.odometry(11.0, (3.0, 2.0, 0.0)),
        bag.scan(11.5, [0.0, math.inf, math.nan, 20.0]),
        bag.odometry(12.0, (3.0, 2.0, math.pi / 2)),
        bag.odometry(13.0, (3.0, 3.0, math.pi / 2)),
        bag.scan(13.5, [0.05, -math.inf, 10.0, 0.5]),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_drive(tmp_path: Path, kind: Kind) -> None:
    bag = Bag(kind)
    log = load_log(bag.write(tmp_path, drive(bag)))
    assert log.name == "drive"
    assert [type(r) for r in log.records] == [Pose, Scan, Increment, Scan, Increment, Increment, Scan]
    assert [r.t for r in log.records] == [10.0, 10.0, 11.0, 11.5, 12.0, 13.0, 13.5]
    assert log.records[0] == Pose(10.0, 1.0, 2.0, 0.0, truth=False)
    increments = np.array([r[1:4] for r in log.records if isinstance(r, Increment)])
    assert np.abs(increments - [[2, 0, 0], [0, 0, np.pi / 2], [1, 0, 0]]).max() < 1e-12
    scans = [r for r in log.records if isinstance(r, Scan)]
    assert scans[0].ranges.tolist() == [1.0, 2.0, 3.0, 4.0]
    # Below range_min a reading is lost; infinite ones and those beyond range_max met nothing.
    assert str(scans[1].ranges.tolist()) == "[nan, inf, nan, 20.0]"
    assert str(scans[2].ranges.tolist()) == "[nan, nan, 10.0, 0.5]"
    assert (scans[0].angle_min, scans[0].angle_increment, scans[0].range_max) == (-1.0, 0.5, 10.0)
    assert scans[0].mount == (0.0, 0.0, 0.0)
    assert log.notes == (
        "no transform from 'base_footprint' to 'laser': the scanner is assumed to be at the robot's origin",
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["drive.db3", "drive.mcap"])
def test_a_file_of_a_ros_2_folder(tmp_path: Path, name: str) -> None:
    bag = Bag("sqlite3" if name.endswith("db3") else "mcap")
    folder = bag.write(tmp_path, drive(bag))
    assert len(load_log(folder / name).records) == 7


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_without_odometry_messages_poses_come_from_tf(tmp_path: Path, kind: Kind) -> None:
    bag = Bag(kind)
    mount = bag.transform("base_footprint", "laser", (0.2, 0.0, 0.1))
    moves = [(10.0, 1.0, 2.0, 0.0), (11.0, 3.0, 2.0, 0.0), (12.0, 3.0, 2.0, math.pi / 2), (13.0, 3.0, 3.0, math.pi / 2)]
    tf = [bag.transform("odom", "base_footprint", (x, y, 0.0), yaw=yaw, topic="/tf", t=t) for t, x, y, yaw in moves]
    map_ = [bag.transform("map", "odom", (t, 0.0, 0.0), topic="/tf", t=t) for t in (10.5, 12.5)]  # corrections
    scans = [message for message in drive(bag) if message[0] == "/scan"]
    messages = sorted([mount, *tf, *map_, *scans], key=lambda message: message[2])
    (tmp_path / "tf").mkdir()
    (tmp_path / "messages").mkdir()
    by_tf = load_log(bag.write(tmp_path / "tf", messages))
    by_messages = load_log(bag.write(tmp_path / "messages", [mount, *drive(bag)]))
    assert [type(r) for r in by_tf.records] == [type(r) for r in by_messages.records]
    for mine, theirs in zip(by_tf.records, by_messages.records, strict=True):
        if isinstance(mine, Scan):
            assert mine.mount == pytest.approx((0.2, 0.0, 0.0))
        else:
            assert tuple(mine)[:4] == pytest.approx(tuple(theirs)[:4])


def test_transforms_from_odom_to_two_frames_are_not_mixed(tmp_path: Path) -> None:
    bag = Bag("mcap")
    tf = [bag.transform("odom", "base_footprint", (t, 0.0, 0.0), topic="/tf", t=t) for t in (10.0, 11.0)]
    other = bag.transform("odom", "camera", (5.0, 0.0, 0.0), topic="/tf", t=10.5)
    messages = [tf[0], other, tf[1], bag.scan(11.0, [1.0])]
    with pytest.raises(FormatError, match="from odom: expected to one frame, got 'base_footprint', 'camera'"):
        load_log(bag.write(tmp_path, messages))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("topic", ["/tf", "/tf_static"])
def test_the_mount_comes_from_the_transforms(tmp_path: Path, kind: Kind, topic: str) -> None:
    bag = Bag(kind)
    chain = [
        bag.transform("base_footprint", "base_link", (0.1, 0.0, 0.05), topic=topic),
        bag.transform("odom", "base_footprint", (5.0, 5.0, 0.0), yaw=1.0, topic="/tf"),
        bag.transform("base_link", "mast", (0.0, 0.2, 0.3), yaw=math.pi / 2, topic=topic),
        bag.transform("/mast", "/laser", (0.4, 0.0, 0.0), yaw=-0.25, topic=topic),
    ]
    log = load_log(bag.write(tmp_path, chain + drive(bag)))
    scan = next(r for r in log.records if isinstance(r, Scan))
    # The mast looks to the left: its 0.4 m ahead are 0.4 m to the left of the robot.
    assert np.abs(np.array(scan.mount) - (0.1, 0.6, math.pi / 2 - 0.25)).max() < 1e-12
    assert (scan.angle_min, scan.angle_increment) == (-1.0, 0.5)
    assert log.notes == ()


@pytest.mark.slow
def test_upside_down_and_tilted_scanners(tmp_path: Path) -> None:
    bag = Bag("sqlite3")
    messages = [bag.transform("base_footprint", "laser", (0.3, 0.0, 0.2), roll=math.pi, yaw=0.5), *drive(bag)]
    log = load_log(bag.write(tmp_path, messages))
    scan = next(r for r in log.records if isinstance(r, Scan))
    assert np.abs(np.array(scan.mount) - (0.3, 0.0, 0.5)).max() < 1e-12
    assert (scan.angle_min, scan.angle_increment) == (1.0, -0.5)
    bag = Bag("mcap")
    (tmp_path / "b").mkdir()
    messages = [bag.transform("base_footprint", "laser", (0.3, 0.0, 0.2), roll=math.radians(20.0)), *drive(bag)]
    log = load_log(bag.write(tmp_path / "b", messages))
    assert log.notes == ("the scanner 'laser' is tilted by 20 degrees and assumed to be level",)


def test_a_stamp_of_zero_is_the_time_of_receipt(tmp_path: Path) -> None:
    bag = Bag("ros1")
    messages = [
        bag.scan(10.5, [1.0]),
        bag.odometry(10.0, (0, 0, 0), stamp=0.0),
        bag.odometry(11.0, (1, 0, 0), stamp=0.0),
    ]
    log = load_log(bag.write(tmp_path, messages))
    assert [(type(r), r.t) for r in log.records] == [(Pose, 10.0), (Scan, 10.5), (Increment, 11.0)]


def test_stamps_that_repeat(tmp_path: Path) -> None:
    bag = Bag("ros1")
    good = [bag.odometry(10.0, (0, 0, 0)), bag.scan(10.0, [1.0]), bag.odometry(11.0, (1, 0, 0))]
    again = [bag.odometry(10.2, (0.2, 0, 0), stamp=10.0), replaced(bag.scan(10.0, [2.0]), 10.2)]
    for i, message in enumerate(again):
        (tmp_path / str(i)).mkdir()
        with pytest.raises(FormatError, match=r"message 2 of /\w+: stamp: expected one of its own, got 10 s"):
            load_log(bag.write(tmp_path / str(i), [*good, message]))
    log = load_log(bag.write(tmp_path, [*good, *again, replaced(good[1], 10.3)]), skip_bad=True)
    assert log.dropped == 2
    # What is written twice is no contradiction.
    assert [type(r) for r in log.records] == [Pose, Scan, Scan, Increment]


def replaced(message: Message, received: float) -> Message:
    """The message, received at another time than it is stamped with."""
    topic, name, _, data = message
    return topic, name, received, data


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_topics(tmp_path: Path, kind: Kind) -> None:
    bag = Bag(kind)
    messages = [
        bag.odometry(1.0, (0, 0, 0), "/wheels"),
        bag.odometry(1.0, (9, 9, 9), "/visual"),
        bag.scan(2.0, [1.0], "/front"),
        bag.scan(2.0, [2.0], "/rear"),
    ]
    path = bag.write(tmp_path, messages)
    log = load_log(path, scan_topic="/rear", odometry_topic="/wheels")
    assert log.records[0] == Pose(1.0, 0.0, 0.0, 0.0)
    assert isinstance(log.records[1], Scan)
    assert log.records[1].ranges.tolist() == [2.0]
    with pytest.raises(
        FormatError, match=r"2 topics of type sensor_msgs/LaserScan: say which scan topic: /front, /rear"
    ):
        load_log(path, odometry_topic="/wheels")
    with pytest.raises(
        FormatError, match=r"2 topics of type nav_msgs/Odometry: say which odometry topic: /visual, /whe"
    ):
        load_log(path, scan_topic="/rear")
    with pytest.raises(FormatError, match=r"got '/reat'"):
        load_log(path, scan_topic="/reat", odometry_topic="/wheels")


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_without_the_topics(tmp_path: Path, kind: Kind) -> None:
    bag = Bag(kind)
    path = bag.write(tmp_path, [bag.odometry(1.0, (0, 0, 0))])
    with pytest.raises(
        FormatError, match=r"no topic of type sensor_msgs/LaserScan in the bag; it has: /odom \(nav_msgs/O"
    ):
        load_log(path)
    (tmp_path / "b").mkdir()
    path = bag.write(tmp_path / "b", [bag.scan(1.0, [1.0])])
    with pytest.raises(
        FormatError, match=r"no topic of type nav_msgs/Odometry in the bag; it has: /scan \(sensor_msgs/L"
    ):
        load_log(path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_bad_messages(tmp_path: Path, kind: Kind) -> None:
    bag = Bag(kind)
    good = [bag.odometry(10.0, (0, 0, 0)), bag.odometry(11.0, (1, 0, 0)), bag.scan(12.0, [1.0])]
    cases = [
        (bag.odometry(12.0, (math.nan, 0, 0)), "message 3 of /odom: expected a pose of finite numbers with a heading"),
        (bag.odometry(12.0, (0, 0, 0), stamp=10.5), "message 3 of /odom: time: expected 11.0 or later, got 10.5"),
        (bag.scan(13.0, []), "message 2 of /scan: expected one range or more, got none"),
        (bag.scan(13.0, [1.0], angle_increment=math.inf), "angles: expected finite numbers, got -1.0, inf"),
        (bag.scan(13.0, [1.0], range_max=0.0), "message 2 of /scan: range_max: expected above 0, got 0.0"),
    ]
    # What a message says is looked at after it was read: one of each type is enough for the other kinds.
    for i, (message, problem) in enumerate(cases if kind == "ros1" else cases[1:3]):
        (tmp_path / str(i)).mkdir()
        path = bag.write(tmp_path / str(i), [*good, message])
        with pytest.raises(FormatError) as caught:
            load_log(path)
        assert problem in str(caught.value)
        assert "\n" not in str(caught.value)
    log = load_log(bag.write(tmp_path, [*good, *(message for message, _ in cases)]), skip_bad=True)
    assert log.dropped == len(cases)
    assert [type(r) for r in log.records] == [Pose, Increment, Scan]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.9])
def test_truncated_bags(tmp_path: Path, kind: Kind, share: float) -> None:
    bag = Bag(kind)
    path = bag.write(tmp_path, drive(bag))
    file = path if kind == "ros1" else next(f for f in path.iterdir() if f.suffix != ".yaml")
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(FormatError, match="cannot be read as a ROS bag") as caught:
        load_log(path)
    assert "\n" not in str(caught.value)


def test_without_rosbags(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = Bag("ros1")
    path = bag.write(tmp_path, drive(bag))
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(
        FormatError, match=r"drive.bag: a ROS bag needs the package rosbags: pip install 'rosbags>=0.11'"
    ):
        load_log(path)
