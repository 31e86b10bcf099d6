"""OMPL can take its process down: programs that use it run in one beside the tests, with a time limit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
HEAD = """
import gc, json, os, sys
import numpy as np
from ompl import base as ob, geometric as og, util as ou
from trailmark import Robot, World
from trailmark.world.library import find_world
from trailmark.ompl_bridge import *
ou.setLogLevel(ou.LOG_ERROR)
def shipped(name):
    return World.load(find_world(name))
def tell(**answers):
    print("ANSWER", json.dumps(answers), flush=True)
"""
SERVER = """
import traceback
for line in sys.stdin:
    try:
        exec(json.loads(line), dict(globals()))
    except BaseException:
        print("FAILED", json.dumps(traceback.format_exc()), flush=True)
    gc.collect()
    print("DONE", flush=True)
os._exit(0)
"""

Run = Callable[..., dict[str, Any]]


class Programs:
    """Runs programs in one process, which is started anew if one of them took it down, or took too long."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def __call__(self, program: str, *, seconds: float = 240.0, whole: bool = False) -> dict[str, Any]:
        """Return what a program, after HEAD, gave to ``tell``, all answers together.

        With ``whole`` it has a process of its own, which comes to its own end; OMPL can crash that too.
        """
        if whole:
            done = subprocess.run([*COMMAND, HEAD + program], env=_environment(), timeout=seconds, **PIPES)
            assert done.returncode == 0, f"{done.returncode}\n{done.stdout}\n{done.stderr[-3000:]}"
            return _told(done.stdout.splitlines())
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(
                [*COMMAND, HEAD + SERVER], env=_environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(program), file=self._process.stdin, flush=True)
        limit = threading.Timer(seconds, self._process.kill)
        limit.start()
        lines: list[str] = []
        try:
            while (line := self._process.stdout.readline()) != "DONE\n":
                lines.append(line)
                assert line, f"the process ended with {self._process.wait()}:\n{''.join(lines)[-3000:]}"
        finally:
            limit.cancel()
        return _told(lines)

    def close(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()


COMMAND = [sys.executable, "-X", "faulthandler", "-c"]
PIPES: dict[str, Any] = {"capture_output": True, "text": True, "check": False}


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}


def _told(lines: list[str]) -> dict[str, Any]:
    answers: dict[str, Any] = {}
    for line in lines:
        assert not line.startswith("FAILED"), json.loads(line.removeprefix("FAILED"))
        if line.startswith("ANSWER "):
            answers.update(json.loads(line.removeprefix("ANSWER ")))
    return answers


@pytest.fixture(scope="session")
def run_ompl() -> Iterator[Run]:
    """Return what runs programs with OMPL, which may crash or hang."""
    programs = Programs()
    yield programs
    programs.close()
