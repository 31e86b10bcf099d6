"""The interface packages of nav2 that have no wheel, built once into a cache from their fields, as Kilted has them.

The wheels that rclpy brings hold all generators: the packages are made by them and by gcc, without CMake, one shared
library each. By hand: `python tests/slow/ros/interfaces.py` builds them and prints what a shell has to export.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

FIELDS = Path(__file__).with_suffix(".txt")
KINDS = ["generator_c", "generator_py", "typesupport_c", "typesupport_fastrtps_c", "typesupport_introspection_c"]
FOUND_BY_NAME = ["typesupport_fastrtps_c", "typesupport_introspection_c"]  # libraries that are opened by their names
USED = ["std_msgs", "geometry_msgs", "nav_msgs", "builtin_interfaces", "unique_identifier_msgs", "action_msgs"]
USED += ["service_msgs"]


def why_not() -> str | None:
    """Why the packages cannot be built here, in one line, or None."""
    here = (sys.implementation.name, sys.version_info[:2], sys.platform, platform.machine())
    if here != ("cpython", (3, 11), "linux", "x86_64"):
        return "rclpy has wheels for CPython 3.11 on x86-64 Linux alone"
    if find_spec("rclpy") is None:
        return "rclpy is not installed: pip install 'trailmark[ros2]'"
    if not (_ros() / "share/rosidl_generator_py/resource").is_dir():
        return "this rclpy was not installed from the package index"
    if not (shutil.which("gcc") and shutil.which("g++")):
        return "no compiler: gcc and g++ build the interfaces of nav2"
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        return "no headers of Python (python3-dev): they are needed to build the interfaces of nav2"
    return None


def environment() -> dict[str, str]:
    """What a process needs beside `os.environ` to import the packages and to be alone with this process's children."""
    prefix = interfaces()
    return {
        "PYTHONPATH": _before("PYTHONPATH", prefix),
        "LD_LIBRARY_PATH": _before("LD_LIBRARY_PATH", prefix / "lib"),
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }


