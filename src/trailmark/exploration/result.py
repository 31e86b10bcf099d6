"""The settings and the outcome of an exploration, and the folder that it is kept in.

The folder holds the map in three forms, the log, the figures, and what going on needs:

- ``world.yaml``: the map as a world, obstacles with covariances.
- ``map.yaml``, ``map.pgm``: the cells as a nav2 map: 254 free, 205 unknown, 0 occupied.
- ``roadmap.npz``: landmarks and certified motions (:func:`trailmark.roadmap.load_roadmap`).
- ``log.jsonl``: what was recorded; ``trailmark map`` makes the same world of it.
- ``summary.json``: the figures.
- ``resume.npz``: what is needed, beside the log, to go on.
- ``exploration.png``, ``exploration.gif``: by :mod:`trailmark.plotting`.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.arguments import Positive, PositiveOrInfinite, Probability, checked_fields
from trailmark.errors import ConfigurationError, FormatError, OutputError
from trailmark.estimation.readers import load_log, save_log
from trailmark.estimation.records import Log
from trailmark.exploration.known_map import KnownMap
from trailmark.formats import nav2_map
from trailmark.formats.files import MAX_FILE_BYTES, check_writable, read_bytes, write_atomically
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray
from trailmark.world import World
from trailmark.world.robot import Robot

__all__ = [
    "FILES",
    "Evaluation",
    "ExplorationProgress",
    "ExplorationResult",
    "ExplorationSettings",
    "SavedExploration",
    "Status",
    "check_folder",
    "keep_exploration",
    "landmarks_of",
    "load_exploration",
    "save_exploration",
    "summary_of",
]

Status = Literal["complete", "complete-at-confidence", "time", "distance", "stuck", "silent", "interrupted"]


# Cells of the map by default, at most, and four times as many in any case: each takes about 30 bytes.
MAX_CELLS = 4_000_000


@dataclass(frozen=True)
class ExplorationSettings:
    """Settings of an exploration.

    Raises:
        ConfigurationError: a value that is not allowed.
    """

    cell: Positive | None = None
    """Metres: side of a cell of the map; by default a fifth of the robot's inscribed radius, at least 0.02 m and within
    MAX_CELLS. Passages narrower than the robot and two cells are not entered."""
    sense_period: Positive = 0.1
    """Seconds that the robot drives between two readings."""
    confidence: Probability | None = None
    """Probability that a path is free of obstacles in spite of the sensor's noise; None: noise is ignored."""
    time_limit: PositiveOrInfinite = math.inf
    """Seconds of the robot's clock."""
    distance_limit: PositiveOrInfinite = math.inf
    """Metres driven."""
    planning_time: Positive = 1.0
    """Seconds for planning to a landmark; if there is neither a path nor a proof, it is tried again later."""
    return_home: bool = False
    """Whether to drive back to the start at the end."""

    def __post_init__(self) -> None:
        checked_fields(self, ConfigurationError)

    def cell_side(self, robot: Robot, bounds: tuple[float, float, float, float]) -> float:
        """Return the side of the map's cells, metres.

        Raises:
            ConfigurationError: the one asked for makes too many.
        """
        xmin, ymin, xmax, ymax = bounds
        least = math.sqrt((xmax - xmin) * (ymax - ymin) / MAX_CELLS)
        if self.cell is None:
            return max(0.02, robot.inscribed_disc.radius / 5.0, least)
        if self.cell < 0.5 * least:
            raise ConfigurationError(f"cell: expected at least {0.5 * least:.3g} m in this world, got {self.cell:g} m")
        return self.cell


class ExplorationProgress(NamedTuple):
    """Where an exploration stands."""

    time: float
    """Seconds of the robot's clock."""
    distance: float
    """Metres driven, by odometry."""
    area: float
    """Square metres that are known, free or occupied."""
    landmarks: int
    """How many were driven to."""
    sigma: float
    """Standard deviation of the robot's place along its least certain direction, metres, in the frame of its start."""
    pose: FloatArray
    """Where it is, shape (3,)."""
    target: FloatArray | None
    """The landmark that it drives to, shape (3,)."""
    path: FloatArray | None
    """The way there, shape (n, 3)."""
    event: str
    """What happened, in words; empty most of the time."""


