"""Fixtures shared by all tests."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from hypothesis import HealthCheck, settings
from tests.helpers.trials import THOROUGH

ROOT = Path(__file__).resolve().parents[1]
COMPILED = "trailmark/compiled"
"""Where pytest's cache keeps which code the kernels were compiled of."""

# Deadlines would measure the machine (numba compiles on the first example), not the code. Every run draws other
# examples: few in each are many in a week. Who changes what a property is about asks for many at once:
# --hypothesis-profile thorough.
common = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True)
settings.register_profile("trailmark", common, max_examples=12)
settings.register_profile("thorough", common, max_examples=THOROUGH)
settings.load_profile("trailmark")

# Some machines tell Python to keep no bytecode: each of the hundreds of processes that tests start would compile all
# that it imports, and each of pytest's workers all tests.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Kernels and tests are some hundred thousand objects, which Python's garbage collector would look through every second.
gc.set_threshold(50_000, 20, 100)

# In the background a shell starts programs deaf to Ctrl-C, and so would be those that the tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile all kernels before the workers of pytest-xdist begin: each would compile them for itself.

    While the code stays the same they are there, and loading all of them, which takes ten seconds, is left out.
    """
    config = session.config
    if not getattr(config.option, "numprocesses", None) or hasattr(config, "workerinput"):
        return
    code = [[sys.prefix, numba.__version__], *sorted([str(f), f.stat().st_mtime] for f in ROOT.glob("src/**/*.py"))]
    cache = getattr(config, "cache", None)  # it is there unless pytest is told to keep none
    if cache is not None and cache.get(COMPILED, None) == code:
        return
    warmup = [sys.executable, "-m", "trailmark", "warmup"]
    subprocess.run(warmup, stdout=subprocess.DEVNULL, check=True, timeout=1500)
    if cache is not None:
        cache.set(COMPILED, code)


def data_folder() -> Path:
    """The folder of real public data: TRAILMARK_DATA, else ../shared/data beside the project."""
    return Path(os.environ.get("TRAILMARK_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    folder = data_folder()
    if not folder.is_dir():
        pytest.skip(f"real data not found: set TRAILMARK_DATA (looked in {folder.name!r} beside the project)")
    return folder


@pytest.fixture(scope="session")
def worlds() -> Path:
    return ROOT / "worlds"
