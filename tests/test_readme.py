"""The README's snippets are run as they stand."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from trailmark import World

ROOT = Path(__file__).resolve().parents[1]
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.S)
SETUP = "python3 -m venv"


def blocks(language: str) -> list[str]:
    return [text for kind, text in BLOCKS if kind == language]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder in which the README's relative paths lead somewhere."""
    (tmp_path / "worlds").symlink_to(ROOT / "worlds")
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("snippet", blocks("python"))
def test_python_snippets_run(snippet: str, checkout: Path) -> None:
    done = subprocess.run([sys.executable, "-c", snippet], cwd=checkout, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


LINES = [line for text in blocks("sh") for line in text.splitlines() if line.startswith("trailmark ")]
COMMANDS = [line for line in LINES if not line.startswith("trailmark live")]
"""What ends by itself; tests/live runs the rest."""

BEFORE = {
    "report": ["trailmark benchmark office --query door -p landmark --runs 1 --time-limit 0.2 --output results.db"],
    "check": ["trailmark plan worlds/office.yaml --query door --output path.csv"],
    "map": ["trailmark-python drive.jsonl"],
    "plan MAP.yaml": ["trailmark-python drive.jsonl", next(line for line in COMMANDS if "--output MAP.yaml" in line)],
}
"""What the lines before a command make in the README, made for each command anew; the benchmark is a smaller one."""


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    program, *words = shlex.split(command)
    if program == "trailmark-python":
        (snippet,) = [text for text in blocks("python") if words[0] in text]
        line = [sys.executable, "-c", snippet]
    else:
        line = [str(Path(sys.executable).with_name("trailmark")), *words]
    return subprocess.run(line, cwd=folder, capture_output=True, text=True, timeout=120)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_shell_snippets_run(command: str, checkout: Path) -> None:
    for start, needed in BEFORE.items():
        if command.startswith(f"trailmark {start}"):
            for line in needed:
                made = run(line, checkout)
                assert made.returncode == 0, made.stderr
    done = run(command, checkout)
    words = shlex.split(command)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    for flag in ("--plot", "--output", "--html"):
        if flag in words:
            assert (checkout / words[words.index(flag) + 1]).stat().st_size > 0


def test_the_two_commands_set_up_everything_themselves() -> None:
    commands = [line for text in blocks("sh") for line in text.splitlines() if line.startswith(SETUP)]
    assert len(commands) == 2
    assert "trailmark plan worlds/office.yaml --plot" in commands[0]
    assert "pytest" in commands[1]
    assert all("-c constraints.txt" in command for command in commands)


def test_the_world_file_is_valid(tmp_path: Path) -> None:
    (text,) = blocks("yaml")
    file = tmp_path / "yard.yaml"
    file.write_text(text)
    world = World.load(file)
    assert world.name == yaml.safe_load(text)["name"]
    assert len(world.obstacles) == 3


def test_no_file_names_an_index_or_a_machine() -> None:
    text = (ROOT / "constraints.txt").read_text() + (ROOT / "README.md").read_text()
    assert "://" not in text
    assert os.sep + "work" + os.sep not in text


def test_the_pictures_are_there() -> None:
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", (ROOT / "README.md").read_text())
    assert len(pictures) >= 2
    assert all((ROOT / picture).stat().st_size > 10_000 for picture in pictures)