class Evaluation(NamedTuple):
    """What only a simulator can say."""

    seen: float
    """Share of the area that can be seen from where the robot can get to."""
    collisions: int
    """Times that it met something."""
    nees: float
    """Mean normalised estimation error squared of its place and heading, 3 where the covariances are right."""


@dataclass(frozen=True, kw_only=True)
class SavedExploration:
    """What is needed to go on with an exploration.

    Attributes:
        log: all that was recorded.
        history: one for each reading of the sensor.
        first_known: seconds of the robot's clock at which each cell was known first, shape (rows, columns), infinite
            where it is not.
        contacts: where the robot ran into something, shape (n, 2), metres.
        robot_state: of the simulated robot; None with a real one.
        seconds: time that it took so far, decisions included.
        decisions: seconds of each reading at which a landmark was chosen, or the way to it looked for, shape (n,).
        options: whatever the caller kept beside it: what the exploration was begun with.
    """

    log: Log
    history: tuple[ExplorationProgress, ...]
    first_known: NDArray[np.float32]
    contacts: FloatArray
    robot_state: dict[str, Any] | None
    seconds: float
    decisions: FloatArray
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ExplorationResult(SavedExploration):
    """The outcome of an exploration.

    Attributes:
        status: why it ended.
        reason: the same, in a sentence.
        world: the map, its obstacles with covariances (as ``trailmark map`` makes it of the log).
        known: the cells at the end.
        roadmap: landmarks and certified motions between them, in the map as it is known at the end.
        strategy: its name.
        seed: of what was drawn.
        settings: with which it was run.
        evaluation: by the simulator; None with a real robot.
    """

    status: Status
    reason: str
    world: World
    known: KnownMap
    roadmap: Roadmap
    strategy: str
    seed: int
    settings: ExplorationSettings
    evaluation: Evaluation | None = None


FILES: Final = (
    *("log.jsonl", "resume.npz", "world.yaml", "map.yaml", "map.pgm", "roadmap.npz", "summary.json"),
    *("exploration.png", "exploration.gif"),
)
"""Names of all files."""

GREY = np.array([nav2_map.UNKNOWN, nav2_map.FREE, nav2_map.OCCUPIED], dtype=np.uint8)  # By the state of a cell.


def landmarks_of(history: Sequence[ExplorationProgress]) -> FloatArray:
    """Return the landmarks that were driven to, shape (k, 3), in their order."""
    counts = np.diff([row.landmarks for row in history], prepend=0)
    chosen = [row.pose if row.target is None else row.target for row in history]
    return np.array(chosen, dtype=np.float64).reshape(-1, 3)[counts > 0]


def summary_of(result: ExplorationResult) -> dict[str, Any]:
    """Return the figures of an exploration as plain data, as ``summary.json`` holds them.

    ``seen``, ``collisions`` and ``nees`` are None where no simulator could tell them.
    """
    last, told, decisions = result.history[-1], result.evaluation, result.decisions
    return {
        "world": result.world.name,
        "strategy": result.strategy,
        "seed": result.seed,
        "status": result.status,
        "reason": result.reason,
        "seen": None if told is None else _number(told.seen),
        "area": last.area,
        "distance": last.distance,
        "landmarks": last.landmarks,
        "collisions": None if told is None else told.collisions,
        "nees": None if told is None else _number(told.nees),
        "duration": last.time,
        "time": {
            "total": result.seconds,
            "decision_median": float(np.median(decisions)) if len(decisions) else 0.0,
            "decision_max": float(np.max(decisions, initial=0.0)),
        },
    }


def check_folder(folder: str | Path) -> None:
    """Raise if an exploration cannot be kept there; to be asked before it begins.

    Raises:
        OutputError: it is no folder and cannot become one, or one of the files in it cannot be written.
    """
    path = Path(folder)
    try:
        there, taken = path.is_dir(), path.exists()
    except (OSError, ValueError):  # told by check_writable
        there, taken = False, False
    if taken and not there:
        raise OutputError(f"{path}: expected a folder, got a file")
    if not there:
        check_writable(path)
        return
    for name in FILES:
        check_writable(path / name)


