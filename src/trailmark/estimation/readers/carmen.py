"""CARMEN logs: odometry and laser scans, raw or with the poses that a SLAM program corrected.

Lines that are read (all poses are x, y, theta: metres and radians; each line ends with time, host, logger time):

- ``ODOM x y theta tv rv accel``: the robot by its odometry;
- ``FLASER n r1..rn x y theta ox oy otheta``: n ranges from right to left, the laser's pose, the robot's by odometry;
- ``ROBOTLASER1 type start fov step max accuracy mode n r1..rn m e1..em`` and both poses as above, then five numbers
  of the robot's own: the newer form of the same, which states its beams;
- ``TRUEPOS x y theta ox oy otheta``: CARMEN's simulator.

Other messages that CARMEN knows, or that the log's own line ``# message formats defined:`` names, are left out.

**Beams.** FLASER does not state its angles. CARMEN takes an even n for a scanner of n + 1 beams over half a turn whose
last beam was cut off: the first beam looks to −π/2, and the step is π/n (n even) or π/(n − 1) (n odd). The scans of the
Intel and ACES logs fall together best with these angles. Scanners of 400 and 401 beams see 100 degrees.

**Nothing met.** FLASER states no largest range, so ``range_max`` is the largest reading in the log, or 81.83 m (8.183
m) where it holds SICK's codes of faults above that, up to 81.91 m (8.191 m). A few readings, at most one in
GLITCH_SHARE, more than twice as far as all others are glitches: lost (NaN), with a note.

**Corrected poses.** A log is corrected if GMapping wrote it (it has lines ``NEFF``), or if laser and odometry do not
keep their distance; other corrected logs cannot be told from raw ones without the argument ``corrected``. Then the
scans have poses. GMapping repeats each scan's pose in an ``ODOM`` right after it, whose time is not to be trusted, and
goes on with the odometry from there. That jump is no motion: the increments leave it out. In raw logs scans have no
pose, and the laser's place in the robot's frame is their ``mount``.

**Times** are those of the hosts' messages, or the logger's where those of the messages are rounded so that most are
equal. The lines' order is the order of the motion: a time up to JITTER behind the latest one is raised to it, with a
note; one farther behind is bad.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trailmark.estimation.readers.source import BadRecords, name_of, numbers, read_lines
from trailmark.estimation.records import Increment, Log, Pose, Record, Scan
from trailmark.se2 import FloatArray, between, difference

__all__ = ["JITTER", "KEYWORDS", "read_carmen"]

JITTER = 2.0  # Seconds that a time may lie behind the latest one (the Intel log: up to 0.9).
KEYWORDS = ("ODOM", "FLASER", "ROBOTLASER1", "TRUEPOS")  # The first words of the lines that are read.
_OTHERS = re.compile(
    r"#.*|PARAM|SYNC|NEFF|RLASER|LASER\d|RAWLASER\d|ROBOTLASER[2-9]|REMISSIONFLASER|REMISSIONRLASER|MARKER|GYRO\d?"
    r"|GPS|NMEA\w+|SONAR|BUMPER|SCANMARK|POSITIONLASER|IMU|VECTORMOVE|ROBOTVELOCITY|BASEVELOCITY|FOLLOWTRAJECTORY"
    r"|ARM|TICK|RFID\w*|WIFI\w*"
)

_MOUNTED = 0.01  # Metres and radians: laser and odometry closer together than this keep their distance.
# Metres: the reading for nothing met, and what bounds the codes above it.
_SICK_NOTHING = ((81.83, 82.0), (8.183, 8.2))
GLITCH_SHARE = 10_000  # Readings of which one may be a glitch, far beyond all others.

_Triple = tuple[float, float, float]


class _Beams(NamedTuple):
    ranges: FloatArray
    angle_min: float
    angle_increment: float
    range_max: float | None
    laser: _Triple


class _Line(NamedTuple):
    number: int
    word: str
    t: float
    pose: _Triple
    beams: _Beams | None = None
    logged: float = 0.0


def read_carmen(path: Path, bad: BadRecords, corrected: bool | None = None) -> Log:
    """Return the log's increments of odometry, scans and (of a simulator) truth, in the order of the lines.

    The first record is the pose at which the odometry begins. ``corrected`` says whether the poses of the scans are
    those of a SLAM program, which is found from the content by default.
    """
    lines, gmapping = _lines(path, bad, corrected=bool(corrected))
    mount = None if gmapping else _mount([(line.beams.laser, line.pose) for line in lines if line.beams])
    if corrected is None:
        corrected = gmapping or mount is None
    unlimited = [line.beams.ranges for line in lines if line.beams and line.beams.range_max is None]
    glitches, farthest_glitch = _remove_glitches(unlimited)
    range_max = _range_max(unlimited)
    records: list[Record] = []
    if 2 * len({line.t for line in lines}) < len({line.logged for line in lines}):
        lines = [line._replace(t=line.logged) for line in lines]
    base: _Triple | None = None
    latest, raised, farthest = -math.inf, 0, 0.0
    for number, word, time, pose, beams, _ in lines:
        behind = latest - time
        if behind > JITTER:
            back = f"time: expected at most {JITTER:g} s before {latest!r}, got {time!r}"
            bad.report(path, back, number)
            continue
        raised, farthest = raised + (behind > 0.0), max(farthest, behind)
        latest = t = max(latest, time)
        if word == "TRUEPOS":
            records.append(Pose(t, *pose, truth=True))
            continue
        if base is None:
            records.append(Pose(t, *pose))
        elif not (gmapping and beams):
            records.append(Increment.between(t, base, pose))
        base = pose
        if beams:
            # Where laser and odometry keep their distance, their poses are corrected together.
            where = None if not corrected else beams.laser if mount is None else pose
            geometry = (beams.angle_min, beams.angle_increment, beams.range_max or range_max)
            records.append(Scan(t, beams.ranges, *geometry, mount or (0.0, 0.0, 0.0), where))
    notes = [f"{raised} times up to {farthest:.3g} s behind the latest one raised to it"] if raised else []
    if glitches:
        others = "reading" if glitches == 1 else "readings"
        notes.append(f"{glitches} {others} up to {farthest_glitch:g} m, far beyond all others, left out as glitches")
    return Log(name_of(path), tuple(records), np.empty((0, 3)), notes=tuple(notes), whole=True)


def _lines(path: Path, bad: BadRecords, *, corrected: bool) -> tuple[list[_Line], bool]:
    """Return the lines that hold records, without GMapping's repeated poses, and whether GMapping wrote the log."""
    lines = list(_parsed(path, bad))
    gmapping = any(line.word == "NEFF" for line in lines)
    pairs = list(zip([None, *lines], lines, strict=False))
    repeats = [
        before is not None and line.word == "ODOM" and before.beams is not None and line.pose == before.beams.laser
        for before, line in pairs
    ]
    if corrected and not gmapping:
        late = (before is not None and line.t < before.t - JITTER for before, line in pairs)
        gmapping = any(map(all, zip(repeats, late, strict=True)))
    kept = (not (gmapping and repeat) for repeat in repeats)
    return [line for line, keep in zip(lines, kept, strict=True) if keep and line.word != "NEFF"], gmapping


