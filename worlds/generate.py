"""Write the worlds that trailmark ships: ``python worlds/generate.py [--check]``.

Every world file beside this program comes out of it, the same to the byte on every run; ``--check`` writes
nothing and fails if a file differs.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from environments import environment1, environment2
from grounds import bugtrap, lake, maze, parking, warehouse
from rooms import corridor, enclosed, factory, gate, lshape, narrow, office
from scattered import clutter, discs, field2000, long
from trailmark import World

FOLDER = Path(__file__).resolve().parent

MAKERS: tuple[Callable[[], World], ...] = (
    *(bugtrap, clutter, corridor, discs, enclosed, environment1, environment2),
    *(factory, field2000, gate, lake, long, lshape, maze, narrow, office, parking, warehouse),
)


def write(folder: Path) -> list[Path]:
    """Write all worlds into the folder and return the files."""
    files = []
    for make in MAKERS:
        world = make()
        files.append(folder / f"{world.name}.yaml")
        world.save(files[-1])
    return files


def check(folder: Path) -> list[str]:
    """Return a line for every file in the folder that is missing, differs, or that this program does not write."""
    with tempfile.TemporaryDirectory() as fresh:
        wanted = {file.name: file.read_bytes() for file in write(Path(fresh))}
    found = {file.name: file.read_bytes() for file in folder.glob("*.yaml")}
    return [
        *(f"{name}: missing" for name in sorted(wanted.keys() - found.keys())),
        *(f"{name}: not written by this program" for name in sorted(found.keys() - wanted.keys())),
        *(f"{name}: differs" for name in sorted(wanted.keys() & found.keys()) if wanted[name] != found[name]),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the worlds, or compare them with what is there; return the exit status."""
    parser = argparse.ArgumentParser(description="Write the worlds that trailmark ships.")
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if a file differs")
    if not parser.parse_args(arguments).check:
        sys.stdout.write(f"{len(write(FOLDER))} worlds written\n")
        return 0
    problems = check(FOLDER)
    for problem in problems:
        sys.stderr.write(f"worlds/{problem}; run: python worlds/generate.py\n")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
