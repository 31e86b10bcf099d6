"""Where compiled kernels are kept: a folder that is found everywhere, code that is never stale, and never a failure.

Numba keeps compiled code beside the source or in the user's cache folder, and raises where it can write to neither, as
in containers. Here a folder of the user's own among the temporary files comes next, and then no cache. Numba also takes
a kernel's code from the cache as long as the kernel's own file is unchanged, although code of the kernels that it calls
is part of it: here the key holds all that a kernel was compiled from, so that after an update no old code certifies
anything. And numba has one index for all types that a kernel is compiled for, which two processes that write to it at
the same time may leave pointing at each other's code: here each set of types has files of its own.

What is kept is machine code alone. Numba also keeps what another kernel needs to contain the code, and loads all that
it could compile with before it loads anything: two thirds of the time that loading takes, and most of the disk.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numba
from llvmlite import binding as llvm
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, NullCache
from numba.core.environment import Environment, lookup_environment
from numba.core.runtime.nrt import rtsys

from trailmark.compiled.origin import origin_of
from trailmark.compiled.report import report_once

__all__ = ["CacheContents", "KernelCache", "cache_contents", "cache_of"]

CODE = 2
"""Number of the way in which kernels become machine code: what was cached before it changed is not used."""

_folders: set[Path] = set()


class CacheContents(NamedTuple):
    """What the cache of the kernels that this process knows holds.

    Attributes:
        folder: that all of it lies in; None without a cache.
        files: number of files of machine code.
        written: how many of them were written since a time.
        size: bytes of all of them.
        free: bytes that are left on the disk; 0 without a cache.
    """

    folder: Path | None
    files: int
    written: int
    size: int
    free: int


def cache_contents(since: float) -> CacheContents:
    """Return what the cache holds; ``since`` is a time in seconds as ``time.time`` gives it."""
    facts = []
    for folder in _folders:
        with suppress(OSError):
            facts += [file.stat() for file in folder.glob("*.nbc")]
    if not _folders:
        return CacheContents(None, 0, 0, 0, 0)
    common = Path(os.path.commonpath(_folders))
    written = sum(fact.st_mtime >= since for fact in facts)
    return CacheContents(
        common, len(facts), written, sum(fact.st_size for fact in facts), shutil.disk_usage(common).free
    )


class _MachineCode(CompileResultCacheImpl):
    """How compiled code is written to a file and read from it: as machine code that Python calls."""

    def reduce(self, cres: Any) -> Any:
        """Return what is written of compiled code."""
        (name, kind, (code, _)), *rest, environments = super().reduce(cres)
        read = [(inside.globals["__name__"], inside.consts, inside.env_name) for inside in environments]
        return ((name, kind, (code, _no_bitcode())), *rest, read)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return compiled code from what was written of it."""
        (_, function, *_), read = payload, payload[-1]
        rtsys.initialize(target_context)  # reference counts, which machine code calls for
        # Numba finds only names that it was told of, and reads them from what is not kept here.
        target_context.codegen()._engine._defined_symbols |= {
            function.llvm_func_name,
            function.llvm_cpython_wrapper_name,
        }
        return super().rebuild(target_context, (*payload[:-1], [_environment(*facts) for facts in read]))


def _environment(module: str, constants: list[Any], name: str) -> Environment:
    """Return what machine code reads of a function that is part of it, without the function's module.

    Numba imports the module, for code that runs as Python; of its own ones some import much of scipy.
    """
    found: Environment | None = lookup_environment(name)
    if found is None:
        found = Environment({"__name__": module})
        found.consts[:] = constants
        found.env_name = name
        Environment._memo[name] = found
    return found


@cache
def _no_bitcode() -> bytes:
    return bytes(llvm.parse_assembly("").as_bitcode())


class KernelCache(FunctionCache):
    """Numba's cache of one kernel, keyed by all that it was compiled from; a damaged or full disk does no harm."""

    _impl_class = _MachineCode

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code compiled for these types, or None if there is none that can be used."""
        origin_of(self._py_func)  # an error in here is ours, and no damaged file
        self._open_file_of(sig)
        try:
            return self._load_overload(sig, target_context)
        except Exception:  # whatever reading a file cut short raises: compiling anew mends it
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code compiled for these types, if that can be done."""
        self._open_file_of(sig)
        save = partial(super().save_overload, sig, data)
        try:
            try:
                save()
            except OSError:
                raise
            except Exception:  # an index that was cut short: a new one
                self.flush()
                save()
        except Exception as error:
            report_once(f"compiled kernels cannot be cached: {getattr(error, 'strerror', None) or error}")

    @contextmanager
    def only_one_process(self, sig: Any) -> Iterator[None]:
        """Let no other process compile the kernel for these types meanwhile: it waits, and then finds the code here."""
        with ExitStack() as held:
            with suppress(OSError):  # it only costs time if two processes compile the same
                self._impl.locator.ensure_cache_path()
                path = Path(self.cache_path, f"{self._file_base(sig)}.lock")
                file = held.enter_context(path.open("wb"))
                fcntl.lockf(file, fcntl.LOCK_EX)  # given back when the file is closed
            yield

    def _open_file_of(self, sig: Any) -> None:
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = IndexDataCacheFile(self.cache_path, self._file_base(sig), stamp)

    def _file_base(self, sig: Any) -> str:
        return f"{self._impl.filename_base}.{hashlib.sha256(repr(sig).encode()).hexdigest()[:12]}"

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), origin_of(self._py_func), CODE)


def cache_of(function: Callable[..., Any]) -> KernelCache | NullCache:
    """Return the kernel's cache, in the first place that can be written to."""
    try:
        return _noted(KernelCache(function))
    except RuntimeError:  # numba knows no such place
        pass
    folder = _own_temporary_folder()
    if folder is not None:
        config: Any = numba.config
        before, config.CACHE_DIR = config.CACHE_DIR, folder
        try:
            found = _noted(KernelCache(function))
        except RuntimeError:
            pass
        else:
            report_once(f"no cache folder for compiled kernels can be written to, they are cached in {folder}")
            return found
        finally:
            config.CACHE_DIR = before
    report_once(
        "no folder can be written to: the kernels are compiled anew by each process (NUMBA_CACHE_DIR names one)"
    )
    return NullCache()


def _noted(found: KernelCache) -> KernelCache:
    _folders.add(Path(found.cache_path))
    return found


@cache
def _own_temporary_folder() -> str | None:
    """Return a folder that only this user can write to, or None: who writes there decides what runs here."""
    try:
        folder = Path(tempfile.gettempdir()) / f"trailmark-{os.getuid()}"
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        facts = folder.lstat()
        mine = stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.getuid() and not facts.st_mode & 0o022
        return str(folder) if mine else tempfile.mkdtemp(prefix="trailmark-")
    except OSError:
        return None
