"""Which results are older than the code? Lists the files of ``benchmarks/results`` to be measured anew.

Listed are those whose code has changed since (see ``benchmarks.age``), with the files that changed, and those that do
not name the code that they were measured with; the exit status is 1 if there are any.

    python -m benchmarks.stale
"""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.age import AGE, ROOT, changed_files, code_digest

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
            f"{program} has changed since commit {commit}{_describe_changes(program, commit, root)}"
            for program, commit, code in ages
            if code_digest(program, root) != code
        }
        if changed or not ages:
            found[file.relative_to(folder).as_posix()] = "; ".join(sorted(changed)) or "names no code"
    return found


def _describe_changes(program: str, commit: str, root: Path) -> str:
    files = changed_files(program, commit.removesuffix(" with changes"), root)
    if not files:
        return ""
    return f": {', '.join(files) if len(files) <= MAX_FILES else f'{len(files)} files'}"


def main() -> int:
    """Print one line for each result that is not of the present code; 1 if there are any."""
    found = stale()
    for name, reason in found.items():
        print(f"{name}: {reason}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
