"""trailmark worlds: list, show, convert, schema."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from trailmark.world import Robot, World, library

Shell = Callable[..., Any]


@pytest.mark.slow
def test_list_names_every_shipped_world(shell: Shell) -> None:
    run = shell("worlds")
    assert (run.status, run.err) == (0, "")
    head, *rows = run.out.splitlines()
    assert head.split() == ["NAME", "SIZE", "OBSTACLES", "QUERIES", "ROBOT"]
    assert [row.split()[0] for row in rows] == sorted(library.shipped_worlds())


@pytest.mark.slow
def test_list_as_json(shell: Shell) -> None:
    listed = json.loads(shell("worlds", "--json").out)["worlds"]
    assert [facts["name"] for facts in listed] == sorted(library.shipped_worlds())
    office = World.load(library.find_world("office"))
    (facts,) = (facts for facts in listed if facts["name"] == "office")
    assert facts["bounds"] == list(office.bounds)
    assert facts["obstacles"] == len(office.obstacles) == sum(facts["kinds"].values())
    assert [query["name"] for query in facts["queries"]] == [query.name for query in office.queries]


def test_show_as_json(shell: Shell, yard: Path) -> None:
    facts = json.loads(shell("worlds", "show", yard, "--json", "--robot", "disc:0.25").out)
    assert facts["robot"] == "disc 0.25 m"
    assert facts["queries"][0] == {"name": "across", "start": [1.0, 1.0, 0.0], "goal": [9.0, 5.0, 1.5]}


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")])
def test_show_draws(shell: Shell, yard: Path, tmp_path: Path, suffix: str, magic: bytes) -> None:
    picture = tmp_path / f"yard{suffix}"
    run = shell("worlds", "show", yard, "--plot", picture)
    assert run.status == 0
    assert str(picture) in run.out
    assert picture.read_bytes().startswith(magic)


def test_convert_keeps_the_world(shell: Shell, yard: Path, tmp_path: Path) -> None:
    run = shell("worlds", "convert", yard, tmp_path / "copy.yaml")
    assert run == (0, "", "")
    assert World.load(tmp_path / "copy.yaml") == World.load(yard)


def test_convert_with_another_robot(shell: Shell, yard: Path, tmp_path: Path) -> None:
    assert shell("worlds", "convert", yard, tmp_path / "copy.yml", "--robot", "disc:0.2").status == 0
    assert World.load(tmp_path / "copy.yml").robot == Robot.disc(0.2)


def test_convert_reads_other_formats(shell: Shell, tmp_path: Path, shared_data: Path) -> None:
    source = shared_data / "nav2" / "tb3_sandbox.yaml"
    assert shell("worlds", "convert", source, tmp_path / "map.yaml").status == 0
    assert World.load(tmp_path / "map.yaml").obstacles == World.load(source).obstacles


def test_schema_is_a_json_schema_of_worlds(shell: Shell) -> None:
    schema = json.loads(shell("worlds", "schema").out)
    assert "json-schema.org" in schema["$schema"]
    assert {"trailmark", "name", "bounds", "robot", "boundary", "obstacles", "queries"} <= set(schema["properties"])
