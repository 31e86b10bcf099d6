"""What once had a wrong answer, asked again; in a process of its own, which may die of it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

CASES = sorted(path.parent for path in (Path(__file__).parent / "cases").glob("*/question.json"))

PROGRAM = """
import json, sys
from pathlib import Path
from benchmarks.soundness.campaign import ask_case
for folder in sys.argv[2:]:
    print(json.dumps(ask_case(folder, Path(sys.argv[1]))), flush=True)
"""


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str | None]:
    """What came of each case. If a process dies of one, another asks the rest."""
    asking = tmp_path_factory.mktemp("cases") / "asking.pickle"
    found: list[str | None] = []
    while left := CASES[len(found) :]:
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, str(asking), *map(str, left)], capture_output=True, text=True, timeout=300.0
        )
        found += [json.loads(line) for line in done.stdout.splitlines()]
        if done.returncode != 0:
            found.append(f"the process ended with {done.returncode}: {done.stderr}")
    return dict(zip([case.name for case in CASES], found, strict=True))


@pytest.mark.parametrize("name", [case.name for case in CASES])
def test_case(name: str, answers: dict[str, str | None]) -> None:
    assert answers[name] is None
