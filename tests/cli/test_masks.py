"""--keepout and --speed-mask: nav2's masks beside a world."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from trailmark.world import World

Shell = Callable[..., Any]


@pytest.fixture
def mask(tmp_path: Path) -> Path:
    """A wall across the yard, from y = 0 to 4, with what nav2 takes for 60 % in the column beside it."""
    image = np.full((6, 10), 255, dtype=np.uint8)
    image[2:, 5], image[:, 8] = 0, 153
    Image.fromarray(image).save(tmp_path / "mask.pgm")
    file = tmp_path / "mask.yaml"
    file.write_text(
        "image: mask.pgm\nresolution: 1.0\norigin: [0, 0, 0]\nmode: scale\nfree_thresh: 0.0\noccupied_thresh: 1.0\n"
    )
    return file


def test_zones_are_shown_converted_and_kept_out_of(shell: Shell, yard: Path, mask: Path, tmp_path: Path) -> None:
    run = shell("worlds", "show", yard, "--keepout", mask, "--speed-mask", mask)
    assert "  zones      2 (1 keep-out, 1 speed)" in run.out.splitlines()
    written = tmp_path / "out.yaml"
    assert shell("worlds", "convert", yard, written, "--keepout", mask, "--speed-mask", mask).status == 0
    zones = World.load(written).zones
    assert [zone.kind for zone in zones] == ["keep-out", "speed"]
    assert zones[1].limit == 0.6  # type: ignore[union-attr]
    path = tmp_path / "path.csv"
    path.write_text("x,y,theta\n1,1,0\n9,1,0\n")
    found = json.loads(shell("check", yard, path, "--keepout", mask, "--json").out)
    assert "keep-out zone 0" in [collision["obstacle"] for collision in found["collisions"]]


@pytest.mark.slow
def test_a_speed_mask_gives_shares_of_the_max_speed(shell: Shell, yard: Path, mask: Path, tmp_path: Path) -> None:
    query = ["--start", "7.5,2,0", "--goal", "9.5,2,0", "--robot", "disc:0.2", "--objective", "time", "--json"]
    costs = []
    for speed in ([], ["--max-speed", "0.5"]):
        run = shell("plan", yard, *query, "--speed-mask", mask, *speed, "--max-iterations", "1", "--time-limit", "20")
        costs.append(json.loads(run.out)["cost"])
    # A metre at full speed and one at 60 % of it.
    assert costs == pytest.approx([1.0 + 1.0 / 0.6, 2.0 + 2.0 / 0.6])


def test_a_keep_out_mask_beside_the_map_is_warned_of(shell: Shell, yard: Path, mask: Path) -> None:
    assert shell("worlds", "show", yard, "--keepout", mask).err == ""
    for before, after in (("origin: [0, 0, 0]", "origin: [50, 0, 0]"), ("occupied_thresh: 1.0", "negate: 1")):
        text = mask.read_text()
        mask.write_text(text.replace(before, after).replace("negate: 1", "negate: 1\noccupied_thresh: 1.0"))
        image = np.asarray(Image.open(mask.with_name("mask.pgm")))
        if "negate" in after:  # nothing is occupied
            Image.fromarray(np.zeros_like(image)).save(mask.with_name("mask.pgm"))
        run = shell("worlds", "show", yard, "--keepout", mask)
        assert (run.status, run.err.count("\n")) == (0, 1)
        assert "the keep-out mask covers nothing of the map" in run.err
        mask.write_text(text)
