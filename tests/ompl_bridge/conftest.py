"""OMPL can take its process down: programs that use it run in one of their own, with a time limit."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from tests.support.forks import Forks

HEAD = """
import json, os, sys
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

Run = Callable[..., dict[str, Any]]


@pytest.fixture(scope="session")
def run_ompl(forks: Forks) -> Run:
    """Return a function that runs a program after HEAD and returns what it gave to ``tell``, all answers together.

    With ``whole`` the interpreter comes to its own end, which OMPL can crash too.
    """

    def run(
        program: str,
        *,
        seconds: float = 120.0,
        status: int | None = 0,
        whole: bool = False,
    ) -> Any:
        words = ["-c", HEAD + program]
        done = forks.run(words, timeout=seconds, whole=whole)
        assert status is None or done.returncode == status, f"{done.returncode}\n{done.stdout}\n{done.stderr[-3000:]}"
        answers: dict[str, Any] = {}
        for line in done.stdout.splitlines():
            if line.startswith("ANSWER "):
                answers.update(json.loads(line.removeprefix("ANSWER ")))
        return answers

    return run
