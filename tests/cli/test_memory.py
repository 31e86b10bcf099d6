"""What is small on the disk and huge unpacked is refused before it takes the memory."""

from __future__ import annotations

import gzip
import subprocess
import sys
from pathlib import Path

import pytest

# ru_maxrss would begin with the memory of the process that starts this one.
PROGRAM = """
import re, sys
from pathlib import Path
from trailmark.cli import main
status = main(sys.argv[1:])
print(status, int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1]) // 1024)
"""
HEADS = {
    "jsonl": b'{"trailmark_log": 1, "name": "bomb"}\n',
    "carmen": b"ODOM 0 0 0 0 0 0 0 host 0\n",
    "victoria": b"ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\n",
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", HEADS)
def test_a_gzip_bomb_of_three_gigabytes(tmp_path: Path, kind: str) -> None:
    bomb = tmp_path / "bomb.gz"
    piece = gzip.compress(bytes(2**26), 1)
    bomb.write_bytes(gzip.compress(HEADS[kind]) + 48 * piece)  # 3 GiB in 48 members
    words = ["map", str(bomb), "--output", str(tmp_path / "world.yaml")]
    done = subprocess.run([sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, timeout=120)
    status, megabytes = map(int, done.stdout.split())
    assert status == 2
    assert done.stderr == f"trailmark: error: {bomb}:2: expected at most 4,194,304 bytes in a line, got more\n"
    assert megabytes < 200
    assert not (tmp_path / "world.yaml").exists()
