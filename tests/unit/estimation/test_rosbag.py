"""ROS bags that the test itself writes: both generations, stamps, transforms, and what is wrong with a bag."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.helpers.bags import KINDS, Bag, Kind, Message

from trailmark.errors import FormatError
from trailmark.estimation.readers import load_log
from trailmark.estimation.records import Increment, Pose, Scan


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
    with pytest.raises(FormatError, match="cannot be read as a ROS bag"):
        load_log(path)


def test_without_rosbags(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = Bag("ros1")
    path = bag.write(tmp_path, drive(bag))
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(
        FormatError, match=r"drive.bag: a ROS bag needs the package rosbags: pip install 'rosbags>=0.11'"
    ):
        load_log(path)
