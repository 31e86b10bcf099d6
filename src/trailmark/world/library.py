"""The worlds that trailmark ships, found by name."""

from __future__ import annotations

from pathlib import Path

from trailmark.errors import FormatError, expected_name

__all__ = ["find_world", "shipped_worlds"]

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped_worlds() -> dict[str, Path]:
    """Return the file of every shipped world under its name, in the order of the names."""
    # A wheel carries them as package data; an editable installation and a source tree have them beside ``src``.
    packaged = _PACKAGE / "_worlds"
    folder = packaged if packaged.is_dir() else _PACKAGE.parents[1] / "worlds"
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}


def find_world(name_or_path: str | Path) -> Path:
    """Return the file that a WORLD argument means: an existing file, else the shipped world of that name.

    Raises:
        FormatError: neither; the message lists the shipped names.
    """
    path = Path(name_or_path)
    try:
        exists, folder = path.exists(), path.is_dir()
    except PermissionError:
        return path  # reading it tells why it cannot be read
    except (OSError, ValueError):  # no file can have that name: too long, a null byte
        exists = folder = False
    if exists and not folder:
        return path
    shipped = shipped_worlds()
    if str(name_or_path) in shipped:
        return shipped[str(name_or_path)]
    what = "a folder, not a file" if folder else "no such file or shipped world"
    given = path.name if path.stem in shipped else path.stem
    raise FormatError(name_or_path, f"{what}; {expected_name(given, shipped)}")
