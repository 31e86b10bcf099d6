"""Mutation tests of the kernels that certify: does every change that lets a collision through get noticed?

    NUMBA_DISABLE_JIT=1 python -m benchmarks.mutants [--size 20] [--only kernels] [--sample 300] [--record FILE.jsonl]
    python -m benchmarks.mutants --table FILE.jsonl

Each mutant is one change of one expression or statement of a module, run as plain Python in a process of its own on the
cases of :mod:`benchmarks.mutant_cases`. What became of it:

* accepts: it let a collision through, and that was noticed: killed;
* refuses: it accepts no collision but refuses what is free, or a clearance or a bound on it is wrong: killed;
* error, slow: it raised, or took more than a minute of the processor's time: killed;
* undecided: it leaves more to FCL or to the exact distances than before, and answers the same: it costs time alone;
* same: it answers as before in all cases. These are the ones to look at.
"""

from __future__ import annotations

import argparse
import ast
import copy
import hashlib
import json
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import shapely

from benchmarks.age import describe_code
from benchmarks.mutant_cases import Case, cases
from trailmark.world import Robot

__all__ = ["Mutant", "main", "mutants_of", "table"]

SOURCE = Path(__file__).resolve().parents[1] / "src" / "trailmark" / "collision"

MODULES = ("kernels", "certify", "distances", "field", "footprint", "obstacles")

LEFT_OUT = {
    # Nothing is certified by these: slopes and sizes for searches, room for results, questions to people.
    "field": {"interpolated"},
    "distances": {"point_depth"},
    "obstacles": {"cell_size_for"},
}
"""Functions that are not mutated."""

SECONDS = 60
"""Of the processor's time for one mutant; one that takes longer than that is noticed."""

SWAPS: dict[type, list[type]] = {
    ast.Lt: [ast.LtE, ast.GtE],
    ast.LtE: [ast.Lt, ast.Gt],
    ast.Gt: [ast.GtE, ast.LtE],
    ast.GtE: [ast.Gt, ast.Lt],
    ast.Eq: [ast.NotEq],
    ast.NotEq: [ast.Eq],
    ast.Add: [ast.Sub],
    ast.Sub: [ast.Add],
    ast.Mult: [ast.Div],
    ast.Div: [ast.Mult],
    ast.And: [ast.Or],
    ast.Or: [ast.And],
}
NAMES = {"min": "max", "max": "min", "floor": "ceil", "cos": "sin", "sin": "cos", "minimum": "maximum", "ceil": "floor"}


class Mutant:
    """One change.

    Attributes:
        module: name of the module.
        function: that it is in.
        line: of the source.
        change: in words.
        tree: gives the module's syntax tree with the change; copying a tree takes much longer than naming the change.
        key: the same as long as the function's code is, wherever it moves to.
    """

    def __init__(
        self, module: str, function: str, line: int, change: str, tree: Callable[[], ast.Module], key: str
    ) -> None:
        self.module, self.function, self.line, self.change = module, function, line, change
        self.tree, self.key = tree, key


def mutants_of(module: str) -> Iterator[Mutant]:
    """Yield all mutants of a module."""
    source = (SOURCE / f"{module}.py").read_text(encoding="utf-8")
    tree = ast.parse(source)
    for function in [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]:
        if function.name in LEFT_OUT.get(module, set()):
            continue
        body = hashlib.sha256(" ".join(ast.unparse(part) for part in function.body if not _is_text(part)).encode())
        for index, node in enumerate(_nodes(function)):
            for number, (change, _) in enumerate(_changes(node)):
                key = f"{module}.{function.name} {body.hexdigest()[:16]} {index} {number}"
                made = partial(_mutated, tree, function, index, number)
                yield Mutant(module, function.name, getattr(node, "lineno", 0), change, made, key)


def _mutated(tree: ast.Module, function: ast.FunctionDef, index: int, number: int) -> ast.Module:
    mutated = copy.deepcopy(tree)
    twin = next(
        other
        for other in ast.walk(mutated)
        if isinstance(other, ast.FunctionDef) and (other.name, other.lineno) == (function.name, function.lineno)
    )
    target = _nodes(twin)[index]
    _, replacement = list(_changes(target))[number]
    _Replace(target, replacement).visit(mutated)
    ast.fix_missing_locations(mutated)
    return mutated


