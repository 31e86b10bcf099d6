"""Damaged files are handed to readers, in a process with little memory and time; only trailmark's errors may come."""

from __future__ import annotations

import hashlib
import pickle
import resource
import shutil
import tempfile
import time
import traceback
import warnings
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.fuzzing.mutations import damage, whole_folder
from benchmarks.fuzzing.targets import TARGETS
from trailmark.errors import TrailmarkError

__all__ = ["MEMORY", "SECONDS", "Finding", "attack", "available", "keep"]

SECONDS, MEMORY = 20.0, 700 * 2**20
"""What reading a file of less than a megabyte may take: processor time, and bytes beyond what there was before."""


class Finding(NamedTuple):
    """A file that was not refused as it should have been.

    Attributes:
        target: name of the reader.
        files: names and contents of the folder's files.
        problem: what came of it.
    """

    target: str
    files: dict[str, bytes]
    problem: str


@cache
def sources(name: str) -> dict[str, bytes]:
    """Return the right files of a reader, by their names."""
    with tempfile.TemporaryDirectory() as folder:
        TARGETS[name].make(Path(folder))
        return {str(path.relative_to(folder)): path.read_bytes() for path in whole_folder(Path(folder))}


def available(name: str) -> bool:
    """Return whether the files of a reader are there."""
    try:
        return bool(sources(name))
    except (FileNotFoundError, ImportError):
        return False


def attack(task: dict[str, Any], asking: Path) -> tuple[int, int, list[Finding]]:
    """Read ``count`` damaged files; return how many were read and how many refused, and what went wrong.

    Args:
        task: ``target``, ``seed``, ``count``.
        asking: file that tells what is being read, should the process die of it.
    """
    name = task["target"]
    rng = np.random.default_rng([task["seed"], sorted(TARGETS).index(name)])
    target, right = TARGETS[name], sources(name)
    found: list[Finding] = []
    read = refused = 0
    names = [key for key in right if _reaches(target.entry, key)]
    # What the reader needs is loaded while there is memory for it.
    if (problem := _read(name, right)) is not None:
        raise ValueError(f"{name}: the right files are not read: {problem}")
    room = _in_use() + MEMORY
    before = resource.getrlimit(resource.RLIMIT_AS)
    for _ in range(task["count"]):
        files = dict(right)
        key = names[int(rng.integers(len(names)))]
        files[key] = damage(files[key], rng, Path(key).suffix)
        asking.write_bytes(pickle.dumps(Finding(name, files, "")))
        resource.setrlimit(resource.RLIMIT_AS, (room, before[1]))
        begin = time.process_time()
        try:
            problem = _read(name, files)
        finally:
            resource.setrlimit(resource.RLIMIT_AS, before)
        read += problem is None
        refused += problem == ""
        if not problem and time.process_time() - begin > SECONDS:
            problem = f"took {time.process_time() - begin:.0f} s of processor time"
        if problem:
            found.append(Finding(name, files, problem))
    return read, refused, found


def _reaches(entry: str, key: str) -> bool:
    """Return whether a file has to do with what is read: the entry, its folder, or what it names."""
    return not key.startswith(("roadmap.", "path.")) or key == entry


def _read(name: str, files: dict[str, bytes]) -> str | None:
    """Return None if the files are read, an empty text if they are refused rightly, else what went wrong."""
    target = TARGETS[name]
    with tempfile.TemporaryDirectory() as folder:
        for key, data in files.items():
            (Path(folder) / key).parent.mkdir(exist_ok=True)
            (Path(folder) / key).write_bytes(data)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                target.read(Path(folder) / target.entry)
        except TrailmarkError as error:
            text = str(error)
            if "\n" in text or len(text) > 2000:
                return f"a message of {len(text)} characters: {text[:300]!r}"
            return ""
        except Exception:
            return traceback.format_exc(limit=-4)
    return None


def _in_use() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def keep(folder: Path, finding: Finding) -> Path:
    """Write a finding into a folder of its own; return that folder."""
    digest = hashlib.sha256(pickle.dumps(finding.files)).hexdigest()[:8]
    case = folder / f"{finding.target.replace(' ', '-')}-{digest}"
    shutil.rmtree(case, ignore_errors=True)
    for key, data in finding.files.items():
        (case / key).parent.mkdir(parents=True, exist_ok=True)
        (case / key).write_bytes(data)
    (case / "problem.txt").write_text(finding.problem + "\n")
    return case
