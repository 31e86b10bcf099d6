"""Which code a result was measured with: the commit, and a digest of what the program depends on.

The digest is of the syntax trees without comments, docstrings and the words of errors that are raised, so that only
code that may behave differently counts. A program depends on the files of ``benchmarks`` and ``src/trailmark`` that it
imports, and that those import. What a package imports counts where the package itself is asked for, not where one of
its modules is. Worlds, data, installed packages and what is not Python do not count.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

__all__ = ["AGE", "ROOT", "WITH_CHANGES", "changed_files", "code_digest", "dependencies", "describe_code"]

ROOT = Path(__file__).resolve().parents[1]

AGE = re.compile(rb"measured by (?P<program>[\w.]+) at commit (?P<commit>[\w ]+), code (?P<code>[0-9a-f]{16})")
"""Finds what :func:`describe_code` wrote, in a file of any format."""

MODULE = re.compile(r"trailmark(\.\w+)+")
DESCRIBING = {"benchmarks.age", "benchmarks.machine"}
"""Modules that describe a measurement and have no influence on it."""

ON_REQUEST = {
    ("trailmark.world", "trailmark.live"),
    ("trailmark.shown", "trailmark.sketch"),
    ("trailmark.shown", "trailmark.plotting"),
    ("trailmark.path", "trailmark.trajectories"),
}
"""Imports that are made when something shows itself at a prompt or in a notebook, which nothing that is measured does,
and when a path is smoothed or timed: programs that ask for this import it themselves."""

WITH_CHANGES = " with changes"
"""Follows a commit whose code was not the one measured."""

STARTED = time.time()


@cache
def describe_code(program: str | None = None, root: Path = ROOT) -> str:
    """Return ``measured by PROGRAM at commit COMMIT, code DIGEST``.

    Args:
        program: module name of the benchmark program; the running one by default.
        root: the checkout.
    """
    program = program or _running_program(root)
    if program is None:
        return f"commit {_commit(root)}"
    # Nobody knows which code a process has loaded from files that changed after it began.
    changed = [file for file in dependencies(program, root).values() if file.stat().st_mtime > STARTED]
    code = "changed meanwhile" if changed else code_digest(program, root)
    return f"measured by {program} at commit {_commit(root)}, code {code}"


@cache
def code_digest(program: str, root: Path = ROOT) -> str:
    """Return 16 hexadecimal digits that change with the code that ``program`` depends on."""
    digest = hashlib.sha256()
    for name, file in sorted(dependencies(program, root).items()):
        digest.update(f"{name} {_code_of(file.read_text(encoding='utf-8'))}\n".encode())
    return digest.hexdigest()[:16]


def dependencies(program: str, root: Path = ROOT) -> dict[str, Path]:
    """Return the modules of ``benchmarks`` and ``trailmark`` that a program depends on, with their files.

    Imports are read from the source, wherever they stand, also in texts that are programs of their own. ``import
    trailmark`` asks for all of it; a program that imports none of it runs the shell command, and depends on all too.
    """
    found: dict[str, Path] = {}
    waiting = [program, f"{program}.__main__"]
    while waiting:
        name, file = _module(waiting.pop(), root)
        if file is None or name in found or name in DESCRIBING:
            continue
        found[name] = file
        waiting += [
            imported
            for imported in _imports_of(file.read_text(encoding="utf-8"))
            if (name, ".".join(imported.split(".")[:2])) not in ON_REQUEST
        ]
    source = root / "src"
    if "trailmark" in found or not any(name.startswith("trailmark") for name in found):
        for file in source.rglob("*.py"):
            found[".".join(file.relative_to(source).with_suffix("").parts).removesuffix(".__init__")] = file
    return found


def changed_files(program: str, commit: str, root: Path = ROOT) -> list[str] | None:
    """Return the files that ``program`` depends on whose code is not that of a commit, as paths from ``root``.

    None is returned where git does not know the commit, as in a shallow clone.
    """
    try:
        changed = set(_files_changed_since(commit, root))
    except subprocess.CalledProcessError:
        return None
    files = {file.relative_to(root).as_posix() for file in dependencies(program, root).values()}
    return sorted(file for file in files & changed if _code_differs(commit, file, root))


@cache
def _files_changed_since(commit: str, root: Path) -> list[str]:
    untracked = _git(root, "ls-files", "--others", "--exclude-standard", "--", "src", "benchmarks")
    return [*_git(root, "diff", "--name-only", commit, "--", "src", "benchmarks").splitlines(), *untracked.splitlines()]


@cache
def _code_differs(commit: str, file: str, root: Path) -> bool:
    try:
        before = _git(root, "show", f"{commit}:{file}")
    except subprocess.CalledProcessError:  # The commit has no such file.
        return True
    return _code_of(before) != _code_of(root.joinpath(file).read_text(encoding="utf-8"))


@cache
def _module(name: str, root: Path) -> tuple[str, Path | None]:
    """Return the module that has a name or holds what has it, and its file: None where it is not the project's."""
    package, *names = name.split(".")
    if package not in ("benchmarks", "trailmark"):
        return name, None
    path = root.joinpath(*(["src"] if package == "trailmark" else []), package, *names)
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return name, file
    if package == "trailmark" and len(names) == 1:
        home = _public_names(root / "src" / "trailmark" / "__init__.py").get(names[0])
        return _module(home, root) if home else (name, None)
    return _module(name.rpartition(".")[0], root)


