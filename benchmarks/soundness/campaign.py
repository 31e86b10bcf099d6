"""The campaign's run: what is asked in which order, what has been judged, kept in a folder to go on with."""

from __future__ import annotations

import json
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.soundness import cases
from benchmarks.soundness.parts import PARTS
from benchmarks.soundness.report import Report
from benchmarks.soundness.workers import Outcome
from trailmark.benchmark.environment import source_digest
from trailmark.errors import InternalErrorWarning

__all__ = ["SECONDS_A_CHUNK", "Campaign", "ask_case", "run_chunk"]

SECONDS_A_CHUNK = 240.0
"""A chunk that takes longer hangs."""

MOST_LOST = 5
"""Processes that may die without having asked anything: more, and it is the campaign that is broken."""


def run_chunk(task: dict[str, Any], asking: Path) -> dict[str, Any]:
    """Run one chunk of a part, in a worker."""
    rng = np.random.default_rng([task["seed"], list(PARTS).index(task["part"]), task["chunk"]])
    report = Report(Path(task["folder"]), asking, task["version"])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", InternalErrorWarning)
        try:
            PARTS[task["part"]].run(rng, report)
        except Exception:
            report.raised()
    for warning in told:
        # Found by the library itself before it did harm: an error all the same.
        report.internal(str(warning.message))
    return {"counts": dict(report.counts), "wrong": dict(report.wrong), "found": report.found}


def ask_case(folder: str, asking: Path) -> str | None:
    """Ask again what a case asks, in a worker."""
    world, asked = cases.load(Path(folder))
    with warnings.catch_warnings():
        warnings.simplefilter("error", InternalErrorWarning)
        return cases.ask(world, asked)


class Campaign:
    """What has been judged so far, kept in a folder.

    Args:
        folder: where; what is there of the same seed and code is gone on with.
        seed: of all chances.
        parts: names of the parts to run.
        share: of each part's target.
    """

    def __init__(self, folder: Path, seed: int, parts: list[str], share: float) -> None:
        self.seed, self.version, self.share = seed, source_digest()[:12], share
        self.folder = folder / f"{self.version}-{seed}"
        self.folder.mkdir(parents=True, exist_ok=True)
        self.parts = {name: PARTS[name] for name in parts}
        self.counts: dict[str, Counter[str]] = {name: Counter() for name in PARTS}
        self.wrong: dict[str, Counter[str]] = {name: Counter() for name in PARTS}
        self.done: dict[str, set[int]] = {name: set() for name in PARTS}
        self.seconds = 0.0
        self.found: list[str] = []
        self._lost = 0
        self._log = self.folder / "chunks.jsonl"
        if self._log.exists():
            for line in self._log.read_text().splitlines():
                self._add(json.loads(line))

    def tasks(self, deadline: float) -> Iterator[dict[str, Any]]:
        """Yield what is left to do, always of the part that has come the least far."""
        following = dict.fromkeys(self.parts, 0)
        while perf_counter() < deadline:
            far = {name: self.progress(name) for name in self.parts}
            name = min(far, key=lambda name: far[name])
            if far[name] >= 1.0:
                return
            while following[name] in self.done[name]:
                following[name] += 1
            task = {"part": name, "chunk": following[name], "seed": self.seed}
            following[name] += 1
            yield {**task, "folder": str(self.folder / "found"), "version": self.version}

    def progress(self, name: str) -> float:
        """Return how much of a part is done, 1 for all."""
        part = self.parts[name]
        return self.counts[name][part.counts] / (self.share * part.target)

    def add(self, outcome: Outcome, seconds: float) -> None:
        """Keep the outcome of a chunk."""
        task = outcome.task
        if outcome.problem is not None and outcome.asking is None:
            self._lost += 1
            if self._lost > MOST_LOST:
                raise RuntimeError(f"{outcome.problem} before anything was asked, {self._lost} times")
        row = {"part": task["part"], "chunk": task["chunk"], "seconds": round(seconds, 3), **(outcome.value or {})}
        if outcome.problem is not None:
            row["wrong"], row["found"] = {outcome.problem: 1}, []
            if outcome.asking is not None:
                world, asked = outcome.asking
                asked = replace(asked, found=f"{outcome.problem} ({self.version})")
                row["found"] = [cases.save(self.folder / "found", outcome.problem, world, asked).name]
        with self._log.open("a") as log:
            log.write(json.dumps(row) + "\n")
        self._add(row)

    def _add(self, row: dict[str, Any]) -> None:
        name = row["part"]
        self.done[name].add(row["chunk"])
        self.counts[name].update(row.get("counts", {}))
        self.wrong[name].update(row.get("wrong", {}))
        self.seconds += row["seconds"]
        self.found += row.get("found", [])

    def record(self) -> dict[str, Any]:
        """Return the results as plain numbers and texts."""
        return {
            "code": self.version,
            "seed": self.seed,
            "processor_seconds": round(self.seconds),
            "parts": {
                name: {"target": part.target, "counts": dict(self.counts[name]), "wrong": dict(self.wrong[name])}
                for name, part in self.parts.items()
            },
        }
