"""The folder that an exploration is kept in: its map in three forms, its log, its figures, and what going on needs.

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
import zipfile
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError, OutputError
from trailmark.estimation.readers import load_log, save_log
from trailmark.estimation.records import Log
from trailmark.exploration.result import ExplorationProgress, ExplorationResult, History
from trailmark.formats import nav2_map
from trailmark.formats.files import MAX_FILE_BYTES, check_writable, read_bytes, write_atomically
from trailmark.se2 import FloatArray

__all__ = [
    "FILES",
    "SavedExploration",
    "check_folder",
    "keep_exploration",
    "load_exploration",
    "save_exploration",
    "summary_of",
]

FILES: Final = (
    *("log.jsonl", "resume.npz", "world.yaml", "map.yaml", "map.pgm", "roadmap.npz", "summary.json"),
    *("exploration.png", "exploration.gif"),
)
"""Names of all files."""

GREY = np.array([nav2_map.UNKNOWN, nav2_map.FREE, nav2_map.OCCUPIED], dtype=np.uint8)
"""By the state of a cell."""


class SavedExploration(NamedTuple):
    """What is needed to go on with an exploration."""

    log: Log
    """All that was recorded."""
    history: tuple[ExplorationProgress, ...]
    """As :class:`ExplorationResult` has it."""
    first_known: NDArray[np.float32]
    """As :class:`ExplorationResult` has it."""
    contacts: FloatArray
    """Where the robot ran into something, shape (n, 2), metres."""
    robot_state: dict[str, Any] | None
    """Of the simulated robot; None with a real one."""
    seconds: float
    """Time that it took so far, as :class:`ExplorationResult` has it."""
    decisions: FloatArray
    """Seconds that each choice of a landmark took, shape (n,)."""
    options: dict[str, Any]
    """Whatever the caller kept beside it: what the exploration was begun with."""


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
    found = result.log, result.history, result.first_known, known.contacts
    kept = *found, result.robot_state, result.seconds, result.decisions
    keep_exploration(SavedExploration(*kept, options or {}), path)
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
            named = {name: arrays[name] for name in History._fields if name != "events"}
            history = History(**named, events=tuple((int(i), str(text)) for i, text in state["events"])).progress()
            # Explorations of earlier versions have none.
            contacts = np.asarray(arrays.get("contacts", ()), np.float64).reshape(-1, 2)
            first, mark = np.asarray(arrays["first_known"], dtype=np.float32), str(arrays["fingerprint"])
        saved = SavedExploration(
            log,
            history,
            first,
            contacts,
            state["robot"],
            float(state["seconds"]),
            np.asarray(state["decisions"], dtype=np.float64),
            dict(state["options"]),
        )
    except Exception as error:  # numpy and zipfile let errors of many kinds through for damaged data
        raise FormatError(file, f"not a file that trailmark explore wrote: {str(error)[:120]}") from None
    if mark != _fingerprint(log):
        raise FormatError(file, "expected the log.jsonl that was written with it, got another one")
    return saved


def _resume_bytes(saved: SavedExploration) -> bytes:
    arrays: dict[str, Any] = History.of(saved.history)._asdict()
    arrays |= {"first_known": saved.first_known, "contacts": saved.contacts}
    state = {"events": arrays.pop("events"), "robot": saved.robot_state, "options": saved.options}
    state |= {"seconds": saved.seconds, "decisions": saved.decisions.tolist()}
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, **arrays, state=np.array(json.dumps(state)), fingerprint=np.array(_fingerprint(saved.log))
    )
    return buffer.getvalue()


def _limit_size(data: bytes) -> None:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        unpacked = sum(member.file_size for member in archive.infolist())
    if unpacked > MAX_FILE_BYTES:
        raise ValueError(f"expected at most {MAX_FILE_BYTES:,} bytes unpacked, got {unpacked:,}")


def _fingerprint(log: Log) -> str:
    """Return what tells one log from another: its name, its length and its last record."""
    told = (
        log.name,
        len(log.records),
        repr([np.asarray(value).tolist() for value in log.records[-1] if value is not None]),
    )
    return hashlib.sha256(repr(told).encode()).hexdigest()


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