def _nodes(function: ast.FunctionDef) -> list[ast.AST]:
    """Return what may change in a function: all of its body but the docstring."""
    return [node for statement in function.body for node in ast.walk(statement) if not _is_text(statement)]


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.AST | None]]:
    """Yield what a node can be changed into, in words and as a new node; None drops a statement."""
    was = ast.unparse(node)[:60] if isinstance(node, ast.expr | ast.stmt) else ""
    if isinstance(node, ast.Compare):
        for i, operator in enumerate(node.ops):
            for other in SWAPS.get(type(operator), []):
                new = copy.deepcopy(node)
                new.ops[i] = other()
                yield f"{was} -> {ast.unparse(new)[:60]}", new
    elif isinstance(node, ast.BinOp | ast.BoolOp | ast.AugAssign):
        for other in SWAPS.get(type(node.op), []):
            swapped = copy.deepcopy(node)
            swapped.op = other()
            yield f"{was} -> {ast.unparse(swapped)[:60]}", swapped
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        number = float(node.value) if isinstance(node.value, int | float) else 0.0
        for value in (0, 1, 2) if isinstance(node.value, int) else (0.0, 0.5 * number, 2.0 * number):
            if value != node.value:
                yield f"{was} -> {value}", ast.Constant(value)
    elif isinstance(node, ast.UnaryOp):
        yield f"{was} -> {ast.unparse(node.operand)[:60]}", copy.deepcopy(node.operand)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in NAMES:
        call = copy.deepcopy(node)
        call.func = ast.Name(NAMES[node.func.id], ast.Load())
        yield f"{was} -> {NAMES[node.func.id]}(...)", call
    elif isinstance(node, ast.Name) and node.id in ("FREE", "BLOCKED", "UNDECIDED") and isinstance(node.ctx, ast.Load):
        for name in ("FREE", "BLOCKED", "UNDECIDED"):
            if name != node.id:
                yield f"{was} -> {name}", ast.Name(name, ast.Load())
    if isinstance(node, ast.If | ast.While):
        for value in (True, False):
            if not (isinstance(node, ast.While) and value):
                branch = copy.deepcopy(node)
                branch.test = ast.Constant(value)
                yield f"{type(node).__name__.lower()} {ast.unparse(node.test)[:60]} -> {value}", branch
    if isinstance(node, ast.Assign | ast.AugAssign | ast.Return | ast.Continue | ast.Break):
        yield f"without {was}", None


class _Replace(ast.NodeTransformer):
    """Puts one node in the place of another."""

    def __init__(self, target: ast.AST, replacement: ast.AST | None) -> None:
        self.target, self.replacement = target, ast.Pass() if replacement is None else replacement

    def visit(self, node: ast.AST) -> Any:
        return self.replacement if node is self.target else super().generic_visit(node)


