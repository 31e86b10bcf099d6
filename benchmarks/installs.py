"""Does the wheel work on every Python supported, with oldest and newest dependencies? Writes results/installs.md.

For each Python found and for the oldest and newest versions that pyproject.toml allows (of which there are wheels), a
new environment gets the wheel; then, outside the checkout, without HOME and in the locale C, a path is planned for a
robot that moves in every direction, and drawn, and for a car, from Python, and one by the shell command. The code is
compiled without optimisation: what is asked is whether it compiles.

    python -m benchmarks.installs --python 3.11 --python 3.12 --python 3.13 --python 3.14   (needs uv and the Pythons)
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.machine import describe_machine, markdown_table

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PACKAGES = ("numpy", "scipy", "numba", "shapely", "scikit-learn", "networkx", "matplotlib", "typer", "ompl", "gtsam")
RESOLUTIONS = {"oldest": "lowest-direct", "newest": "highest"}

PROGRAM = """
import json, time
from importlib.metadata import version
begin = time.perf_counter()
import trailmark
imported = time.perf_counter() - begin
from trailmark import LandmarkPlanner, World, library
world = World.load(library.shipped_worlds()["office"])
query = world.query("door")
planner = LandmarkPlanner(world, seed=0)
result = planner.plan(query.start, query.goal, time_limit=2.0)
path = result.path
result.plot().get_figure().savefig("plan.png")
free = bool(planner.checker.motions_valid(path.states[:-1], path.states[1:]).all())
car = LandmarkPlanner(world, world.robot.steered(0.4), seed=0).plan(query.start, query.goal, time_limit=20.0)
print(json.dumps({"file": trailmark.__file__, "imported": imported, "free": free, "cost": path.cost, "car": car.status,
                  "versions": {name: version(name) for name in %r}}))
"""


def main() -> int:
    """Try them all and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", action="append", default=[], help="a version, or an interpreter's path")
    parser.add_argument("--dependencies", action="append", choices=list(RESOLUTIONS), help="one age only")
    options = parser.parse_args()
    uv = shutil.which("uv")
    if uv is None:
        sys.exit("uv is not there, allowed: pip install uv")
    rows, failed = [], False
    with tempfile.TemporaryDirectory(prefix="installs-") as folder:
        wheel = build(uv, Path(folder))
        for python in options.python or ["3.11", "3.12", "3.13"]:
            for age in options.dependencies or RESOLUTIONS:
                row = attempt(uv, wheel, Path(folder), python, age)
                failed |= row[2].startswith("FAILED")
                rows.append(row)
                print(" | ".join(row), flush=True)
    table = markdown_table(["Python", "dependencies", "outcome", "import [s]", "versions"], rows)
    (RESULTS / "installs.md").write_text(
        f"# Installations\n\n{__doc__.split('Writes')[0]}\n\n{table}\n\n{describe_machine()}\n"
    )
    return int(failed)


def build(uv: str, folder: Path) -> Path:
    """Return the wheel, made by way of the source distribution, as a packager would."""
    subprocess.run([uv, "build", "-q", "--sdist", "--out-dir", folder, ROOT], check=True)
    (source,) = folder.glob("*.tar.gz")
    subprocess.run([uv, "build", "-q", "--wheel", "--out-dir", folder, source], check=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def attempt(uv: str, wheel: Path, folder: Path, python: str, age: str) -> list[str]:
    """Return a row of the table: what became of one installation."""
    number = Path(python).name.removeprefix("python")
    home = folder / f"{number}-{age}"
    try:
        facts = json.loads(last(*run(uv, wheel, home, python, age)))
    except subprocess.CalledProcessError as error:
        said = [line for line in (error.stderr or "").strip().splitlines() if line.strip()] or ["nothing said"]
        missing = "no wheels" in (error.stderr or "") or "no version of" in (error.stderr or "")
        line = next((line.strip() for line in said if "no wheels" in line), said[-1].strip())
        return [number, age, f"not installable: {line[:160]}" if missing else f"FAILED: {line[:200]}", "", ""]
    finally:
        shutil.rmtree(home, ignore_errors=True)
    versions = ", ".join(f"{name} {facts['versions'][name]}" for name in PACKAGES)
    right = facts["free"] and facts["car"] == "solved" and str(home) in facts["file"]
    outcome = f"cost {facts['cost']:.2f} m, certified; car {facts['car']}" if right else f"FAILED: {facts}"
    return [number, age, outcome, f"{facts['imported']:.2f}", versions]


def run(uv: str, wheel: Path, home: Path, python: str, age: str) -> Iterator[str]:
    """Yield what the steps print, the program's line last."""
    own = home / "bin" / "python"
    # Lowest-direct looks at what is named directly, which a wheel's dependencies are not.
    wheels = ["--only-binary", ":all:", "--resolution", RESOLUTIONS[age], "-r", ROOT / "pyproject.toml"]
    # Nothing but what a container has: no HOME, no locale, no cache of the user's.
    bare = {"PATH": os.defpath, "LC_ALL": "C", "NUMBA_OPT": "0"}
    for command, environment in (
        ([uv, "venv", "-q", "--python", python, home], None),
        ([uv, "pip", "install", "-q", "--python", own, *wheels, wheel], None),
        ([own, "-I", "-c", PROGRAM % (PACKAGES,)], bare),
        ([home / "bin" / "trailmark", "plan", "office", "--json", "--output", home / "path.json"], bare),
        ([own, "-I", "-m", "trailmark", "worlds"], bare),
    ):
        done = subprocess.run(
            list(map(str, command)), capture_output=True, text=True, check=True, env=environment, cwd=home.parent
        )
        if "-c" in command:
            yield done.stdout


def last(*texts: str) -> str:
    """Return the last line of the last text."""
    return texts[-1].strip().splitlines()[-1]


if __name__ == "__main__":
    sys.exit(main())
