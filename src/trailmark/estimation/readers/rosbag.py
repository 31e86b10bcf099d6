"""ROS 1 and ROS 2 bags, read by the package rosbags (the extra ``trailmark[ros]``); no ROS is needed.

From a bag come one topic of ``sensor_msgs/LaserScan`` and one of ``nav_msgs/Odometry`` or, if it has none of that type,
the transforms of ``tf`` from a frame named ``odom`` to the robot's:

- An odometry message's pose gives the increment since the message before; its covariance, which is that of the whole
  drive, says nothing about one increment and is not used. The first message gives the pose where the odometry begins.
- A scan's readings below its ``range_min``, among them the zeros and −inf of some drivers, are lost readings (NaN).
- The scanner's place on the robot comes from the bag's transforms (``tf_static``, else the first ones of ``tf``)
  between the scan's frame and the odometry's child frame. A scanner that hangs upside down turns clockwise, so its
  angles change their sign. Without such transforms it is assumed to be at the robot's origin, with a note.

A record's time is the message's stamp, or when the bag received it if all stamps of its topic are 0. Stamps of one
topic must not go back, nor repeat with another content, for the order of the two topics' messages at one stamp would
be unknown; they are merged by time, the odometry first at equal times.
"""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trailmark.errors import FormatError, TrailmarkError, expected_name
from trailmark.estimation.readers.source import BadRecords, name_of
from trailmark.estimation.records import Increment, Log, Pose, Record, Scan
from trailmark.se2 import FloatArray

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

__all__ = ["read_rosbag"]

_SCAN, _ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_REPEATED = "stamp: expected one of its own, got {:.9g} s once more with another content"
_ENOUGH_TRANSFORMS = 2000  # Messages of ``tf`` that are searched for the scanner's place.


class _Message(NamedTuple):
    name: str
    t: float
    data: Any


class _Moved(NamedTuple):
    name: str
    t: float
    pose: tuple[float, float, float] | None
    frame: str


def read_rosbag(path: Path, bad: BadRecords, scan_topic: str | None = None, odometry_topic: str | None = None) -> Log:
    """Return a bag's laser scans and odometry.

    Args:
        path: a ROS 1 file ``.bag``, a ROS 2 folder, or one of its files ``.db3`` or ``.mcap``.
        bad: what becomes of bad messages: not to be decoded, values that are not finite, stamps that go back or repeat.
        scan_topic: may be left out where the bag has one such topic.
        odometry_topic: may be left out where the bag has one such topic, or transforms from ``odom``.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise FormatError(path, "a ROS bag needs the package rosbags: pip install 'rosbags>=0.11'") from None
    try:
        # Bags of ROS 2 before Iron do not hold their messages' definitions.
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            return _log(path, reader, bad, scan_topic, odometry_topic)
    except TrailmarkError:
        raise
    except Exception as error:  # what a broken bag makes the decoders raise is not documented
        raise FormatError(path, f"cannot be read as a ROS bag: {_brief(error)}") from None


def _brief(error: Exception) -> str:
    """Return another package's message on one line, and cut where it is long."""
    return textwrap.shorten(str(error), 200, placeholder=" ...") or type(error).__name__


def _log(path: Path, reader: AnyReader, bad: BadRecords, scan_topic: str | None, odometry_topic: str | None) -> Log:
    scans = _topic(path, reader, _SCAN, "scan", scan_topic)
    moved = _moved_by_tf(path, reader, bad) if odometry_topic is None else None
    if moved is None:
        moved = _moved(path, reader, _topic(path, reader, _ODOMETRY, "odometry", odometry_topic), bad)
    records: list[Record] = []
    frame = "base_link"
    before: tuple[float, float, float] | None = None
    latest = -math.inf
    for name, t, pose, child in moved:
        if pose is None:
            bad.report(path, f"{name}: expected a pose of finite numbers with a heading, got another")
            continue
        if t == latest and pose != before:
            bad.report(path, f"{name}: {_REPEATED.format(t)}")
            continue
        frame = child or frame
        records.append(Pose(t, *pose) if before is None else Increment.between(t, before, pose))
        before, latest = pose, t
    moves = len(records)
    mounts: dict[str, tuple[tuple[float, float, float], bool]] = {}
    notes: list[str] = []
    for name, t, message in _messages(path, reader, scans, bad):
        problem = _bad_geometry(message)
        if problem:
            bad.report(path, f"{name}: {problem}")
            continue
        own = message.header.frame_id
        if own not in mounts:
            mounts[own], note = _mount(reader, frame, own)
            notes += [note] if note else []
        scan = _scan(t, message, *mounts[own])
        last = records[-1] if len(records) > moves else None
        if isinstance(last, Scan) and t == last.t and not np.array_equal(scan.ranges, last.ranges, equal_nan=True):
            bad.report(path, f"{name}: {_REPEATED.format(t)}")
            continue
        records.append(scan)
    order = np.argsort([record.t for record in records], kind="stable")
    return Log(name_of(path), tuple(records[i] for i in order), np.empty((0, 3)), notes=tuple(notes), whole=True)


