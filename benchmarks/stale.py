"""Which results are older than the code? Lists the files of ``benchmarks/results`` to be measured anew.

Listed are those whose code has changed since (see ``benchmarks.age``) and those that do not name the code that they
were measured with; the exit status is 1 if there are any.

    python -m benchmarks.stale
"""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.age import AGE, ROOT, code_digest

__all__ = ["main", "stale"]


def stale(root: Path = ROOT) -> dict[str, str]:
    """Return what is wrong with the age of each result that is not of the present code, by its path."""
    folder = root / "benchmarks" / "results"
    found = {}
    for file in sorted(file for file in folder.rglob("*") if file.is_file()):
        ages = [
            {name: text.decode() for name, text in age.groupdict().items()} for age in AGE.finditer(file.read_bytes())
        ]
        changed = {
            f"{age['program']} has changed since commit {age['commit']}"
            for age in ages
            if code_digest(age["program"], root) != age["code"]
        }
        if changed or not ages:
            found[file.relative_to(folder).as_posix()] = "; ".join(sorted(changed)) or "names no code"
    return found


def main() -> int:
    """Print one line for each result that is not of the present code; 1 if there are any."""
    found = stale()
    for name, reason in found.items():
        print(f"{name}: {reason}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
