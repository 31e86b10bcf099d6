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
output, *bombs = sys.argv[1:]
for bomb in bombs:
    status = main(["map", bomb, "--output", output])
    print(status, int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1]) // 1024)
"""
HEADS = {
    "jsonl": b'{"trailmark_log": 1, "name": "bomb"}\n',
    "carmen": b"ODOM 0 0 0 0 0 0 0 host 0\n",
    "victoria": b"ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\n",
}


@pytest.mark.slow
def test_gzip_bombs_of_three_gigabytes(tmp_path: Path) -> None:
    piece = gzip.compress(bytes(2**24), 1)
    bombs = [tmp_path / f"{kind}.gz" for kind in HEADS]
    for bomb, head in zip(bombs, HEADS.values(), strict=True):
        bomb.write_bytes(gzip.compress(head) + 192 * piece)  # 3 GiB in 192 members
    words = list(map(str, (tmp_path / "world.yaml", *bombs)))
    done = subprocess.run([sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, timeout=120)
    said = [f"trailmark: error: {bomb}:2: expected at most 4,194,304 bytes in a line, got more" for bomb in bombs]
    assert done.stderr.splitlines() == said
    for line in done.stdout.splitlines():
        status, megabytes = map(int, line.split())
        assert status == 2
        assert megabytes < 200
    assert done.stdout.count("\n") == len(HEADS)
    assert not (tmp_path / "world.yaml").exists()