def _topic(path: Path, reader: AnyReader, msgtype: str, what: str, name: str | None) -> list[Connection]:
    """Return the connections of the topic of a type: the named one, or the only one."""
    topics = sorted({c.topic for c in reader.connections if c.msgtype == msgtype})
    if name is None and len(topics) == 1:
        name = topics[0]
    if name in topics:
        return [c for c in reader.connections if c.topic == name and c.msgtype == msgtype]
    kind = msgtype.replace("/msg/", "/")
    if name is not None:
        raise FormatError(path, f"{what} topic of type {kind}: {expected_name(name, topics)}")
    if topics:
        raise FormatError(path, f"{len(topics)} topics of type {kind}: say which {what} topic: {', '.join(topics)}")
    there = ", ".join(sorted({f"{c.topic} ({c.msgtype.replace('/msg/', '/')})" for c in reader.connections}))
    raise FormatError(path, f"no topic of type {kind} in the bag; it has: {there or 'none'}")


def _moved(path: Path, reader: AnyReader, odometry: list[Connection], bad: BadRecords) -> Iterator[_Moved]:
    for name, t, message in _messages(path, reader, odometry, bad):
        yield _Moved(name, t, _pose(message.pose.pose.position, message.pose.pose.orientation), message.child_frame_id)


def _moved_by_tf(path: Path, reader: AnyReader, bad: BadRecords) -> Iterator[_Moved] | None:
    """Return the poses by the transforms from ``odom``; None if there are odometry messages, or no such transforms."""
    wanted = [c for c in reader.connections if c.msgtype in _TRANSFORMS and not c.topic.endswith("tf_static")]
    if not wanted or any(c.msgtype == _ODOMETRY for c in reader.connections):
        return None

    def poses() -> Iterator[_Moved]:
        latest, frame = -math.inf, ""
        for number, (received, message) in enumerate(_decoded(reader, wanted), start=1):
            name = f"message {number} of {wanted[0].topic}"
            if isinstance(message, Exception):
                bad.report(path, f"{name}: cannot be decoded: {_brief(message)}")
                continue
            for entry in message.transforms:
                if entry.header.frame_id.rpartition("/")[2] != "odom":
                    continue
                child = entry.child_frame_id
                if child != (frame := frame or child):
                    raise FormatError(path, f"transforms from odom: expected to one frame, got {frame!r}, {child!r}")
                stamp = entry.header.stamp
                t = stamp.sec + 1e-9 * stamp.nanosec if any((stamp.sec, stamp.nanosec)) else 1e-9 * received
                if t < latest:
                    bad.report_late(path, t, latest, name=f"{name}: ")
                    continue
                latest = t
                place = entry.transform
                yield _Moved(name, t, _pose(place.translation, place.rotation), child.lstrip("/"))

    found = poses()
    first = next(found, None)
    return None if first is None else itertools.chain([first], found)


def _messages(path: Path, reader: AnyReader, connections: list[Connection], bad: BadRecords) -> Iterator[_Message]:
    """Yield the messages of a topic with their names for messages, in the order of their stamps."""
    latest = -math.inf
    unstamped = not any(
        any(_stamp(data)) for _, data in _decoded(reader, connections) if not isinstance(data, Exception)
    )
    for number, (received, data) in enumerate(_decoded(reader, connections), start=1):
        name = f"message {number} of {connections[0].topic}"
        if isinstance(data, Exception):
            bad.report(path, f"{name}: cannot be decoded: {_brief(data)}")
            continue
        seconds, nanoseconds = _stamp(data)
        t = 1e-9 * received if unstamped else seconds + 1e-9 * nanoseconds
        if t < latest:
            bad.report_late(path, t, latest, name=f"{name}: ")
            continue
        latest = t
        yield _Message(name, t, data)


def _decoded(reader: AnyReader, connections: list[Connection]) -> Iterator[tuple[int, Any]]:
    """Yield when each message was received, nanoseconds, and the message, or why it cannot be decoded."""
    for connection, received, raw in reader.messages(connections):
        try:
            yield received, reader.deserialize(raw, connection.msgtype)
        except Exception as error:  # what a broken message makes the decoders raise is not documented
            yield received, error


