"""Programs in processes of their own, which may crash or hang as they like."""

from __future__ import annotations

import contextlib
import io
import json
import os
import runpy
import subprocess
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def run_python(
    words: Sequence[str],
    *,
    timeout: float,
    cwd: Path | None = None,
    env: Mapping[str, str] | None = None,
    stdin: str | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run Python with some words after ``python`` and return what it printed; no window is shown.

    Raises:
        subprocess.TimeoutExpired: it was killed after so many seconds.
    """
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    known = dict(os.environ if env is None else env) | {"MPLBACKEND": "Agg", "PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, *words], cwd=cwd, env=known, input=stdin, capture_output=True, text=True, timeout=timeout
    )


def run_in_turn(
    programs: Sequence[Sequence[Sequence[str]]], *, timeout: float, cwd: Path
) -> list[tuple[Sequence[str], str]]:
    """Run programs one after the other in one process: the first of its versions that does not fail, of each.

    Returns:
        The words of each program and what it printed on stdout.
    """
    done = run_python(["-m", "tests.helpers.processes"], timeout=timeout, cwd=cwd, stdin=json.dumps(programs))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert len(found) == len(programs), done.stderr
    return [(words, text) for words, text in found]


def _printed(words: Sequence[str]) -> str:
    """Run a program as ``python`` does with these words; return what it prints, raise what it fails with."""
    said = io.StringIO()
    sys.argv = ["-c"] if words[0] == "-c" else list(words[1:])
    with contextlib.redirect_stdout(said):
        try:
            if words[0] == "-c":
                exec(compile(words[1], "<page>", "exec"), {"__name__": "__main__"})  # noqa: S102  # as ``python -c`` does
            else:
                runpy.run_module(words[1], run_name="__main__", alter_sys=True)
        except SystemExit as end:
            if end.code not in (None, 0):
                raise RuntimeError(f"{' '.join(words)}: status {end.code}") from end
    return said.getvalue()


def _main() -> None:
    found = []
    for versions in json.load(sys.stdin):
        for words in versions:
            try:
                found.append((words, _printed(words)))
            except Exception:
                if words == versions[-1]:
                    raise
                traceback.print_exc()
            else:
                break
    sys.stdout.write(f"\n{json.dumps(found)}\n")


if __name__ == "__main__":
    _main()
