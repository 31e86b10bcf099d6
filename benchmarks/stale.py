"""Which results are older than the code? Lists the files of ``benchmarks/results`` to be measured anew.

Listed are those whose code has changed since (see ``benchmarks.age``), with the files that changed, and those that do
not name the code that they were measured with; the exit status is 1 if there are any.

    python -m benchmarks.stale
"""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.age import AGE, ROOT, WITH_CHANGES, changed_files, code_digest

__all__ = ["main", "stale"]

MAX_FILES = 3
"""So many changed files are named: where there are more, how many there are."""


def stale(root: Path = ROOT) -> dict[str, str]:
    """Return what is wrong with the age of each result that is not of the present code, by its path."""
    folder = root / "benchmarks" / "results"
    found = {}
    for file in sorted(file for file in folder.rglob("*") if file.is_file()):
        ages = [[text.decode() for text in age.groups()] for age in AGE.finditer(file.read_bytes())]
        changed = {
            f"{program} has changed since commit {commit}{changes}"
            for program, commit, code in ages
            if (changes := _changes(program, commit, code, root)) is not None
        }
        if changed or not ages:
            found[file.relative_to(folder).as_posix()] = "; ".join(sorted(changed)) or "names no code"
    return found


def _changes(program: str, commit: str, code: str, root: Path) -> str | None:
    """Return what has changed since a result was measured, as far as is known; None if nothing has.

    The digest decides where it is the same or git does not know the code. Where it is not, and the code is, it was made
    when other files counted as dependencies.
    """
    if code_digest(program, root) == code:
        return None
    known = commit.removesuffix(WITH_CHANGES)
    files = changed_files(program, known, root)
    if not files:
        return None if files is not None and known == commit else ""
    return f": {', '.join(files) if len(files) <= MAX_FILES else f'{len(files)} files'}"


def main() -> int:
    """Print one line for each result that is not of the present code; 1 if there are any."""
    found = stale()
    for name, reason in found.items():
        print(f"{name}: {reason}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
