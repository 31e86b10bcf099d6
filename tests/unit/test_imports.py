"""What is loaded when trailmark is imported: nothing heavy, and every public name when it is asked for.

Which part may import which is held by import-linter's contracts in pyproject.toml.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "src" / "trailmark"

HEAVY = ("scipy", "sklearn", "numba", "shapely", "matplotlib", "networkx", "pydantic", "fcl", "ompl", "PIL", "filterpy")


def modules_after(code: str) -> set[str]:
    """Return the top-level names of all modules loaded in a fresh interpreter after it ran ``code``."""
    program = f"{code}\nimport json, sys\nprint(json.dumps(sorted({{name.split('.')[0] for name in sys.modules}})))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    return set(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.slow
@pytest.mark.parametrize("code", ["import trailmark", "import trailmark; dir(trailmark)", "import trailmark.cli"])
def test_importing_is_light(code: str) -> None:
    assert modules_after(code).isdisjoint(HEAVY)


@pytest.mark.slow
def test_light_parts_stay_light() -> None:
    # What the shell needs to read a world's file name and a robot's size: nothing that compiles or plots.
    code = "from trailmark import Robot, Path, World, TrailmarkError, Query, Disc\nfrom trailmark import se2"
    assert modules_after(code).isdisjoint(HEAVY)


def test_every_public_name_is_there() -> None:
    import trailmark

    for name in trailmark.__all__:
        assert getattr(trailmark, name) is not None
    parts = {item.stem for item in SOURCE.iterdir() if item.suffix == ".py" or (item / "__init__.py").exists()}
    assert set(dir(trailmark)) == {part for part in parts if not part.startswith("__")}.union(trailmark.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Planner'"):
        _ = trailmark.Planner


@pytest.mark.slow
def test_submodules_are_loaded_when_they_are_first_named() -> None:
    program = (
        "import trailmark; print(trailmark.planning.settings.PlannerSettings.__name__, trailmark.shapes.Disc.__name__)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == ["PlannerSettings", "Disc"]
