"""The rule of dependence: which part may import which, and what must not be loaded early (see CONTRIBUTING.md)."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import networkx
import pytest

SOURCE = Path(__file__).resolve().parents[1] / "src" / "trailmark"

LAYERS: tuple[frozenset[str], ...] = (
    frozenset({"compiled"}),
    frozenset({"clock", "colours", "errors", "heading", "heap", "lock"}),
    frozenset({"library", "sorting"}),
    frozenset({"arguments", "shown"}),
    frozenset({"layers"}),
    frozenset({"checked"}),
    frozenset({"nearest", "se2", "shapes"}),
    frozenset({"path", "robot", "objective", "triangles"}),
    frozenset({"estimates", "goals", "lazy_shapes", "moving", "zones"}),
    frozenset({"changes", "query"}),
    frozenset({"edits"}),
    frozenset({"world", "formats"}),
    frozenset({"keep_out"}),
    frozenset({"curves"}),
    frozenset({"collision", "estimation"}),
    frozenset({"motion"}),
    frozenset({"trajectories"}),
    frozenset({"landmarks"}),
    frozenset({"roadmap"}),
    frozenset({"planning"}),
    frozenset({"audit"}),
    frozenset({"exploration", "ompl_bridge"}),
    frozenset({"plotting"}),
    frozenset({"benchmark"}),
    frozenset({"live"}),
    frozenset({"cli"}),
)
"""From the bottom up: a part imports from layers below its own, and from its own layer only as PEERS allows."""

PEERS = {
    ("se2", "shapes"),
    ("shapes", "se2"),
    ("formats", "world"),
    # World.load, World.save and Robot.load hand over to the readers when they are called.
    ("world", "formats"),
    ("robot", "formats"),
    # Path.smooth and Path.timed hand over when they are called.
    ("path", "trajectories"),
    # Path.save and Path.load likewise.
    ("path", "formats"),
    ("path", "collision"),
    ("path", "robot"),
    ("path", "world"),
    # What is charged by default depends on how a robot moves.
    ("objective", "robot"),
    ("exploration", "ompl_bridge"),
    # What shows itself hands over to those who draw it when it is shown.
    ("shown", "plotting"),
}
"""Imports within one layer or upwards, by hand-over: collision and estimation do not know each other."""

HOMES = {"fcl": {"collision/fcl_scene.py"}, "ompl": {"ompl_bridge"}, "matplotlib": {"plotting"}}
"""Libraries that only one file or one part may import."""

TOP_LEVEL = {"__init__", "__main__"}
"""The package's own __init__ names all public classes, lazily; __main__ calls the shell command."""

HEAVY = ("scipy", "sklearn", "numba", "shapely", "matplotlib", "networkx", "pydantic", "fcl", "ompl", "PIL", "filterpy")


def part_of(file: Path) -> str:
    """Return the first name below trailmark: ``world`` for world.py, ``collision`` for all of its files."""
    relative = file.relative_to(SOURCE)
    return relative.parts[0].removesuffix(".py")


def imported_modules(text: str, package: list[str]) -> list[tuple[str, int]]:
    """Return all modules that a file of ``package`` imports, anywhere in it, as absolute names with their lines.

    Imports for type checkers only count too: a part that needs another's types depends on it.
    """
    tree = ast.parse(text)
    # Most nodes are expressions, which import nothing but by a function with a name of its own.
    nodes = ast.walk(tree) if re.search(r"import_module|__import__", text) else statements_of(tree)
    return [found for node in nodes for found in modules_of(node, package)]


def statements_of(tree: ast.Module) -> list[ast.AST]:
    """Return all statements of a file, and what has statements within it."""
    found: list[ast.AST] = [tree]
    for node in found:  # grows
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            found += getattr(node, part, [])
    return found


def modules_of(node: ast.AST, package: list[str]) -> list[tuple[str, int]]:
    """Return the modules that a statement or a call imports, without those within it."""
    found: list[tuple[str, int]] = []
    if isinstance(node, ast.Import):
        found += [(alias.name, node.lineno) for alias in node.names]
    elif isinstance(node, ast.ImportFrom):
        base = node.module or ""
        if node.level:
            parents = package[: len(package) - node.level + 1]
            base = ".".join([*parents, base] if base else parents)
        found += [(base, node.lineno), *((f"{base}.{alias.name}", node.lineno) for alias in node.names)]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
        name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
        first = node.args[0] if node.args else None
        if name in ("import_module", "__import__") and isinstance(first, ast.Constant):
            found.append((str(first.value), node.lineno))
    return found


