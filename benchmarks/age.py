"""Which code a result was measured with: the commit, and a digest of what the program depends on.

The digest is of the syntax trees without comments and docstrings, so that only code that may behave differently
counts. A program depends on the files of ``benchmarks`` that it imports, and on each part of ``trailmark`` (a folder or
file below ``src/trailmark``) that it or they or those parts import, whole. Worlds, data, installed packages and what is
not Python do not count.
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

__all__ = ["AGE", "ROOT", "code_digest", "dependencies", "describe_code"]

ROOT = Path(__file__).resolve().parents[1]

AGE = re.compile(rb"measured by (?P<program>[\w.]+) at commit (?P<commit>[\w ]+), code (?P<code>[0-9a-f]{16})")
"""Finds what :func:`describe_code` wrote, in a file of any format."""

MODULE = re.compile(r"trailmark(\.\w+)+")
DESCRIBING = {"benchmarks.age", "benchmarks.machine"}
"""Modules that describe a measurement and have no influence on it."""

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
    files = [file for part in dependencies(program, root).values() for file in part]
    # Nobody knows which code a process has loaded from files that changed after it began.
    changed = [file for file in files if file.stat().st_mtime > STARTED]
    code = "changed meanwhile" if changed else code_digest(program, root)
    return f"measured by {program} at commit {_commit(root)}, code {code}"


@cache
def code_digest(program: str, root: Path = ROOT) -> str:
    """Return 16 hexadecimal digits that change with the code that ``program`` depends on."""
    digest = hashlib.sha256()
    for name, files in sorted(dependencies(program, root).items()):
        for file in files:
            digest.update(f"{name} {file.name} {_code(ast.parse(file.read_bytes()))}\n".encode())
    return digest.hexdigest()[:16]


def dependencies(program: str, root: Path = ROOT) -> dict[str, list[Path]]:
    """Return the modules of ``benchmarks`` and the parts of ``trailmark`` that a program imports, with their files.

    Imports are read from the source, wherever they stand, also in texts that are programs of their own. ``import
    trailmark`` asks for all of it; a program that imports none of it runs the shell command, and depends on all too.
    """
    found: dict[str, list[Path]] = {}
    waiting, seen = [program, f"{program}.__main__"], set[str]()
    while waiting:
        module = waiting.pop()
        if module in seen:
            continue
        seen.add(module)
        name, files = _locate(module, root)
        if files and name not in found and name not in DESCRIBING:
            found[name] = files
            waiting += [imported for file in files for imported in _imports(file.read_text(encoding="utf-8"))]
    if not any(name.startswith("trailmark") for name in found):
        found["trailmark"] = sorted((root / "src" / "trailmark").rglob("*.py"))
    return found


def _locate(module: str, root: Path) -> tuple[str, list[Path]]:
    """Return the part or file that a module belongs to, and its files: none where the module is not the project's."""
    package, *names = module.split(".")
    if package == "benchmarks":
        path = root.joinpath(package, *names)
        files = [file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file()]
        return module, files
    if package != "trailmark":
        return module, []
    source = root / "src" / "trailmark"
    if not names:
        return module, sorted(source.rglob("*.py"))
    part = source / names[0]
    files = sorted(part.rglob("*.py")) if part.is_dir() else [part.with_suffix(".py")]
    if files and files[0].is_file():
        return f"trailmark.{names[0]}", files
    home = _public_names(source / "__init__.py").get(names[0])
    return _locate(home, root) if home else (module, [])


@cache
def _public_names(file: Path) -> dict[str, str]:
    """Return the module that each public name of the package comes from."""
    tree = ast.parse(file.read_bytes())
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {alias.name: node.module or "" for node in imports for alias in node.names}


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


def _code(node: object) -> object:
    """Return a syntax tree as nested lists, the same for every version of Python: no places, no docstrings."""
    if isinstance(node, ast.AST):
        fields = [[name, _code(value)] for name, value in ast.iter_fields(node) if value not in (None, [])]
        return [type(node).__name__, *fields]
    if isinstance(node, list):
        return [_code(child) for child in node if not _is_docstring(child)]
    return repr(node)


def _is_docstring(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


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
    return f"{commit} with changes" if changes else commit


def _git(root: Path, *words: str) -> str:
    return subprocess.run(["git", "-C", root, *words], check=True, capture_output=True, text=True).stdout