def save_exploration(
    result: ExplorationResult, folder: str | Path, options: dict[str, Any] | None = None
) -> list[Path]:
    """Write all but the pictures, each file whole or not at all, and first what no other run could give again.

    Args:
        result: the outcome.
        folder: made if it is not there.
        options: plain data for whoever goes on.

    Returns:
        The files.

    Raises:
        OutputError: as :func:`check_folder`.
    """
    path, known = Path(folder), result.known
    keep_exploration(replace(result, options=options or {}), path)
    result.world.save(path / "world.yaml")
    nav2_map.save_nav2_cells(GREY[known.state], path / "map.yaml", known.cell, known.origin)
    result.roadmap.save(path / "roadmap.npz")
    members = (f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in summary_of(result).items())
    write_atomically(path / "summary.json", "{\n" + ",\n".join(members) + "\n}\n")
    return [path / name for name in FILES if not name.startswith("exploration")]


def keep_exploration(saved: SavedExploration, folder: str | Path) -> None:
    """Write what is needed to go on, ``log.jsonl`` and ``resume.npz``, before the final map is built.

    Raises:
        OutputError: as :func:`check_folder`.
    """
    check_folder(folder)
    path = Path(folder)
    path.mkdir(exist_ok=True)
    save_log(saved.log, path / "log.jsonl")
    write_atomically(path / "resume.npz", _resume_bytes(saved))


def load_exploration(folder: str | Path) -> SavedExploration:
    """Return what :func:`save_exploration` kept for going on.

    Raises:
        FormatError: there is no exploration, its files are damaged, or they do not belong together.
    """
    file = Path(folder) / "resume.npz"
    if not file.is_file():
        raise FormatError(folder, "expected a folder that trailmark explore wrote, with resume.npz and log.jsonl in it")
    data = read_bytes(file)
    log = load_log(file.with_name("log.jsonl"), "jsonl")
    try:
        _limit_size(data)
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            state = json.loads(str(arrays["state"]))
            said = {int(i): str(text) for i, text in state["events"]}
            history = tuple(_progress(row, said.get(i, "")) for i, row in enumerate(arrays["history"]))
            saved = SavedExploration(
                log=log,
                history=history,
                first_known=np.asarray(arrays["first_known"], dtype=np.float32),
                contacts=np.asarray(arrays["contacts"], np.float64).reshape(-1, 2),
                robot_state=state["robot"],
                seconds=float(state["seconds"]),
                decisions=np.asarray(state["decisions"], dtype=np.float64),
                options=dict(state["options"]),
            )
    except Exception as error:  # numpy and zipfile let errors of many kinds through for damaged data
        raise FormatError(file, f"not a file that trailmark explore wrote: {str(error)[:120]}") from None
    if state["fingerprint"] != _fingerprint(log):
        raise FormatError(file, "expected the log.jsonl that was written with it, got another one")
    return saved


def _progress(row: FloatArray, event: str) -> ExplorationProgress:
    """Return a row of the history as it was kept; paths are not."""
    time, distance, area, landmarks, sigma = row[:5].tolist()
    target = None if np.isnan(row[8]) else row[8:]
    return ExplorationProgress(time, distance, area, int(landmarks), sigma, row[5:8], target, None, event)


def _resume_bytes(saved: SavedExploration) -> bytes:
    nowhere = np.full(3, np.nan)
    rows = [[*row[:5], *row.pose, *(nowhere if row.target is None else row.target)] for row in saved.history]
    state = {
        "events": [(i, row.event) for i, row in enumerate(saved.history) if row.event],
        "robot": saved.robot_state,
        "options": saved.options,
        "seconds": saved.seconds,
        "decisions": saved.decisions.tolist(),
        "fingerprint": _fingerprint(saved.log),
    }
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        history=np.array(rows).reshape(-1, 11),
        first_known=saved.first_known,
        contacts=saved.contacts,
        state=np.array(json.dumps(state)),
    )
    return buffer.getvalue()


def _limit_size(data: bytes) -> None:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        unpacked = sum(member.file_size for member in archive.infolist())
    if unpacked > MAX_FILE_BYTES:
        raise ValueError(f"expected at most {MAX_FILE_BYTES:,} bytes unpacked, got {unpacked:,}")


def _fingerprint(log: Log) -> str:
    """Return what tells one log from another: its name, its length and its last record."""
    last = [np.asarray(value).tolist() for value in log.records[-1] if value is not None]
    return hashlib.sha256(repr((log.name, len(log.records), repr(last))).encode()).hexdigest()


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