def _parsed(path: Path, bad: BadRecords) -> Iterator[_Line]:
    declared: set[str] = set()
    for number, text in enumerate(read_lines(path, bad), start=1):
        fields = text.split()
        word = fields[0] if fields else "#"
        if word in KEYWORDS:
            line = _line(number, fields)
            if isinstance(line, str):
                bad.report(path, line, number)
            else:
                yield line
        elif word == "NEFF":
            yield _Line(number, word, 0.0, (0.0, 0.0, 0.0))
        elif text.startswith("# message formats defined:"):
            declared.update(fields[4:])
        elif word not in declared and not _OTHERS.fullmatch(word):
            bad.report(
                path, f"expected a line with {', '.join(KEYWORDS)} or the like, got {text.strip()[:60]!r}", number
            )


def _line(number: int, fields: list[str]) -> _Line | str:
    """Return a line's values, or what is wrong with it."""
    word, count = fields[0], len(fields) - 1
    n = m = 0
    if word == "FLASER":
        n = _count(fields, 1)
        columns, rule = n + 10, f"n + 10 (n = {fields[1] if count else 'none'} ranges)"
    elif word == "ROBOTLASER1":
        n = _count(fields, 8)
        m = _count(fields, 9 + n, minimum=0)
        columns, rule = n + m + 23, "n + m + 23 (n ranges and m remissions)"
    else:
        columns, rule = 9, "9"
    if count != columns or n < 0 or m < 0:
        return f"{word}: expected {rule} columns after it, got {count}"
    # A time, the host and the logger's time end each line; the host is no number.
    row = numbers([*fields[1:-2], fields[-1]])
    if row is None:
        return f"expected {word}, finite numbers, host, time, got {' '.join(fields)[:60]!r}"
    t = row[-2]
    if word in ("ODOM", "TRUEPOS"):
        return _Line(number, word, t, _triple(row[:3]), None, row[-1])
    if word == "FLASER":
        start, (step, first), range_max = 1, _angles(n), None
    else:
        start, first, step, range_max = 8, row[1], row[3], row[4]
    ranges = np.array(row[start : start + n])
    if ranges.min() < 0.0:
        return f"{word}: range: expected 0 or more, got {ranges.min():g}"
    poses = row[start + n + (0 if word == "FLASER" else m + 1) :]
    beams = _Beams(ranges, first, step, range_max, _triple(poses[:3]))
    return _Line(number, word, t, _triple(poses[3:6]), beams, row[-1])