def _stamp(message: Any) -> tuple[int, int]:
    return message.header.stamp.sec, message.header.stamp.nanosec


def _pose(position: Any, q: Any) -> tuple[float, float, float] | None:
    """Return x, y, theta, or None if they are not finite."""
    sin, cos = 2.0 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2
    values = (position.x, position.y, sin, cos)
    if not all(map(math.isfinite, values)) or sin == cos == 0.0:
        return None
    return position.x, position.y, math.atan2(sin, cos)


def _bad_geometry(message: Any) -> str:
    """Return what is wrong with a scan's fields, or nothing."""
    if len(message.ranges) == 0:
        return "expected one range or more, got none"
    if not all(map(math.isfinite, (message.angle_min, message.angle_increment))):
        return f"angles: expected finite numbers, got {message.angle_min}, {message.angle_increment}"
    if not message.range_max > 0.0:
        return f"range_max: expected above 0, got {message.range_max}"
    return ""


def _scan(t: float, message: Any, mount: tuple[float, float, float], upside_down: bool) -> Scan:
    ranges = np.array(message.ranges, dtype=np.float64)
    ranges[ranges < max(message.range_min, 0.0)] = np.nan
    sign = -1.0 if upside_down else 1.0
    geometry = (sign * float(message.angle_min), sign * float(message.angle_increment), float(message.range_max))
    return Scan(t, ranges, *geometry, mount)


def _mount(reader: AnyReader, base: str, scanner: str) -> tuple[tuple[tuple[float, float, float], bool], str]:
    """Return the scanner's place on the robot, whether it hangs upside down, and a note where it is not known."""
    places: dict[str, tuple[str, FloatArray]] = {}  # of each frame its parent and its place in that; the first ones
    found = _between(places, base, scanner)
    for static in (True, False):
        wanted = [c for c in reader.connections if c.msgtype in _TRANSFORMS and c.topic.endswith("tf_static") == static]
        for connection, _, raw in itertools.islice(
            reader.messages(wanted) if wanted else (), None if static else _ENOUGH_TRANSFORMS
        ):
            if found is not None:
                break
            message: Any = reader.deserialize(raw, connection.msgtype)
            for entry in message.transforms:
                # Slashes before the names are dropped, as tf2 drops them.
                child, parent = entry.child_frame_id.lstrip("/"), entry.header.frame_id.lstrip("/")
                places.setdefault(child, (parent, _matrix(entry.transform)))
            found = _between(places, base, scanner)
    if found is None:
        note = f"no transform from {base!r} to {scanner!r}: the scanner is assumed to be at the robot's origin"
        return ((0.0, 0.0, 0.0), False), note
    mount = (float(found[0, 3]), float(found[1, 3]), math.atan2(found[1, 0], found[0, 0]))
    tilt = math.degrees(math.acos(min(1.0, abs(found[2, 2]))))
    note = f"the scanner {scanner!r} is tilted by {tilt:.0f} degrees and assumed to be level" if tilt > 5.0 else ""
    return (mount, bool(found[2, 2] < 0.0)), note


def _between(places: dict[str, tuple[str, FloatArray]], base: str, frame: str) -> FloatArray | None:
    """Return the frame's place in the base, shape (4, 4), or None if nothing known joins them."""
    above_base, above_frame = _ancestors(places, base.lstrip("/")), _ancestors(places, frame.lstrip("/"))
    common = next((name for name in above_frame if name in above_base), None)
    return None if common is None else np.asarray(np.linalg.inv(above_base[common]) @ above_frame[common])


def _ancestors(places: dict[str, tuple[str, FloatArray]], name: str) -> dict[str, FloatArray]:
    """Return a frame and all above it, nearest first, with the frame's place in each."""
    found = {name: np.eye(4)}
    while name in places and places[name][0] not in found:  # frames that are each other's parents are no tree
        parent, place = places[name]
        found[parent] = place @ found[name]
        name = parent
    return found


def _matrix(transform: Any) -> FloatArray:
    """Return a rigid transform, shape (4, 4), from a shift (metres) and a quaternion of any length but 0."""
    from scipy.spatial.transform import Rotation

    shift, q = transform.translation, transform.rotation
    quaternion, place = (q.x, q.y, q.z, q.w), np.eye(4)
    place[:3, :3] = Rotation.from_quat(quaternion).as_matrix() if any(quaternion) else np.eye(3)
    place[:3, 3] = shift.x, shift.y, shift.z
    return place
