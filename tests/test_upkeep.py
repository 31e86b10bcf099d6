"""What ``benchmarks.upkeep`` counts, and which command it times."""

from __future__ import annotations

from pathlib import Path

import pytest
from benchmarks.upkeep import ROOT, command_of_tests, lines_by_part


def test_lines_are_counted_by_package(tmp_path: Path) -> None:
    """Modules beside the packages count together."""
    for name, lines in {"a.py": 3, "b.py": 4, "maps/__init__.py": 0, "maps/grids/cells.py": 9}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x = 1\n" * lines)
    parts, longest = lines_by_part(tmp_path)
    assert parts == {"all of src": (4, 16), "maps": (2, 9), "modules in no package": (2, 7)}
    assert longest == ("maps/grids/cells.py", 9)


def test_the_command_is_the_readmes() -> None:
    """In two halves: an environment is made, then the tests run."""
    made, tests = command_of_tests((ROOT / "README.md").read_text(encoding="utf-8"))
    assert made.startswith("python3 -m venv .venv-test && ")
    assert tests.startswith(".venv-test/bin/python -m pytest ")


def test_a_readme_without_one_is_refused() -> None:
    """Rather than timing something else."""
    with pytest.raises(ValueError, match="expected a command"):
        command_of_tests("## Tests\n\nNone.\n")
