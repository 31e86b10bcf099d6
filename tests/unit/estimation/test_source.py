"""Telling formats apart, and what is no log at all."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import pytest

from trailmark.errors import FormatError
from trailmark.estimation.readers import load_log, save_log, source

JSONL = '{"trailmark_log": 1}\n{"type": "odometry", "t": 0, "v": 1, "omega": 0}\n'
VICTORIA = "# a drive\n\nODOMETRY 0 1 1 0 0 1e-4 0 0 4e-6 0 4e-6\n"
CARMEN = "# message formats defined: PARAM ODOM FLASER\nODOM 0 0 0 0 0 0 1.0 host 1.0\n"


@pytest.mark.parametrize("text", [JSONL, VICTORIA, CARMEN, CARMEN.replace("\n", "\r\n"), "\ufeff" + JSONL])
def test_text_logs_are_told_by_their_content(tmp_path: Path, text: str) -> None:
    # The name says nothing, not even that a file is gzipped.
    (tmp_path / "drive.dat").write_bytes(text.encode())
    (tmp_path / "packed").write_bytes(gzip.compress(text.encode(), mtime=0))
    plain, packed = load_log(tmp_path / "drive.dat"), load_log(str(tmp_path / "packed"))
    assert plain.name == "drive"
    assert packed.name == "packed"
    assert len(plain.records) == len(packed.records) == 1
    assert str(plain.records) == str(packed.records)
    assert plain.dropped == 0


def test_a_format_that_is_given(tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    path.write_text("garbage\n" * 10 + VICTORIA)
    assert len(load_log(path, "victoria", skip_bad=True).records) == 1
    with pytest.raises(FormatError, match=r"drive.log:1: expected a line with ODOM, FLASER, .* got 'garbage'"):
        load_log(path, "carmen")
    with pytest.raises(FormatError, match=r"got 'carmem'"):
        load_log(path, "carmem")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "an empty log; expected trailmark JSON Lines"),
        (gzip.compress(b"", mtime=0), "an empty log; expected trailmark JSON Lines"),
        (b"\0\1\2", "no log of a known format; expected trailmark JSON Lines"),
        (JSONL.encode()[:21] + b"\n\n", "expected a log of one record or more, got none"),
        (b"# message formats defined: ODOM\nPARAM a b\n", "expected a log of one record or more, got none"),
        (gzip.compress(JSONL.encode(), mtime=0)[:-9], "cannot be read: Compressed file ended before the end-of-stream"),
        (gzip.compress(JSONL.encode(), mtime=0)[:-8] + b"12345678", "cannot be read: CRC check failed"),
        (JSONL.encode() + b"\0", "log:3: not valid JSON"),
        (VICTORIA.encode() + b"\xff\n", "log:4: expected UTF-8 text, got byte 0xff"),
    ],
)
def test_what_is_no_log(tmp_path: Path, content: bytes, problem: str) -> None:
    path = tmp_path / "log"
    path.write_bytes(content)
    with pytest.raises(FormatError) as caught:
        load_log(path)
    assert problem in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="nowhere: cannot be read: No such file or directory"):
        load_log(tmp_path / "nowhere")
    with pytest.raises(FormatError, match="nowhere:3: cannot be read: No such file or directory"):
        load_log(tmp_path / "nowhere:3")
    with pytest.raises(FormatError, match="a folder that holds no log; expected"):
        load_log(tmp_path)
    with pytest.raises(FormatError, match="cannot be read: File name too long"):
        load_log(tmp_path / ("a" * 5000))


def test_bad_lines_are_left_out_but_not_all(tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_bytes(VICTORIA.encode() + b"LANDMARK \xff\xfe\n" + b"ODOMETRY 1 2 1 0 0 1e-4 0 0 4e-6 0 4e-6\n")
    log = load_log(path, skip_bad=True)
    assert (len(log.records), log.dropped) == (2, 1)
    path.write_text(VICTORIA.replace("1e-4", "nan"))
    with pytest.raises(FormatError, match=r"expected a log of one record or more, got none \(1 bad ones left out\)"):
        load_log(path, skip_bad=True)


@pytest.mark.slow
def test_too_large(tmp_path: Path) -> None:
    path, bad = tmp_path / "log", source.BadRecords(skip=False)
    for content in (JSONL.encode() * 100, gzip.compress(JSONL.encode() * 100, mtime=0)):
        path.write_bytes(content)
        with pytest.raises(FormatError, match="expected at most 1,000 bytes when unpacked, got more"):
            list(source.read_lines(path, bad, limit=1000))
    # What grows a thousandfold is refused before it takes the memory.
    path.write_bytes(gzip.compress(JSONL.encode() + b" " * 2**25, mtime=0))
    with pytest.raises(FormatError, match="log:3: expected at most 4,194,304 bytes in a line"):
        list(source.read_lines(path, bad))


@pytest.mark.slow
def test_a_file_that_unpacks_to_many_times_its_size_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "MIN_UNPACKED_BYTES", 2**16)
    path, bad = tmp_path / "log", source.BadRecords(skip=False)
    path.write_bytes(gzip.compress((b"x" * 999 + b"\n") * 10_000, mtime=0))
    with pytest.raises(FormatError, match="bytes when unpacked, got more"):
        list(source.read_lines(path, bad))
    lines = "\n".join(str(math.sqrt(number)) for number in range(5000))
    path.write_bytes(gzip.compress(lines.encode(), mtime=0))
    assert list(source.read_lines(path, bad)) == lines.split("\n")


def test_save_and_load(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(CARMEN)
    log = load_log(tmp_path / "a.log")
    save_log(log, tmp_path / "b.jsonl.gz")
    assert (tmp_path / "b.jsonl.gz").read_bytes()[:2] == b"\x1f\x8b"
    assert load_log(tmp_path / "b.jsonl.gz").records == log.records
    assert load_log(tmp_path / "b.jsonl.gz").name == "a"