class _Mutated(MetaPathFinder, Loader):
    """Loads one module from a changed syntax tree."""

    def __init__(self, mutant: Mutant) -> None:
        self.name, self.tree = f"trailmark.collision.{mutant.module}", mutant.tree()

    def find_spec(self, fullname: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:
        return spec_from_loader(fullname, self) if fullname == self.name else None

    def exec_module(self, module: ModuleType) -> None:
        # The file's own name: the cache of compiled kernels asks for it.
        path = str(SOURCE / f"{self.name.rsplit('.', 1)[1]}.py")
        exec(compile(self.tree, path, "exec"), module.__dict__)  # noqa: S102  # that is what a mutant is


def _kernel_answers(checker: Any, case: Case) -> tuple[int, int]:
    """Return how many states and motions the kernels alone leave undecided."""
    from trailmark.collision import kernels

    q = np.concatenate([case.hit, case.free])
    arrays = (checker.grid, checker.field, checker.footprint)
    open_states = (kernels.states_free(*arrays, q) == kernels.UNDECIDED).sum()
    open_states += (kernels.field_states(checker.field, checker.footprint, q) == kernels.UNDECIDED).sum()
    motions = np.concatenate([case.bad_motions, case.good_motions])
    answers = checker.motions_by_field(motions[:, 0].copy(), motions[:, 1].copy())
    return int(open_states), int((answers == kernels.UNDECIDED).sum())


def _accepts_in_haste(checker: Any, a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether a motion that collides is accepted because the budget is used up."""
    from trailmark.collision import certify, kernels

    placed, queue = kernels.workspace(checker.footprint), certify.new_queue()
    arrays = (checker.grid, checker.field, checker.footprint, placed, queue)
    return any(
        certify.motion(*arrays, a[i], b[i], exact, budget) == kernels.FREE
        for i in range(min(len(a), 20))
        for exact in (True, False)
        for budget in (1, 2, 5)
    )


def _footprint_fault(robot: Robot) -> tuple[str, str] | None:
    """Return what a footprint's parts would do wrong, ``accepts`` or ``refuses``, and which; None if they are right."""
    from trailmark.collision import footprint as module

    made, outline = module.build_footprint(robot), robot.outline.rings()[0]
    region = shapely.Polygon(outline)
    edge = shapely.segmentize(region.exterior, float(region.exterior.length) / 500.0)
    points = shapely.get_coordinates(edge)
    inside = points[:, None] + np.linspace(0.0, 1.0, 20)[:, None] * (made.inner[0, :2] - points[:, None])
    inside = inside.reshape(-1, 2)
    inside = np.vstack([points, inside[shapely.contains_xy(region, *inside.T)]])
    away = np.hypot(*(inside[:, None] - made.cover[:, :2]).transpose(2, 0, 1)) - made.cover[:, 2]
    if (away.min(axis=1) > 1e-12).any():
        return "accepts", "a point that no disc covers"
    centres = shapely.points(made.inner[:, :2])
    if (
        not shapely.contains(region, centres).all()
        or (shapely.distance(centres, edge) < made.inner[:, 2] - 1e-12).any()
    ):
        return "refuses", "an inner disc that sticks out"
    core = shapely.Polygon(made.core)
    if len(made.core) and shapely.distance(shapely.points(made.core), region.exterior).min() < 2e-7:
        return "refuses", "a core that touches the edge"
    if len(made.core) and shapely.distance(shapely.points(points), core).max() > made.core_gap * (1.0 + 1e-9):
        return "accepts", "a point farther from the core than is said"
    parts = module.overlap_core(np.array(outline))
    if not parts or shapely.distance(shapely.points(points), shapely.union_all(parts)).max() > 1.001e-7:
        return "accepts", "a point of the footprint that may meet an obstacle"
    if shapely.distance(shapely.union_all(parts), region.exterior) <= 0.0:
        return "refuses", "an edge that may not touch"
    return None


FOOTPRINTS = {
    "square": Robot.polygon([(-1, -1), (1, -1), (1, 1), (-1, 1)]),
    "long": Robot.rectangle(3.0, 0.2),
    "L": Robot.polygon([(0, 0), (2, 0), (2, 0.5), (0.5, 0.5), (0.5, 2), (0, 2)]),
    "needle": Robot.polygon([(-1, -0.02), (1, 0), (-1, 0.02)]),
    "dart": Robot.polygon([(-1, -1), (2, 0), (-1, 1), (-0.2, 0)]),
    "notch": Robot.polygon([(-1, -1), (1, -1), (1, 1), (0.01, 1), (0, -0.5), (-0.01, 1), (-1, 1)]),
    "small": Robot.rectangle(1e-3, 7e-4),
}
"""Robots whose footprints' parts are looked at by themselves: too thin for cases, or wrong by less than 1e-7 m."""


def verdict(made: list[Case]) -> tuple[str, str, list[tuple[int, int]]]:
    """Return what the code as it is imported now does: ``accepts``, ``refuses`` or ``same``, where, and counts."""
    from trailmark.collision import StateChecker, kernels
    from trailmark.curves import Steering
    from trailmark.motion import CurveMotion

    checkers = [StateChecker(case.world, case.robot, cell=case.cell) for case in made]
    for name, robot in FOOTPRINTS.items():
        fault = _footprint_fault(robot)
        if fault is not None and fault[0] == "accepts":
            return "accepts", f"{name}: {fault[1]}", []
    cars = [CurveMotion(checker, Steering(case.radius)) for checker, case in zip(checkers, made, strict=True)]
    for checker, car, case in zip(checkers, cars, made, strict=True):
        if checker.valid(case.hit).any():
            return "accepts", f"{case.name}: state", []
        if (kernels.field_states(checker.field, checker.footprint, case.hit) == kernels.FREE).any():
            return "accepts", f"{case.name}: state by the field", []
        if checker.clearance(case.hit).max() > case.robot.clearance + 1e-8:
            return "accepts", f"{case.name}: clearance on overlap", []
        if (checker.clearance(case.free) - case.clearances).max() > 1e-8:
            return "accepts", f"{case.name}: clearance too large", []
        a, b = case.bad_motions[:, 0].copy(), case.bad_motions[:, 1].copy()
        if checker.motions_valid(a, b).any() or checker.motions_between_valid(a, b).any():
            return "accepts", f"{case.name}: motion", []
        if (checker.motions_by_field(a, b) == kernels.FREE).any():
            return "accepts", f"{case.name}: motion by the field", []
        if _accepts_in_haste(checker, a, b):
            return "accepts", f"{case.name}: motion with a small budget", []
        if car.motions_between_valid(case.bad_curves[:, 0].copy(), case.bad_curves[:, 1].copy()).any():
            return "accepts", f"{case.name}: curve", []
    for name, robot in FOOTPRINTS.items():
        fault = _footprint_fault(robot)
        if fault is not None:
            return "refuses", f"{name}: {fault[1]}", []
    counts = []
    for checker, car, case in zip(checkers, cars, made, strict=True):
        if not checker.valid(case.free).all():
            return "refuses", f"{case.name}: state", []
        if (checker.clearance(case.free) - case.clearances).min() < -1e-8:
            return "refuses", f"{case.name}: clearance too small", []
        if (kernels.field_states(checker.field, checker.footprint, case.free) == kernels.BLOCKED).any():
            return "refuses", f"{case.name}: state by the field", []
        if not checker.motions_valid(case.good_motions[:, 0].copy(), case.good_motions[:, 1].copy()).all():
            return "refuses", f"{case.name}: motion", []
        answers = checker.motions_by_field(case.good_motions[:, 0].copy(), case.good_motions[:, 1].copy())
        if (answers == kernels.BLOCKED).any():
            return "refuses", f"{case.name}: motion by the field", []
        if not car.motions_between_valid(case.good_curves[:, 0].copy(), case.good_curves[:, 1].copy()).all():
            return "refuses", f"{case.name}: curve", []
        counts.append(_kernel_answers(checker, case))
    return "same", "", counts


def _judge(mutant: Mutant, made: list[Case], before: list[tuple[int, int]]) -> tuple[str, str]:
    """Return what becomes of a mutant and where; run it in a process that ends afterwards."""
    for name in [name for name in sys.modules if name.startswith(("trailmark.collision", "trailmark.motion"))]:
        del sys.modules[name]
    sys.meta_path.insert(0, _Mutated(mutant))
    # Not by the clock: other programs may keep the processor busy.
    signal.signal(signal.SIGPROF, _too_slow)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        with np.errstate(all="ignore"):
            found, where, counts = verdict(made)
    except _Slow:
        return "slow", ""
    except Exception as error:
        return "error", type(error).__name__
    if found == "same" and counts != before:
        more = sum(sum(pair) for pair in counts) > sum(sum(pair) for pair in before)
        return ("undecided", "") if more else ("decided", "fewer left undecided")
    return found, where


class _Slow(Exception):  # noqa: N818  # it is no error
    pass


def _too_slow(number: int, frame: Any) -> None:
    raise _Slow


def _run(mutant: Mutant, made: list[Case], before: list[tuple[int, int]]) -> tuple[str, str]:
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        # A changed kernel may print warnings without end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        answer = _judge(mutant, made, before)
        with os.fdopen(writer, "w") as pipe:
            json.dump(answer, pipe)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        text = pipe.read()
    _, status = os.waitpid(child, 0)
    return tuple(json.loads(text)) if status == 0 and text else ("error", f"process ended with {status}")


def _rows(paths: list[Path]) -> list[list[Any]]:
    return [json.loads(line) for path in paths for line in path.read_text(encoding="utf-8").splitlines()]


def table(rows: list[list[Any]]) -> str:
    """Return the results as Markdown: counts by module, then those that no case told from the code as it is."""
    lines = [
        "| module | mutants | accepts: noticed | refuses: noticed | raises, hangs | costs time | same in all cases |",
        "|---|---|---|---|---|---|---|",
    ]
    for module in MODULES:
        found = Counter(row[4] for row in rows if row[0] == module)
        if found:
            lines.append(
                f"| {module} | {found.total()} | {found['accepts']} | {found['refuses']} | "
                f"{found['error'] + found['slow']} | {found['undecided'] + found['decided']} | {found['same']} |"
            )
    lines += ["", "Same in all cases:", ""]
    lines += [f"- `{row[0]}.{row[1]}`, line {row[2]}: `{row[3]}`" for row in rows if row[4] == "same"]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run all mutants, or print the table of their results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=40, help="colliding motions in each scene")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=MODULES, action="append", help="modules; all by default")
    parser.add_argument(
        "--again", action="store_true", help="those that no case told from the code as it is, once more"
    )
    parser.add_argument("--case", action="append", help="judge by these cases alone, such as new ones; may be repeated")
    parser.add_argument(
        "--sample", type=int, metavar="N", help="N of them drawn at random; a larger N draws the same and more"
    )
    parser.add_argument("--line", type=int, action="append", help="mutants of these lines only")
    parser.add_argument(
        "--record", type=Path, default=Path("mutants.jsonl"), help="results as they come; those in it stay"
    )
    parser.add_argument("--table", type=Path, nargs="+", help="print the table of these results instead")
    options = parser.parse_args(arguments)
    if options.table:
        rows = _rows(options.table)
        print(table(rows), *sorted({str(row[-1]) for row in rows}), sep="\n\n")
        return 0
    if os.environ.get("NUMBA_DISABLE_JIT") != "1":
        parser.error("NUMBA_DISABLE_JIT is not 1: mutants run as plain Python")
    made = cases(options.seed, options.size)
    if options.case:
        names = {case.name for case in made}
        if unknown := set(options.case) - names:
            parser.error(f"expected --case to be one of {sorted(names)}, got {sorted(unknown)}")
        made = [case for case in made if case.name in options.case]
    found, where, before = verdict(made)
    if found != "same":
        parser.error(f"the code as it is {found}: {where}")
    rows = _rows([options.record]) if options.record.exists() else []
    if options.again:
        rows = [row for row in rows if row[4] != "same" or row[0] not in (options.only or MODULES)]
        options.record.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    done = {row[6] for row in rows}
    tally: Counter[tuple[str, str]] = Counter()
    begin = time.perf_counter()
    modules = options.only or MODULES
    asked = [
        mutant for module in modules for mutant in mutants_of(module) if not options.line or mutant.line in options.line
    ]
    if options.sample:
        asked = [asked[i] for i in np.random.default_rng(options.seed).permutation(len(asked))[: options.sample]]
    with options.record.open("a", encoding="utf-8") as record:
        for mutant in asked:
            if mutant.key in done:
                continue
            answer = _run(mutant, made, before)
            tally[mutant.module, answer[0]] += 1
            row = [mutant.module, mutant.function, mutant.line, mutant.change, *answer, mutant.key, describe_code()]
            record.write(json.dumps(row) + "\n")
            record.flush()
    for module in modules:
        print(module, {what: n for (name, what), n in tally.items() if name == module})
    print(f"{sum(tally.values())} mutants in {time.perf_counter() - begin:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
