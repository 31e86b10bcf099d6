"""Shipped worlds, found by name."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from trailmark import FormatError, library
from trailmark.library import find_world, shipped_worlds


def test_file_wins_over_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("office").write_text("mine")
    assert find_world("office").read_text() == "mine"
    assert find_world(tmp_path / "office") == tmp_path / "office"


def test_folder_does_not_win_over_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("office").mkdir()
    assert find_world("office") == shipped_worlds()["office"]


@pytest.mark.parametrize("name", ["ofice", "ofice.yaml", "nowhere/ofice.yaml"])
def test_unknown_name_gets_suggestion(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        FormatError, match=rf"^{name}: no such file or shipped world; expected .*'office'\?\)$"
    ) as caught:
        find_world(name)
    assert "expected bugtrap, clutter" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["", "x" * 5000, "a\0b"])
def test_impossible_names(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FormatError, match="expected bugtrap, clutter, "):
        find_world(name)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_locked_folder_is_left_to_the_reader(tmp_path: Path) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o000)
    assert find_world(locked / "a.yaml") == locked / "a.yaml"


def test_package_data_come_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "src" / "trailmark"
    for folder, name in ((package / "_worlds", "packaged"), (tmp_path / "worlds", "source")):
        folder.mkdir(parents=True)
        (folder / f"{name}.yaml").touch()
    monkeypatch.setattr(library, "_PACKAGE", package)
    assert list(shipped_worlds()) == ["packaged"]
    (package / "_worlds" / "packaged.yaml").unlink()
    (package / "_worlds").rmdir()
    assert list(shipped_worlds()) == ["source"]