def interfaces() -> Path:
    """The folder of the Python packages nav2_msgs, bond, tf2_msgs and map_msgs, built where it is not yet there."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "trailmark-tests", "ros")
    prefix = folder / _digest()
    if prefix.is_dir():
        return prefix
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock, tempfile.TemporaryDirectory(dir=folder) as scratch:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two workers of pytest may ask at once
        if not prefix.is_dir():
            command = [sys.executable, __file__, scratch]  # generators print, and want an environment
            done = subprocess.run(command, env=os.environ | {"AMENT_PREFIX_PATH": str(_ros())}, capture_output=True)
            if done.returncode:
                raise RuntimeError(f"the interfaces of nav2 were not built:\n{done.stderr.decode()[-4000:]}")
            Path(scratch, "prefix").rename(prefix)
    return prefix


def definitions() -> dict[str, str]:
    """The text of each interface by its file."""
    texts: dict[str, str] = {}
    for line in filter(None, FIELDS.read_text().splitlines()):
        if line.startswith("["):
            texts[file := line.strip("[]")] = ""
        else:
            texts[file] += f"{line}\n"
    return texts


def _before(name: str, folder: Path) -> str:
    return os.pathsep.join(filter(None, [str(folder), os.environ.get(name)]))


def _site() -> Path:
    spec = find_spec("rclpy")
    assert spec.origin is not None
    return Path(spec.origin).parents[1]


def _ros() -> Path:
    """The prefix into which pip put the libraries of ROS 2, their headers and templates."""
    return _site().parents[2]


def _digest() -> str:
    """Of the fields, this file, Python and the versions of all that the packages are built with."""
    wheels = sorted(path.name for name in ("ros_*", "numpy-*", "empy-*") for path in _site().glob(f"{name}.dist-info"))
    built_with = [Path(__file__).read_text(), FIELDS.read_text(), sys.version, *wheels]
    return hashlib.sha256(repr(built_with).encode()).hexdigest()[:16]


def _build(scratch: Path) -> None:
    parser = import_module("rosidl_parser.parser")
    parser.parse_idl_string = cache(parser.parse_idl_string)  # type: ignore[attr-defined]  # each generator parses anew
    compilers = []
    texts = definitions()
    for package in sorted({file.split("/")[0] for file in texts}):
        idl = []
        for file, text in texts.items():
            if file.startswith(f"{package}/"):
                path = scratch / file
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)
                kind, relative = path.suffix[1:], path.relative_to(scratch / package)
                convert = getattr(import_module(f"rosidl_adapter.{kind}"), f"convert_{kind}_to_idl")
                convert(scratch / package, package, relative, path.parent)
                idl.append(f"{scratch / package}:{relative.with_suffix('.idl')}")
        _generate(package, idl, scratch / "code")
        compilers.append(_compile(package, scratch / "code", scratch / "prefix"))
    for compiler in compilers:
        if compiler.wait():
            sys.exit(1)


def _generate(package: str, idl: list[str], code: Path) -> None:
    """Write the code of a package, in a folder for each generator: two of them name their files alike."""
    python = {"typesupport_implementations": ["rosidl_typesupport_c"]}
    for module, name, options in (
        ("rosidl_generator_c", "GenerateC", {}),
        ("rosidl_typesupport_introspection_c", "GenerateIntrospectionCTypesupport", {}),
        ("rosidl_typesupport_fastrtps_c", "GenerateFastRTPSCTypesupport", {}),
        ("rosidl_typesupport_c", "GenerateCTypesupport", {}),
        ("rosidl_generator_py", "GeneratePython", python),
    ):
        generator = getattr(import_module(f"{module}.cli"), name)(name, **options)
        generator.generate(package, idl, [str(_ros() / "share")], output_path=code / module / package)


def _compile(package: str, code: Path, prefix: Path) -> subprocess.Popen[bytes]:
    """Start the compiler on all code of a package; its one library goes under each of its names."""
    code_of_python = code / "rosidl_generator_py" / package
    shutil.copytree(code_of_python, prefix / package, ignore=shutil.ignore_patterns("*.c"))
    (prefix / package / "__init__.py").touch()
    library = prefix / package / f"{package}_s__rosidl_typesupport_c.so"
    (prefix / "lib").mkdir(exist_ok=True)
    for kind in FOUND_BY_NAME:
        (prefix / "lib" / f"lib{package}__rosidl_{kind}.so").symlink_to(f"../{package}/{library.name}")
    whole = code / "rosidl_typesupport_c" / f"{package}.cc"  # one file: what costs is the headers
    whole.write_text("".join(f'#include "{file}"\n' for file in sorted(code.glob(f"*/{package}/**/*.cpp"))))
    include = [*code.iterdir(), sysconfig.get_path("include"), _site() / "numpy/_core/include", _ros() / "include"]
    include += [folder for folder in (_ros() / "include").iterdir() if not folder.name.startswith("python")]
    names = [f"{used}__rosidl_{kind}" for used in USED for kind in KINDS]
    names += ["fastcdr", "rmw", "rcutils", "rosidl_runtime_c", "rosidl_typesupport_c", "rosidl_typesupport_fastrtps_c"]
    names += ["rosidl_typesupport_fastrtps_cpp", "rosidl_typesupport_introspection_c", "stdc++"]
    command: list[str | Path] = [
        "gcc",
        "-w",
        "-O0",
        "-shared",
        "-fPIC",
        f"-Wl,-soname,lib{package}__rosidl_{FOUND_BY_NAME[0]}.so",  # found by it where it is loaded already
        "-o",
        library,
        *(f"-I{folder}" for folder in include),
    ]
    command += [*code.glob(f"*/{package}/**/*.c"), "-x", "c++", whole, "-x", "none"]
    command += [f"-L{_ros() / 'lib'}", "-Wl,--as-needed", *(f"-l{name}" for name in names)]
    return subprocess.Popen(command)


if __name__ == "__main__":
    if len(sys.argv) == 2:
        _build(Path(sys.argv[1]))
    elif reason := why_not():
        sys.exit(reason)
    else:
        for key, value in environment().items():
            if key.endswith("PATH"):
                sys.stdout.write(f"export {key}={value}\n")
