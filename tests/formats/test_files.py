from __future__ import annotations

import os
import stat
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from trailmark import FormatError, OutputError, World
from trailmark.formats import files
from trailmark.formats.files import require_not_an_input
from trailmark.plotting import save_world_figure

NAV2 = "image: yard.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\n"


@pytest.mark.parametrize("moment", ["fsync", "replace"])
@pytest.mark.parametrize("failure", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_an_interrupted_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str, failure: BaseException
) -> None:
    def fail(*_: object) -> None:
        raise failure

    target = tmp_path / "out.yaml"
    target.write_text("old")
    monkeypatch.setattr(*{"fsync": (os, "fsync"), "replace": (Path, "replace")}[moment], fail)
    with pytest.raises((KeyboardInterrupt, OutputError)):
        files.write_atomically(target, "new")
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out.yaml"]


def test_permissions_follow_the_umask_and_then_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "out"
    old = os.umask(0o027)
    try:
        files.write_atomically(target, "a")
    finally:
        os.umask(old)
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    target.chmod(0o604)
    files.write_atomically(target, "b")
    assert stat.S_IMODE(target.stat().st_mode) == 0o604


def test_a_link_stays_one_and_a_pipe_is_written_to_directly(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    link, pipe = tmp_path / "link.csv", tmp_path / "pipe"
    link.symlink_to(tmp_path / "real" / "path.csv")
    files.write_atomically(link, "x")
    assert link.is_symlink()
    assert (tmp_path / "real" / "path.csv").read_text() == "x"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        files.write_atomically(pipe, "through")
        assert os.read(reader, 100) == b"through"
    finally:
        os.close(reader)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("name", ["missing/out.csv", "file/out.csv", ".", "x" * 300, "nul\0"])
def test_unwritable_paths_are_reported_in_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    for write in (lambda p: files.write_atomically(p, "x"), files.check_writable):
        with pytest.raises(OutputError) as caught:
            write(tmp_path / name)
        assert str(caught.value).startswith(str(tmp_path))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_protection_is_asked_of_the_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(OutputError, match="no permission to write in the directory"):
        files.check_writable(tmp_path / "new.csv")
    (tmp_path / "old.csv").write_text("")
    with pytest.raises(OutputError, match="write-protected"):
        files.check_writable(tmp_path / "old.csv")


def test_suffixes(tmp_path: Path) -> None:
    files.check_writable(tmp_path / "a.PNG", (".png", ".svg"))
    with pytest.raises(OutputError, match=r"suffixes0/a\.pgn: suffix: expected \.png, \.svg, got '\.pgn' \(did you"):
        files.check_writable(tmp_path / "a.pgn", (".png", ".svg"))
    assert list(tmp_path.iterdir()) == []


def test_reading_is_bounded(tmp_path: Path) -> None:
    file = tmp_path / "big"
    file.write_bytes(b"12345")
    assert files.read_bytes(file, limit=5) == b"12345"
    with pytest.raises(FormatError, match="expected at most 4 bytes, got 5"):
        files.read_bytes(file, limit=4)
    with pytest.raises(FormatError, match="expected at most 1,000 bytes, got 1,001"):
        files.read_bytes(Path("/dev/zero"), limit=1000)


def test_only_text_that_can_be_read_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfname: \xc3\xa4")
    assert files.read_text(tmp_path / "a") == "name: ä"
    for content in (b"\xff\xfe", b"a\0b"):
        (tmp_path / "a").write_bytes(content)
        with pytest.raises(FormatError, match="a: not a text file; expected UTF-8 text"):
            files.read_text(tmp_path / "a")
    for name in ("missing", "", "nul\0", "x" * 300):
        with pytest.raises(FormatError, match="cannot be read"):
            files.read_bytes(tmp_path / name)


def picture(file: Path) -> Path:
    Image.fromarray(np.full((20, 30), 254, dtype=np.uint8)).save(file)
    return file


def test_an_input_is_known_by_whatever_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sub").mkdir()
    real = picture(tmp_path / "real.png")
    (tmp_path / "soft.png").symlink_to(real)
    (tmp_path / "dir").symlink_to(tmp_path)
    os.link(real, tmp_path / "hard.png")
    monkeypatch.chdir(tmp_path)
    names = ["real.png", "./real.png", "sub/../real.png", "soft.png", "hard.png", "dir/real.png", str(real)]
    for name in names:
        with pytest.raises(OutputError, match=r"expected another file") as caught:
            require_not_an_input(Path(name), [Path("nowhere"), real])
        assert str(caught.value).startswith(str(Path(name)))
    picture(tmp_path / "other.png")
    for name in ("other.png", "new.png", "sub", "/dev/null"):
        require_not_an_input(Path(name), [real, Path("/dev/null"), Path("x" * 400), Path("nul\0")])


def test_own_worlds_are_written_again_and_maps_are_not(tmp_path: Path) -> None:
    world = World("yard", (0.0, 0.0, 3.0, 2.0))
    own = tmp_path / "own.yaml"
    world.save(own)
    World.load(own).save(own)  # as somebody who edits it does

    picture(tmp_path / "yard.pgm")
    (tmp_path / "map.yaml").write_text(NAV2)
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    loaded = World.load(tmp_path / "map.yaml")
    assert set(loaded.sources) == {tmp_path / "map.yaml", tmp_path / "yard.pgm"}
    for name in ("map.yaml", "yard.pgm"):
        with pytest.raises(OutputError, match="same file as the input"):
            loaded.save(tmp_path / name)
    (tmp_path / "yard.png").symlink_to(tmp_path / "yard.pgm")
    with pytest.raises(OutputError, match="same file as the input"):
        save_world_figure(tmp_path / "yard.png", loaded)
    (tmp_path / "yard.png").unlink()
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_sources_are_no_part_of_a_world(tmp_path: Path) -> None:
    world = World("yard", (0.0, 0.0, 3.0, 2.0))
    world.save(tmp_path / "yard.yaml")
    again = World.load(tmp_path / "yard.yaml")
    assert again.sources == (tmp_path / "yard.yaml",)
    assert (again, hash(again), repr(again)) == (world, hash(world), repr(world))
