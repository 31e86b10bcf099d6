"""Changes of the kernels that let collisions through are noticed: a sample of what benchmarks.mutants runs in full."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from benchmarks import mutants
from benchmarks.mutant_cases import cases

PROGRAM = """
import json
from benchmarks.mutant_cases import cases
from benchmarks.mutants import _run, mutants_of, verdict
made = cases(1, 2, scenes=3)
found, where, before = verdict(made)
print(json.dumps(["as it is", found, where]), flush=True)
wanted = {
    ("certify", "certify", "if d < need -> False"),
    ("certify", "certify", "without count += 2"),
    ("kernels", "state", "d > ROUNDING -> d <= ROUNDING"),
    ("kernels", "state", "UNDECIDED -> FREE"),
    ("distances", "ring_clearance", "without return 0.0"),
    ("certify", "_straight_pose", "track.x + along * track.dx -> track.x - along * track.dx"),
    ("certify", "curve_track", "without bound += fabs(length) * (1.0 + fabs(side) * turning)"),
}
for module in ("kernels", "certify", "distances"):
    for mutant in mutants_of(module):
        key = (module, mutant.function, mutant.change)
        if key in wanted:
            found = _run(mutant, made, before)
            print(json.dumps([" ".join(key), *found]), flush=True)
            if found[0] in ("accepts", "error"):
                wanted.remove(key)
print(json.dumps(["unnoticed", str(len(wanted)), ""]))
"""


@pytest.fixture(scope="module")
def verdicts() -> list[tuple[str, str, str]]:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, timeout=900, check=True
    )
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


@pytest.mark.slow
def test_the_code_as_it_is_accepts_no_collision_and_what_is_free(verdicts: list[tuple[str, str, str]]) -> None:
    assert verdicts[0] == ("as it is", "same", "")


@pytest.mark.slow
def test_changes_that_let_collisions_through_are_noticed(verdicts: list[tuple[str, str, str]]) -> None:
    changes = verdicts[1:-1]
    assert len({name for name, *_ in changes}) == 7
    noticed = {name for name, what, _ in changes if what in ("accepts", "error")}
    assert noticed == {name for name, *_ in changes}
    assert verdicts[-1] == ("unnoticed", "0", "")


def test_a_case_that_does_not_exist_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By no case at all every mutant would be called the same."""
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    # Making all cases takes seconds.
    monkeypatch.setattr(mutants, "cases", lambda seed, size: cases(seed, size, scenes=2))
    with pytest.raises(SystemExit):
        mutants.main(["--size", "1", "--case", "mixed"])
    message = "expected --case to be one of ['mixed, disc', 'mixed, rectangle'], got ['mixed']"
    assert message in " ".join(capsys.readouterr().err.split())
