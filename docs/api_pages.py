"""The API reference: which names are public, a page for each part of the package, and the gallery's order."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, get_origin

if TYPE_CHECKING:
    from docutils.nodes import Element
    from sphinx.addnodes import pending_xref
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

PARTS = {
    "trailmark": "The names that most programs need.",
    "trailmark.world": "Estimates of obstacles and their risk; the shipped worlds.",
    "trailmark.shapes": "Discs, rectangles and polygons.",
    "trailmark.se2": "Configurations of the plane.",
    "trailmark.planning": "The planner and its settings.",
    "trailmark.trajectories": "Smooth paths and timed trajectories.",
    "trailmark.verify": "Is anybody's path free?",
    "trailmark.plotting": "Pictures, by matplotlib.",
    "trailmark.shown": "Layers of pictures.",
    "trailmark.formats": "Files that are read and written.",
    "trailmark.errors": "Exceptions.",
    "trailmark.collision": "Is a configuration free, how far is it from the obstacles, is a motion free?",
    "trailmark.motion": "Kinds of motion, all certified.",
    "trailmark.curves": "Dubins and Reeds-Shepp curves.",
    "trailmark.landmarks": "Samples, K-means, the relaxed problem; the published method.",
    "trailmark.roadmap": "Landmarks, edges, and the search among them.",
    "trailmark.estimation": "Filters, SLAM, scans, maps, risk, simulation and logs.",
    "trailmark.exploration": "A robot explores and maps an unknown world.",
    "trailmark.ompl_bridge": "trailmark's parts inside OMPL.",
}
"""What the reference has pages of, as one meets them. The other modules are parts of these, and may change."""

FIRST = (
    *(
        "World",
        "Robot",
        "Query",
        "Goal",
        "LandmarkPlanner",
        "PlanResult",
        "Path",
        "CurvePath",
        "check_path",
        "PathAudit",
    ),
    *("PathAuditor", "Disc", "Rectangle", "Polygon", "KeepOutZone", "CostZone", "OneWayZone", "SpeedZone", "Objective"),
)
"""What stands first on the first page, as one meets it."""

ORDER = (
    *("plan_path", "nav2_map", "many_queries", "objectives_and_goals", "park_car", "check_path", "smooth_trajectory"),
    *("changing_warehouse", "ros2_planner", "map_from_log", "explore_world", "published_method"),
    *("ompl_checker", "ompl_landmark_sampler", "ompl_benchmark", "benchmark_planners"),
)
"""Examples from the first steps to programs of one's own."""


def by_kind_of_use(file: str) -> tuple[int, str]:
    """Return a key by which sphinx-gallery sorts the examples."""
    stem = Path(file).stem
    return (ORDER.index(stem) if stem in ORDER else len(ORDER)), stem


@cache
def public_names() -> dict[str, list[str]]:
    """Return the public names of each part, each name in the first part that has it; a part's own order is kept."""
    seen: set[int] = set()
    found: dict[str, list[str]] = {}
    for part in PARTS:
        module = import_module(part)
        found[part] = []
        for name in module.__all__:
            value = getattr(module, name)
            # Numbers and strings may be equal without being the same thing.
            if isinstance(value, type) or callable(value):
                if id(value) in seen:
                    continue
                seen.add(id(value))
            found[part].append(name)
    return found


def write(folder: Path) -> None:
    """Write a page for each part into a folder, and leave alone what would not change."""
    folder.mkdir(exist_ok=True)
    for part, names in public_names().items():
        module = import_module(part)
        if part == "trailmark":
            names = [*FIRST, *(name for name in names if name not in FIRST)]
        lines = [part, "=" * len(part), "", PARTS[part], "", f".. currentmodule:: {part}", ""]
        if part != "trailmark":
            lines += [f".. automodule:: {part}", "   :no-members:", ""]
        for name in names:
            if name.startswith("__"):
                continue
            value = getattr(module, name)
            if get_origin(value) is not None:
                lines += [f".. py:data:: {name}", "", f"   ``{value}``".replace("numpy.", ""), ""]
                continue
            kind = "class" if isinstance(value, type) else "function" if callable(value) else "data"
            if kind == "class" and issubclass(value, Exception):
                kind = "exception"
            lines += [f".. auto{kind}:: {name}"]
            lines += ["   :members:"] if kind in ("class", "exception") else []
            lines += ["   :show-inheritance:"] if kind == "exception" else []
            lines += ["   :no-value:"] if kind == "data" else []
            lines += [""]
        page, text = folder / f"{part}.rst", "\n".join(lines)
        if not page.exists() or page.read_text() != text:
            page.write_text(text)


def write_commands(page: Path) -> None:
    """Write the page of all commands with their options, as their help says it."""
    import typer
    from typer.testing import CliRunner

    from trailmark.cli import app

    names = typer.main.get_command(app).commands  # type: ignore[attr-defined]  # it is a group
    lines = ["# Commands", "", "The help of each command, `trailmark COMMAND --help`.", ""]
    for name in sorted(names):
        told = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}).output
        lines += [f"## {name}", "", "```text", told.strip(), "```", ""]
    text = "\n".join(lines)
    if not page.exists() or page.read_text() != text:
        page.write_text(text)


def make_readable(app: object, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Change a docstring's lines so that Sphinx reads what people read.

    Bars around absolute values and norms are no substitutions, and what stands before an attribute's first colon is
    no type.
    """
    lines[:] = ["``".join(t if i % 2 else t.replace("|", r"\|") for i, t in enumerate(s.split("``"))) for s in lines]
    if what in ("attribute", "data", "property") and lines and ": " in lines[0]:
        head, rest = lines[0].split(": ", 1)
        lines[:1] = [f"{head}:", rest]


def found_elsewhere(app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: Element) -> Element | None:
    """Lead from the module in which something is defined to where it is public and described."""
    target = str(node.get("reftarget", ""))
    if node.get("refdomain") != "py" or not target.startswith("trailmark."):
        return None
    words = target.split(".")
    for part, names in public_names().items():
        for i, word in enumerate(words):
            if word in names and (i == len(words) - 1 or word[0].isupper()):
                name = ".".join([part, *words[i:]])
                domain = env.get_domain("py")
                return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", name, node, shown)
    return None
