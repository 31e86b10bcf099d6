"""The README and the pages of the documentation: what they show is run in its order, in little time.

It is run as it stands, but that runs are not repeated, that plans are not improved for long, and that what several
pages show is run for one of them.
"""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

import pytest
import yaml
from tests.helpers.processes import run_in_turn
from tests.helpers.trials import briefly

from trailmark import World

ROOT = Path(__file__).resolve().parents[3]
DOCS = ROOT / "docs"
BUILT = {"api", "gallery"}
PAGES = [ROOT / "README.md", *(page for page in sorted(DOCS.rglob("*.md")) if page.parts[len(DOCS.parts)] not in BUILT)]
SETUP = "python3 -m venv"
LIMIT = 400.0
"""Seconds for one page, on a machine that does other work as well."""

PLANNING, EXPLORING, RUN = 0.1, 0.3, 0.2
"""Seconds that a page's programs may plan and explore and a benchmark's run may last; on the page they are more."""
LONGER = 5.0
"""So many times as long, where that does not do: in tight places, or on a busy machine."""
FEWER = {"max_range=12.0": "max_range=5.0"}
"""What a simulated drive's log is of on the pages, and what it is of here: fewer things are seen at once."""
WRITING = ("--plot", "--output", "--html", "--trajectory", "--animate")
"""The options that name a file to be written."""
ONCE = ["--runs", "1"]
"""How often a benchmark's runs and executions of landmarks are repeated."""


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def blocks(page: Path) -> list[tuple[str, str]]:
    """Return the languages and texts of a page's blocks; figures that the build draws are Python."""
    found = re.findall(r"^```(\w+|\{plot\})\n(.*?)^```", page.read_text(), flags=re.S | re.M)
    return [("python" if language == "{plot}" else language, text) for language, text in found]


def runnable(page: Path) -> list[list[str]]:
    """Return what python is given for each program of a page: snippets, and commands that end by themselves."""
    found = []
    for language, text in blocks(page):
        if language == "python":
            found.append(["-c", text])
        elif language == "sh":
            lines = [line for line in text.splitlines() if line.startswith("trailmark ")]
            found += [["-m", *shlex.split(line)] for line in lines if not line.startswith("trailmark live")]
    return found


def shortly(words: list[str], times: float = 1.0) -> list[str]:
    """Return a program that does the same in less time, or in so many times as much."""
    if words[0] == "-c":
        first, text = times * (EXPLORING if "explor" in words[1] else PLANNING), words[1]
        for said, instead in FEWER.items():
            text = text.replace(said, instead)
        return ["-c", briefly(text, first)]
    limits = {"plan": PLANNING, "explore": EXPLORING, "benchmark": RUN}
    short = list(words)
    if words[2] in limits:
        if "--time-limit" not in words:
            short += ["--time-limit", "1e9"]
        place = short.index("--time-limit") + 1
        short[place] = str(min(float(short[place]), times * limits[words[2]]))
    if "--runs" in words:
        short[(place := short.index("--runs")) : place + 2] = ONCE
    elif words[2] == "landmarks":
        short += ONCE
    return short


def written(words: list[str]) -> list[str]:
    """Return the names of the files that a command writes."""
    return [words[words.index(flag) + 1] for flag in WRITING if flag in words]


def programs(page: Path) -> list[list[str]]:
    """Return what is run for a page: what no page after it shows too, and what that needs."""
    after = [shortly(words) for other in PAGES[PAGES.index(page) + 1 :] for words in runnable(other)]
    chosen: list[list[str]] = []
    for words in reversed(runnable(page)):
        needed = any(file in " ".join(later) for file in written(words) for later in chosen)
        if needed or words[0] == "-c" or shortly(words) not in after:
            chosen.insert(0, words)
    return chosen


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if programs(page)], ids=name_of)
def test_what_a_page_shows_runs(page: Path, tmp_path: Path) -> None:
    (tmp_path / "worlds").symlink_to(ROOT / "worlds")
    versions = [[shortly(whole), shortly(whole, LONGER), whole] for whole in programs(page)]
    for words, printed in run_in_turn(versions, timeout=LIMIT, cwd=tmp_path):
        assert printed.strip() or words[0] == "-c", words
        assert all((tmp_path / file).stat().st_size > 0 for file in written(list(words)))


def test_every_kind_of_page_has_something_to_run() -> None:
    with_programs = [page for page in PAGES if runnable(page)]
    assert len(with_programs) >= 20
    assert all(page in with_programs for page in DOCS.glob("tutorials/*.md"))
    assert sum(len(runnable(page)) for page in PAGES) >= 50


def test_the_two_commands_set_up_everything_themselves() -> None:
    text = [line for language, text in blocks(ROOT / "README.md") for line in text.splitlines() if language == "sh"]
    commands = [line for line in text if line.startswith(SETUP)]
    assert len(commands) == 2
    assert "trailmark plan worlds/office.yaml --plot" in commands[0]
    assert "pytest" in commands[1]
    assert all("-c constraints.txt" in command for command in commands)


def test_the_world_file_is_valid(tmp_path: Path) -> None:
    ((_, text),) = [block for block in blocks(DOCS / "reference" / "world_files.md") if block[0] == "yaml"]
    file = tmp_path / "yard.yaml"
    file.write_text(text)
    world = World.load(file)
    assert world.name == yaml.safe_load(text)["name"]
    assert len(world.obstacles) == 3


def test_no_file_names_an_index_or_a_machine() -> None:
    for page in [ROOT / "constraints.txt", *PAGES]:
        text = page.read_text().replace("http://127.0.0.1", "")
        assert "://" not in text, page
        assert os.sep + "work" + os.sep not in text, page


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_and_pictures_lead_to_files(page: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", re.sub(r"```.*?```", "", page.read_text(), flags=re.S))
    for link in links:
        # The gallery is made of the examples when the documentation is built.
        made = re.sub(r"(?:\.\./)*gallery/(\w+)$", rf"{ROOT}/examples/\1.py", link).replace(
            "index.py", "GALLERY_HEADER.rst"
        )
        assert (page.parent / made).exists(), f"{name_of(page)}: {link}"