def _count(fields: list[str], place: int, minimum: int = 1) -> int:
    """Return the whole number at that place, or -1 if there is none of at least ``minimum``."""
    field = fields[place] if 0 < place < len(fields) else ""
    number = int(field) if field.isascii() and field.isdigit() and len(field) < 9 else -1
    return number if number >= minimum else -1


def _triple(values: list[float]) -> _Triple:
    return values[0], values[1], values[2]


def _angles(n: int) -> tuple[float, float]:
    """Return the step and the first beam's angle of a FLASER of n beams."""
    if n in (400, 401):
        return math.pi / 720.0, -math.radians(50.0)
    return math.pi / max(1, n if n % 2 == 0 else n - 1), -math.pi / 2.0


def _remove_glitches(ranges: list[FloatArray]) -> tuple[int, float]:
    """Make NaN of the few readings far beyond all others; return how many, and the largest of them."""
    every = np.concatenate(ranges) if ranges else np.empty(0)
    # In a log of a few scans, a single far reading may well be all that shows how far the scanner sees.
    if len(every) < 1000:
        return 0, 0.0
    few = len(every) // GLITCH_SHARE + 1
    limit = 2.0 * float(np.partition(every, -few - 1)[-few - 1])
    beyond = every[every > limit]
    if len(beyond):
        for own in ranges:
            own[own > limit] = np.nan
    return len(beyond), float(beyond.max(initial=0.0))


def _range_max(ranges: list[FloatArray]) -> float:
    """Return the reading from which on nothing was met; infinite without readings."""
    largest = max((float(np.nanmax(r)) for r in ranges if not np.isnan(r).all()), default=math.inf)
    for nothing, above in _SICK_NOTHING:
        if nothing <= largest < above:
            return nothing
    return largest


def _mount(pairs: list[tuple[_Triple, _Triple]]) -> _Triple | None:
    """Return the laser's place in the robot's frame from both's poses; None if it is not the same throughout."""
    if not pairs:
        return 0.0, 0.0, 0.0
    laser, robot = (np.array(poses) for poses in zip(*pairs, strict=True))
    mounts = between(robot, laser)
    middle = np.median(mounts, axis=0)
    off = np.abs(difference(np.broadcast_to(middle, mounts.shape), mounts))
    return _triple([float(v) for v in middle.round(6) + 0.0]) if off.max() < _MOUNTED else None
