"""Sensor logs: readers that convert other programs' files to records, and a format of trailmark's own.

A log's format is found by its content. Only what a file needs is imported for it.
"""

from __future__ import annotations

import re
from contextlib import suppress
from importlib import import_module
from pathlib import Path as FilePath
from typing import Any

from trailmark.arguments import checked_arguments
from trailmark.errors import FormatError, OutputError, expected_name
from trailmark.estimation.errors import EstimationError, RecordError
from trailmark.estimation.records import Log, with_own_times

__all__ = ["FORMATS", "load_log", "log_files", "save_log"]

FORMATS = ("jsonl", "mrclam", "carmen", "victoria", "g2o", "rosbag")
"""trailmark's own JSON Lines; an MRCLAM folder; a CARMEN log; GTSAM's Victoria Park file; a g2o graph; a ROS 1 or ROS 2
bag."""

_ALLOWED = (
    'expected trailmark JSON Lines (first line {"trailmark_log": 1}), an MRCLAM folder (RobotN_Odometry.dat) as '
    "FOLDER:N or one of robot N's files, a CARMEN log (ODOM, FLASER), victoria_park.txt (ODOMETRY, LANDMARK), "
    "a g2o graph (VERTEX_SE2, EDGE_SE2), a ROS bag"
)

_BAG_STARTS = (b"#ROSBAG V", b"SQLite format 3\0", b"\x89MCAP0\r\n")

_PARTS = {".dat", ".db3", ".mcap", ".zstd", ".bag"}
"""Endings of the files in a folder that is a log, beside a bag's ``metadata.yaml``."""

_HEAD = 2**16
"""Bytes from a file's beginning in which a line must identify its format."""


@checked_arguments(EstimationError)
def load_log(
    path: str | FilePath,
    format: str | None = None,  # noqa: A002 # the option's name in the shell
    skip_bad: bool = False,
    *,
    robot: int | None = None,
    corrected: bool | None = None,
    scan_topic: str | None = None,
    odometry_topic: str | None = None,
) -> Log:
    """Read a sensor log.

    Text logs may be gzipped. The readers' modules describe their formats. Records whose stamps repeat because the clock
    is coarse get times of their own, in the order of the file (see
    :func:`trailmark.estimation.records.with_own_times`).

    Args:
        path: the file, or the folder of an MRCLAM log or a ROS 2 bag. The robot of an MRCLAM folder is selected
            by ``robot``, by ``FOLDER:N``, or by naming one of its files, such as ``FOLDER/Robot3_Odometry.dat``.
        format: one of FORMATS; found by the content if left out.
        skip_bad: leave out bad records and count them in ``Log.dropped``, in place of raising for the first.
        robot: the number of an MRCLAM robot.
        corrected: whether a CARMEN log's scans have poses that a SLAM program corrected; found from the content by
            default (see :mod:`trailmark.estimation.readers.carmen`).
        scan_topic: the topic of a bag's laser scans; may be left out where the bag has one.
        odometry_topic: the topic of a bag's odometry; may be left out where the bag has one.

    Raises:
        FormatError: the file is missing, of no known format, breaks its format's rules, or holds no records; the
            message has file and line.
    """
    from trailmark.estimation.readers.source import BadRecords

    bad = BadRecords(skip_bad)
    file = FilePath(path)
    if format is not None and format not in FORMATS:
        raise FormatError(file, f"format: {expected_name(format, FORMATS)}")
    try:
        file.exists()
    except OSError as error:  # no file can have that name, or its folder may not be read
        raise FormatError(file, f"cannot be read: {error.strerror}") from None
    if format in (None, "mrclam"):
        file, robot = _robot(file, robot)
    kind = _format_of(file) if format is None else format
    options: dict[str, tuple[Any, ...]] = {
        "mrclam": (robot,),
        "carmen": (corrected,),
        "rosbag": (scan_topic, odometry_topic),
    }
    reader = import_module(f"trailmark.estimation.readers.{kind}")
    log: Log = getattr(reader, f"read_{kind}")(file, bad, *options.get(kind, ()))
    if not log.records:
        left_out = f" ({bad.dropped} bad ones left out)" if bad.dropped else ""
        raise FormatError(file, f"expected a log of one record or more, got none{left_out}")
    try:
        return with_own_times(log)._replace(dropped=bad.dropped)
    except RecordError as error:
        raise FormatError(file, str(error)) from None


@checked_arguments(EstimationError)
def save_log(log: Log, path: str | FilePath) -> None:
    """Write a log as trailmark JSON Lines (:mod:`trailmark.estimation.readers.jsonl`), whole or not at all.

    Loading the file gives the same records: every number is written with all its digits.

    Raises:
        OutputError: the path cannot be written, holds a log of another format, or a record is none that could be read
            back.
    """
    from trailmark.estimation.readers.jsonl import write_jsonl

    file = FilePath(path)
    if file.is_file():
        with suppress(FormatError):  # no log at all
            kind = _format_of(file)
            if kind != "jsonl":
                raise OutputError(
                    f"{file}: expected a new file or JSON Lines, got an existing log of the format {kind}"
                )
    write_jsonl(file, log)


def log_files(path: str | FilePath) -> tuple[FilePath, ...]:
    """Return the files that a log given as for :func:`load_log` is read from, as far as they are there."""
    file, _ = _robot(FilePath(path), None)
    if not file.is_dir():
        return (file,)
    return tuple(part for part in sorted(file.iterdir()) if part.suffix in _PARTS or part.name == "metadata.yaml")


def _robot(path: FilePath, robot: int | None) -> tuple[FilePath, int | None]:
    """Return the folder and the number where the path means an MRCLAM robot, else what was given."""
    from trailmark.estimation.readers.mrclam import robot_of

    named = re.fullmatch(r"(.+):(\d+)", str(path))
    if named and not path.exists() and FilePath(named[1]).is_dir():
        if robot not in (None, int(named[2])):
            raise FormatError(path, f"robot: expected {named[2]}, which the name says, or none, got {robot}")
        return FilePath(named[1]), int(named[2])
    own = robot_of(path)
    if own is not None and path.is_file():
        return path.parent, own if robot is None else robot
    return path, robot


def _format_of(path: FilePath) -> str:
    """Return the format of a file or folder."""
    from trailmark.estimation.readers import carmen, g2o, mrclam, victoria
    from trailmark.estimation.readers.source import read_head

    if path.is_dir():
        if (path / "metadata.yaml").exists():
            return "rosbag"
        if mrclam.robots(path):
            return "mrclam"
        raise FormatError(path, f"a folder that holds no log; {_ALLOWED}")
    head = read_head(path, _HEAD)
    if head.startswith(_BAG_STARTS):
        return "rosbag"
    text = head.decode("utf-8-sig", errors="replace")
    if not text.strip():
        raise FormatError(path, f"an empty log; {_ALLOWED}")
    for line in text.split("\n"):
        word = line.split(maxsplit=1)[0] if line.strip() else ""
        if word.startswith("{"):
            return "jsonl"
        if word in victoria.KEYWORDS:
            return "victoria"
        if word in g2o.KEYWORDS or word in ("VERTEX_XY", "FIX"):
            return "g2o"
        if word in carmen.KEYWORDS or line.startswith("# message formats defined:"):
            return "carmen"
    raise FormatError(path, f"no log of a known format; {_ALLOWED}")