FILES = [file for file in sorted(SOURCE.rglob("*.py")) if part_of(file) not in TOP_LEVEL]
LAYER_OF = {part: i for i, layer in enumerate(LAYERS) for part in layer}


def test_every_part_has_its_layer() -> None:
    assert {part_of(file) for file in FILES} <= set(LAYER_OF)


def forbidden_imports(file: Path) -> list[str]:
    """Return what a file imports although it lies above it or beside it, a line each."""
    own, relative = part_of(file), file.relative_to(SOURCE)
    package, found = ["trailmark", *relative.parts[:-1]], []
    for module, line in imported_modules(file.read_text(encoding="utf-8"), package):
        names = module.split(".")
        where = f"{relative}:{line}: {own} imports {module}"
        if names[0] == "trailmark" and len(names) > 1 and names[1] in LAYER_OF and names[1] != own:
            if LAYER_OF[names[1]] >= LAYER_OF[own] and (own, names[1]) not in PEERS:
                found.append(f"{where}, which lies above it or beside it")
            if names[1] == "plotting" and own not in ("benchmark", "cli", "shown"):
                found.append(f"{where}, which only benchmark and cli may use")
        homes = HOMES.get(names[0])
        if homes is not None and relative.as_posix() not in homes and own not in homes:
            found.append(f"{where}, allowed: {sorted(homes)}")
    return found


# One test for all files: a test for each took longer to report than to run.
@pytest.mark.slow
def test_a_file_imports_only_what_lies_below_it() -> None:
    assert len(FILES) > 100
    assert [line for file in FILES for line in forbidden_imports(file)] == []


def imports_when_loaded(file: Path) -> set[Path]:
    """Return the files of the package that a file imports while it is itself imported."""
    package = ["trailmark", *file.relative_to(SOURCE).parts[:-1]]
    nodes = list(ast.parse(file.read_text(encoding="utf-8")).body)
    found: set[Path] = set()
    for node in nodes:  # grows by the blocks of conditions, but for those that only type checkers run
        if isinstance(node, ast.If) and ast.unparse(node.test) != "TYPE_CHECKING":
            nodes += [*node.body, *node.orelse]
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names = [module.split(".")[1:] for module, _ in modules_of(node, package)]
            paths = [{SOURCE.joinpath(*n).with_suffix(".py"), SOURCE.joinpath(*n, "__init__.py")} for n in names if n]
            there = [path for path in sorted(set().union(*paths)) if path.exists() and path.is_relative_to(SOURCE)]
            # ``from package import module`` asks for the module; the package around it is being imported already.
            found |= {path for path in there if path.name != "__init__.py" or len(there) == 1}
    return found - {file}


@pytest.mark.slow
def test_no_files_import_each_other_in_a_circle() -> None:
    graph = networkx.DiGraph((file, imported) for file in FILES for imported in imports_when_loaded(file))
    assert graph.number_of_edges() > len(FILES)
    circles = [[str(file.relative_to(SOURCE)) for file in circle] for circle in networkx.simple_cycles(graph)]
    assert circles == []


def test_the_public_names_are_imported_when_asked_for() -> None:
    tree = ast.parse((SOURCE / "__init__.py").read_text(encoding="utf-8"))
    at_once = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    assert {getattr(node, "module", None) for node in at_once} <= {"__future__", "functools", "importlib", "typing"}


def test_the_reader_of_imports_sees_them_all() -> None:
    text = """
import fcl.x
from .. import world
from ..planning.result import A
if TYPE_CHECKING:
    from trailmark.benchmark import B
def f():
    from trailmark import cli
    import_module("trailmark.exploration")
"""
    found = {name for name, _ in imported_modules(text, ["trailmark", "collision"])}
    assert {"fcl.x", "trailmark.world", "trailmark.planning.result", "trailmark.benchmark"} <= found
    assert {"trailmark.cli", "trailmark.exploration"} <= found


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
    parts = {part_of(file) for file in FILES}
    assert set(dir(trailmark)) == parts.union(trailmark.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Planner'"):
        _ = trailmark.Planner


@pytest.mark.slow
def test_submodules_are_loaded_when_they_are_first_named() -> None:
    program = (
        "import trailmark; print(trailmark.planning.settings.PlannerSettings.__name__, trailmark.shapes.Disc.__name__)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == ["PlannerSettings", "Disc"]
