"""Reading text whole and within a limit; writing files whole or not at all, and never over what was read."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterable, Sequence
from pathlib import Path

from trailmark.errors import FormatError, OutputError, expected_name

__all__ = [
    "MAX_FILE_BYTES",
    "check_writable",
    "read_bytes",
    "read_text",
    "require_not_an_input",
    "text_of",
    "write_atomically",
]

MAX_FILE_BYTES = 2**27
"""Largest file (bytes, 128 MiB) that is read into memory: any text format, any mesh."""


def read_bytes(path: Path, limit: int = MAX_FILE_BYTES) -> bytes:
    """Return the content of a file.

    Raises:
        FormatError: the file is missing, a directory, unreadable, or larger than ``limit`` bytes.
    """
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            # What is asked for is set aside at once, so no more than there is; pipes have no size, yet are bounded too.
            data = file.read(min(size, limit) + 1) if size <= limit else b""
            data += file.read(limit + 1 - len(data)) if len(data) > size else b""
    except (OSError, ValueError) as error:
        raise FormatError(path, f"cannot be read: {_reason(error)}") from None
    size = max(size, len(data))
    if size > limit:
        raise FormatError(path, f"expected at most {limit:,} bytes, got {size:,}")
    return data


def read_text(path: Path, allowed: str = "expected UTF-8 text") -> str:
    """Return the content of a UTF-8 text file, without a byte order mark.

    Args:
        path: the file.
        allowed: ends the message about a file that is no text.

    Raises:
        FormatError: as :func:`read_bytes`, or the file is no UTF-8 text.
    """
    return text_of(read_bytes(path), path, allowed)


def text_of(data: bytes, path: Path, allowed: str) -> str:
    """Return what :func:`read_text` does, of a file's content."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise FormatError(path, f"not a text file; {allowed}")
    return text


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write a file so that the path holds, at every moment, the old content or the whole new content.

    The content goes to a temporary file in the same directory, which then takes the path's place. A symbolic
    link keeps its place and its target is replaced; a device such as /dev/stdout is written to directly.

    Raises:
        OutputError: the path cannot be written; nothing is left behind.
    """
    try:
        data = content.encode() if isinstance(content, str) else content
        target = path.resolve()
        if target.exists() and not target.is_file() and not target.is_dir():
            target.write_bytes(data)
            return
        _replace(target, data)
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: a loop of symbolic links
        raise OutputError(f"{path}: cannot be written: {_reason(error)}") from None


def check_writable(path: Path, suffixes: Sequence[str] = ()) -> None:
    """Raise if the path cannot be written; to be asked before long work whose result goes there.

    Args:
        path: the file to be written later.
        suffixes: the suffixes allowed, such as ``.csv``; all if empty.

    Raises:
        OutputError: another suffix, a missing directory, a path that is a directory, no permission.
    """
    if suffixes and not path.name.lower().endswith(tuple(suffixes)):
        raise OutputError(f"{path}: suffix: {expected_name(path.suffix.lower(), suffixes)}")
    try:
        if path.is_dir():
            problem = "is a directory; expected a file"
        elif not path.parent.is_dir():
            problem = f"the directory {str(path.parent)!r} does not exist"
        elif path.exists() and not os.access(path, os.W_OK):
            problem = "the file is write-protected"
        elif (path.is_file() or not path.exists()) and not os.access(path.resolve().parent, os.W_OK | os.X_OK):
            problem = f"no permission to write in the directory {str(path.parent)!r}"
        else:
            return
    except (OSError, ValueError, RuntimeError) as error:
        problem = _reason(error)
    raise OutputError(f"{path}: cannot be written: {problem}")


def require_not_an_input(path: Path, inputs: Iterable[Path]) -> None:
    """Raise if the path is one of the inputs, by whatever name: links, ``./``, other case where that is the same file.

    Args:
        path: the file to be written.
        inputs: files that were read.

    Raises:
        OutputError: it is one of them.
    """
    for other in inputs:
        try:
            same = path.is_file() and path.samefile(other)
        except (OSError, ValueError, RuntimeError):  # one that cannot be found is not that file
            continue
        if same:
            name = "" if path.absolute() == other.absolute() else f" {str(other)!r}"
            raise OutputError(f"{path}: is the same file as the input{name}; expected another file")


def _replace(target: Path, data: bytes) -> None:
    temporary = target.with_name(f".{target.name[:100]}.{secrets.token_hex(4)}.tmp")
    # os.open, unlike tempfile, leaves the permissions to the umask, as for any file that a user makes.
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if target.is_file():
            temporary.chmod(target.stat().st_mode & 0o777)
        temporary.replace(target)
    except BaseException:  # also an interrupt must leave no half-written file
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
