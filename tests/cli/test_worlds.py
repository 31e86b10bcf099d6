"""trailmark worlds: list, show, convert (with nav2's masks), schema."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from trailmark import check_path
from trailmark.world import Robot, World, library

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


@pytest.mark.slow
def test_every_shipped_world_is_listed(shell: Shell) -> None:
    run = shell("worlds")
    assert (run.status, run.err) == (0, "")
    head, *rows = run.out.splitlines()
    assert head.split() == ["NAME", "SIZE", "OBSTACLES", "QUERIES", "ROBOT"]
    assert [row.split()[0] for row in rows] == sorted(library.shipped_worlds())
    listed = json.loads(shell("worlds", "--json").out)["worlds"]
    assert [facts["name"] for facts in listed] == sorted(library.shipped_worlds())
    office = World.load(library.find_world("office"))
    (facts,) = (facts for facts in listed if facts["name"] == "office")
    assert facts["bounds"] == list(office.bounds)
    assert facts["obstacles"] == len(office.obstacles) == sum(facts["kinds"].values())
    assert [query["name"] for query in facts["queries"]] == [query.name for query in office.queries]


@pytest.mark.slow
def test_show_tells_and_draws(shell: Shell, yard: Path, tmp_path: Path) -> None:
    facts = json.loads(shell("worlds", "show", yard, "--json", "--robot", "disc:0.25").out)
    assert facts["robot"] == "disc 0.25 m"
    assert facts["queries"][0] == {"name": "across", "start": [1.0, 1.0, 0.0], "goal": [9.0, 5.0, 1.5]}
    for suffix, magic in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")):
        picture = tmp_path / f"yard{suffix}"
        run = shell("worlds", "show", yard, "--plot", picture)
        assert (run.status, str(picture) in run.out) == (0, True)
        assert picture.read_bytes().startswith(magic)


def test_convert_keeps_the_world_but_for_another_robot(shell: Shell, yard: Path, tmp_path: Path) -> None:
    assert shell("worlds", "convert", yard, tmp_path / "copy.yaml") == (0, "", "")
    assert World.load(tmp_path / "copy.yaml") == World.load(yard)
    assert shell("worlds", "convert", yard, tmp_path / "copy.yml", "--robot", "disc:0.2").status == 0
    assert World.load(tmp_path / "copy.yml") == World.load(yard).with_robot(Robot.disc(0.2))


def test_masks_become_zones_of_the_world(shell: Shell, yard: Path, mask: Path, tmp_path: Path) -> None:
    site, path = tmp_path / "site.yaml", tmp_path / "path.csv"
    words = ("worlds", "convert", yard, site, "--keepout", mask, "--speed-mask", mask, "--max-speed", "0.5")
    assert shell(*words) == (0, "", "")
    zones = World.load(site).zones
    assert [zone.kind for zone in zones] == ["keep-out", "speed"]
    assert zones[1].limit == pytest.approx(0.3)  # type: ignore[union-attr]
    assert "  zones      2 (1 keep-out, 1 speed)" in shell("worlds", "show", site).out.splitlines()
    path.write_text("x,y,theta\n1,1,0\n9,1,0\n")
    found = json.loads(shell("check", site, path, "--json").out)
    assert "keep-out zone 0" in [collision["obstacle"] for collision in found["collisions"]]
    # The same path is planned around the mask that plan is given itself.
    planned = shell(
        "plan", yard, "--robot", "disc:0.2", "--keepout", mask, "--start", "1,1,0", "--goal", "9,1,0", "--json"
    )
    around = World.load(yard).with_mask(mask)
    assert check_path(around, Robot.disc(0.2), json.loads(planned.out)["states"]).free


def test_a_keep_out_mask_beside_the_map_is_warned_of(shell: Shell, yard: Path, mask: Path, tmp_path: Path) -> None:
    text = mask.read_text()
    for moved in (text.replace("origin: [0, 0, 0]", "origin: [50, 0, 0]"), text):
        mask.write_text(moved)
        if moved == text:  # nothing is occupied
            Image.fromarray(np.full((6, 10), 255, dtype=np.uint8)).save(mask.with_name("mask.pgm"))
        run = shell("worlds", "convert", yard, tmp_path / "site.yaml", "--keepout", mask)
        assert (run.status, run.err.count("\n")) == (0, 1)
        assert "the keep-out mask covers nothing of the map" in run.err