@cache
def _public_names(file: Path) -> dict[str, str]:
    """Return the module that each public name of the package comes from."""
    tree = ast.parse(file.read_bytes())
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {alias.name: node.module or "" for node in imports for alias in node.names}


@cache
def _imports_of(source: str) -> list[str]:
    return list(_imports(source))


def _imports(text: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            # The package's own names are asked for one by one: what else it offers is no dependency.
            if node.module and node.module != "trailmark":
                yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if MODULE.fullmatch(node.value):
                yield node.value
            elif "import " in node.value:
                with contextlib.suppress(SyntaxError):
                    yield from _imports(node.value)


@cache
def _code_of(source: str) -> str:
    return str(_code(ast.parse(source)))


def _code(node: object, raised: bool = False) -> object:
    """Return a syntax tree as nested lists, the same for every version of Python: no places, docstrings, messages.

    Args:
        node: of the tree, or what one of its fields holds.
        raised: within a ``raise``, whose texts are for people.
    """
    raised = raised or isinstance(node, ast.Raise)
    if isinstance(node, ast.AST):
        fields = [[name, _code(value, raised)] for name, value in ast.iter_fields(node) if value not in (None, [])]
        return [type(node).__name__, *fields]
    if isinstance(node, list):
        return [_code(child, raised) for child in node if not (_is_docstring(child) or (raised and _is_text(child)))]
    return repr(node)


def _is_docstring(node: object) -> bool:
    return isinstance(node, ast.Expr) and _is_text(node.value)


def _is_text(node: object) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _running_program(root: Path) -> str | None:
    file = getattr(sys.modules["__main__"], "__file__", None)
    if file is None or not Path(file).resolve().is_relative_to(root / "benchmarks"):
        return None
    return ".".join(Path(file).resolve().relative_to(root).with_suffix("").parts).removesuffix(".__main__")


def _commit(root: Path) -> str:
    """Return the commit, followed by ``with changes`` if the code differs from it; ``unknown`` outside of git."""
    try:
        commit = _git(root, "rev-parse", "--short=12", "HEAD").strip()
        changes = _git(root, "status", "--porcelain", "--", "src", "benchmarks", ":!benchmarks/results")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{commit}{WITH_CHANGES}" if changes else commit


def _git(root: Path, *words: str) -> str:
    return subprocess.run(["git", "-C", root, *words], check=True, capture_output=True, text=True).stdout
