"""How much is there to keep up: the lines of the source, and how long its tests take. Writes results/upkeep.{json,md}.

Tests are timed by the README's own command in a fresh clone, first from nothing (no environment, no cache of pip's, no
bytecode, no compiled kernel), then its quick part again with all of that there. Uncommitted changes do not count. Other
work on the machine does, so the processor's time stands beside the clock's.

    python -m benchmarks.upkeep [--tests]
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from time import perf_counter

from benchmarks.machine import describe_machine, markdown_table

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "trailmark"
RESULTS = ROOT / "benchmarks" / "results"

WANTED_LINES = {"all of src": 28_000, "planning": 4_000, "estimation": 6_500}
"""At most so many lines."""

WANTED_LONGEST = 350
"""At most so many lines in a file; tests/test_architecture.py holds it."""

WANTED_SECONDS = {"everything, from nothing": 360.0, "not slow, warm": 90.0}
"""Less than so many seconds by the clock, on two cores."""

DATA = "../shared/data"
"""Where tests look for real data, seen from a checkout, unless TRAILMARK_DATA says otherwise."""


def lines_by_part(source: Path = SOURCE) -> tuple[dict[str, tuple[int, int]], tuple[str, int]]:
    """Return files and lines of each part of the source, largest first, and the longest file with its lines."""
    lengths = {file: len(file.read_text(encoding="utf-8").splitlines()) for file in source.rglob("*.py")}
    files: Counter[str] = Counter()
    lines: Counter[str] = Counter()
    for file, length in lengths.items():
        folders = file.relative_to(source).parts[:-1]
        for part in ("all of src", folders[0] if folders else "modules in no package"):
            files[part] += 1
            lines[part] += length
    longest = max(lengths, key=lambda file: lengths[file])
    parts = {part: (files[part], number) for part, number in lines.most_common()}
    return parts, (longest.relative_to(source).as_posix(), lengths[longest])


def command_of_tests(readme: str) -> tuple[str, str]:
    """Return the README's command for tests in two halves: what makes the environment, and the tests themselves."""
    found = re.search(r"^## Tests\n.*?^```sh\n(.*?)\n```", readme, re.MULTILINE | re.DOTALL)
    if found is None or " && " not in found[1]:
        raise ValueError("expected a command with && under '## Tests' in README.md")
    made, _, tests = found[1].rpartition(" && ")
    return made, tests


def timed(command: str, folder: Path, environment: dict[str, str]) -> tuple[float, float, str]:
    """Return the seconds of a command, by the clock and of the processor, and the last line of its output."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    done = subprocess.run(["bash", "-c", command], cwd=folder, env=environment, capture_output=True, text=True)
    wall, after = perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        said = [*done.stdout.splitlines(), *done.stderr.splitlines()]
        sys.exit(f"{command}: exit status {done.returncode}\n" + "\n".join(said[-40:]))
    last = (done.stdout.strip().splitlines() or [""])[-1]
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, last


def time_tests() -> list[list[str]]:
    """Return the rows of the table of tests: what was timed, its seconds, those wanted, and the outcome."""
    with tempfile.TemporaryDirectory(prefix="upkeep-") as name:
        clone, caches = Path(name) / "clone", Path(name) / "caches"
        subprocess.run(["git", "clone", "-q", ROOT, clone], check=True)
        own = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        own |= {"XDG_CACHE_HOME": str(caches), "TRAILMARK_DATA": own.get("TRAILMARK_DATA", str(ROOT / DATA))}
        made, tests = command_of_tests((clone / "README.md").read_text(encoding="utf-8"))
        environment, cold = timed(made, clone, own), timed(tests, clone, own)
        warm = timed(f"{tests} -m 'not slow'", clone, own)
    return [
        ["the environment, from nothing", *_seconds(environment), "", ""],
        ["the tests, from nothing", *_seconds(cold), "", cold[2]],
        _judged("everything, from nothing", (environment[0] + cold[0], environment[1] + cold[1], "")),
        _judged("not slow, warm", warm),
    ]


def _seconds(measured: tuple[float, float, str]) -> list[str]:
    return [f"{measured[0]:.0f}", f"{measured[1]:.0f}"]


def _judged(name: str, measured: tuple[float, float, str]) -> list[str]:
    wanted = WANTED_SECONDS[name]
    verdict = "reached" if measured[0] < wanted else "not reached"
    return [name, *_seconds(measured), f"{wanted:.0f}", "; ".join(filter(None, [verdict, measured[2]]))]


def main() -> int:
    """Count, time the tests if asked to, and write both down; times measured before stay otherwise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tests", action="store_true", help="time the tests, too: 10 to 20 minutes")
    options = parser.parse_args()
    parts, (longest, length) = lines_by_part()
    sizes = []
    for part, (files, lines) in parts.items():
        wanted = WANTED_LINES.get(part)
        verdict = "" if wanted is None else "reached" if lines <= wanted else f"not reached: {lines / wanted:.1f} times"
        sizes.append([part, f"{files}", f"{lines:,}", "" if wanted is None else f"{wanted:,}", verdict])
    verdict = "reached" if length <= WANTED_LONGEST else "not reached"
    sizes.append([f"longest file: {longest}", "1", f"{length}", f"{WANTED_LONGEST}", verdict])
    file = RESULTS / "upkeep.json"
    known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    tests = known.get("tests")
    if options.tests:
        tests = {"machine": describe_machine(), "rows": time_tests()}
    machine = describe_machine()
    file.write_text(json.dumps({"machine": machine, "lines": sizes, "tests": tests}, indent=1) + "\n", encoding="utf-8")
    text = ["# What there is to keep up", "", "Lines with comments, docstrings and empty lines.", ""]
    text += [markdown_table(["part", "files", "lines", "at most", ""], sizes), "", machine, ""]
    if tests:
        header = ["tests", "s", "processor s", "wanted below s", ""]
        text += [markdown_table(header, tests["rows"]), "", tests["machine"], ""]
    (RESULTS / "upkeep.md").write_text("\n".join(text), encoding="utf-8")
    print("\n".join(text))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
