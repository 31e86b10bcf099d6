"""What results were measured with (``benchmarks/age.py``), and which of them the code has left behind."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks.age import AGE, ROOT, changed_files, code_digest, dependencies, describe_code
from benchmarks.stale import stale

SOURCES = {
    "benchmarks/__init__.py": "",
    "benchmarks/speed.py": "from trailmark import Wheel\nfrom benchmarks.cases import CASES",
    "benchmarks/cases.py": "def cases():\n    from trailmark.ground import Floor\n",
    "benchmarks/shell.py": "import subprocess",
    "benchmarks/whole.py": "import trailmark",
    "benchmarks/module.py": "from trailmark.car.wheel import Wheel",
    "benchmarks/workers.py": "PROGRAM = 'from trailmark.ground import Floor'\nCOMMAND = ['-m', 'trailmark.shell']",
    "src/trailmark/__init__.py": "from trailmark.car import Wheel\nfrom trailmark.sky import Cloud",
    "src/trailmark/car/__init__.py": "from trailmark.car.wheel import Wheel\nfrom trailmark.car.brake import Brake",
    "src/trailmark/car/wheel.py": "from trailmark.units import METRE\n\n\nclass Wheel:\n    '''Turns.'''\n",
    "src/trailmark/car/brake.py": "",
    "src/trailmark/ground.py": "class Floor: ...",
    "src/trailmark/shell.py": "",
    "src/trailmark/sky.py": "class Cloud: ...",
    "src/trailmark/units.py": "METRE = 1",
}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A small project of the same layout, committed."""
    for name, text in SOURCES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
        # As if they were there before this process began.
        os.utime(tmp_path / name, (0, 0))
    (tmp_path / "benchmarks" / "results").mkdir()
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "first"]):
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *words], cwd=tmp_path, check=True)
    return tmp_path


@pytest.fixture(autouse=True)
def _fresh() -> None:
    code_digest.cache_clear()
    describe_code.cache_clear()


def test_dependencies_are_followed(checkout: Path) -> None:
    package = {"trailmark.car", "trailmark.car.wheel", "trailmark.car.brake", "trailmark.units"}
    asked = {"benchmarks.speed", "benchmarks.cases", "trailmark.ground"}
    assert set(dependencies("benchmarks.speed", checkout)) == package | asked
    module = {"benchmarks.module", "trailmark.car.wheel", "trailmark.units"}
    assert set(dependencies("benchmarks.module", checkout)) == module


def test_programs_within_texts_count(checkout: Path) -> None:
    found = dependencies("benchmarks.workers", checkout)
    assert set(found) == {"benchmarks.workers", "trailmark.ground", "trailmark.shell"}


def test_who_imports_nothing_runs_all(checkout: Path) -> None:
    assert len(dependencies("benchmarks.shell", checkout)) == 1 + 8
    assert len(dependencies("benchmarks.whole", checkout)) == 1 + 8


def test_what_shows_itself_depends_on_nobody_who_draws_it(checkout: Path) -> None:
    (checkout / "src/trailmark/shown.py").write_text("def show():\n    from trailmark.plotting import Wheel\n")
    (checkout / "src/trailmark/plotting.py").write_text("")
    (checkout / "benchmarks/shown.py").write_text("from trailmark.shown import show")
    (checkout / "benchmarks/drawn.py").write_text("from trailmark.shown import show\nimport trailmark.plotting")
    assert "trailmark.plotting" not in dependencies("benchmarks.shown", checkout)
    assert "trailmark.plotting" in dependencies("benchmarks.drawn", checkout)


@pytest.mark.parametrize(
    ("file", "text", "changes"),
    [
        (
            "src/trailmark/car/wheel.py",
            "from trailmark.units import METRE\nclass Wheel:\n    'Rolls.' # not the same\n",
            False,
        ),
        ("src/trailmark/car/wheel.py", "from trailmark.units import METRE\nclass Wheel: size = 1\n", True),
        ("src/trailmark/car/brake.py", "x = 1", True),
        ("src/trailmark/units.py", "METRE = 2", True),
        ("benchmarks/cases.py", "CASES = 1", True),
        ("src/trailmark/sky.py", "x = 1", False),
        ("benchmarks/shell.py", "x = 1", False),
    ],
)
def test_the_digest_changes_with_the_code(checkout: Path, file: str, text: str, changes: bool) -> None:
    before = code_digest("benchmarks.speed", checkout)
    (checkout / file).write_text(text)
    code_digest.cache_clear()
    assert (code_digest("benchmarks.speed", checkout) != before) == changes


def test_the_words_of_errors_are_no_code(checkout: Path) -> None:
    units = checkout / "src/trailmark/units.py"

    def digest(statement: str) -> str:
        units.write_text(f"METRE = 1\ndef metre(x):\n    {statement}")
        code_digest.cache_clear()
        return code_digest("benchmarks.speed", checkout)

    assert digest("raise ValueError(f'not {x} m')") == digest("raise ValueError(f'expected metres, got {x}')")
    assert digest("raise ValueError(f'not {x} m')") != digest("raise ValueError(f'not {-x} m')")
    assert digest("raise ValueError('m')") != digest("raise KeyError('m')")
    assert digest("return 'm'") != digest("return 'metre'")


def test_results_are_listed_when_the_code_has_changed(checkout: Path) -> None:
    results = checkout / "benchmarks" / "results"
    age = describe_code("benchmarks.speed", checkout)
    (results / "speed.json").write_text(f'{{"machine": "here; {age}"}}')
    (results / "old").mkdir()
    (results / "old" / "a.md").write_text("| 1 |")
    assert stale(checkout) == {"old/a.md": "names no code"}
    (checkout / "src/trailmark/units.py").write_text("METRE = 2")
    code_digest.cache_clear()
    commit = re.search(r"commit (\w{12}),", age)
    assert commit is not None
    changed = f"benchmarks.speed has changed since commit {commit[1]}"
    assert stale(checkout)["speed.json"] == f"{changed}: src/trailmark/units.py"


def test_files_with_other_code_are_named(checkout: Path) -> None:
    (checkout / "src/trailmark/units.py").write_text("METRE = 1  # in metres")
    (checkout / "src/trailmark/sky.py").write_text("class Cloud: colour = 1")
    (checkout / "src/trailmark/car/brake.py").write_text("from trailmark.car.disc import Disc")
    (checkout / "src/trailmark/car/disc.py").write_text("class Disc: ...")
    assert changed_files("benchmarks.speed", "HEAD", checkout) == [
        "src/trailmark/car/brake.py",
        "src/trailmark/car/disc.py",
    ]
    assert changed_files("benchmarks.speed", "0123456789ab", checkout) is None


@pytest.mark.parametrize("commit", ["HEAD", "HEAD with changes", "0123456789ab"])
@pytest.mark.parametrize("metre", ["1", "2"])
def test_a_digest_of_other_files_counts_only_where_git_does_not_know_the_code(
    checkout: Path, commit: str, metre: str
) -> None:
    # As if other files had counted as dependencies then.
    age = f"measured by benchmarks.speed at commit {commit}, code {'0' * 16}"
    (checkout / "benchmarks" / "results" / "speed.md").write_text(age)
    (checkout / "src/trailmark/units.py").write_text(f"METRE = {metre}")
    assert ("speed.md" in stale(checkout)) == (commit != "HEAD" or metre == "2")


@pytest.mark.slow
def test_programs_that_smooth_or_time_paths_depend_on_trajectories() -> None:
    def asks(file: Path) -> bool:
        return re.search(r"(?<!results)\.(smooth|timed)\(", file.read_text()) is not None

    assert "trailmark.trajectories.smooth" not in dependencies("benchmarks.ahead")
    programs = [file for file in (ROOT / "benchmarks").rglob("*.py") if asks(file)]
    assert programs == [ROOT / "benchmarks" / "trajectories.py"]
    assert "trailmark.trajectories.smooth" in dependencies("benchmarks.trajectories")
    within = {file.relative_to(ROOT / "src" / "trailmark").parts[0] for file in ROOT.glob("src/**/*.py") if asks(file)}
    # Of which no benchmark has a part but through the shell, and so depends on all.
    assert within == {"cli"}


def test_many_changed_files_are_counted(checkout: Path) -> None:
    age = describe_code("benchmarks.whole", checkout)
    (checkout / "benchmarks" / "results" / "whole.md").write_text(age)
    for name in ("units", "sky", "shell", "ground"):
        (checkout / f"src/trailmark/{name}.py").write_text("x = 1")
    code_digest.cache_clear()
    assert stale(checkout)["whole.md"].endswith(": 4 files")


def test_changes_since_the_commit_are_told(checkout: Path) -> None:
    (checkout / "src/trailmark/units.py").write_text("METRE = 1.0")
    os.utime(checkout / "src/trailmark/units.py", (0, 0))
    age = AGE.search(describe_code("benchmarks.speed", checkout).encode())
    assert age is not None
    assert age["commit"].endswith(b" with changes")
    assert age["code"].decode() == code_digest("benchmarks.speed", checkout)


def test_code_that_changed_while_the_program_ran_is_not_vouched_for(checkout: Path) -> None:
    os.utime(checkout / "src/trailmark/units.py", (2**33, 2**33))
    assert AGE.search(describe_code("benchmarks.speed", checkout).encode()) is None


@pytest.mark.slow
def test_a_program_knows_its_name() -> None:
    # As with python -m: __main__ is the benchmark's file, here of one that depends on little.
    code = f"import sys; sys.modules['__main__'].__file__ = {str(ROOT / 'benchmarks/ablation_report.py')!r}\n"
    code += "from benchmarks.age import describe_code; print(describe_code())"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60
    )
    assert AGE.search(done.stdout.encode())
    assert "measured by benchmarks.ablation_report at commit" in done.stdout


def test_every_program_that_writes_results_describes_the_machine() -> None:
    programs = [*(ROOT / "benchmarks").glob("*.py"), ROOT / "benchmarks" / "soundness" / "__main__.py"]
    writing = {file for file in programs if re.search(r"RESULTS\b.*(write|savefig)|write.*RESULTS\b", file.read_text())}
    assert len(writing) > 20
    for file in writing:
        text = file.read_text()
        if "describe_machine" not in text:
            imported = re.findall(r"from (benchmarks[\w.]*) import", text)
            others = [ROOT.joinpath(*module.split(".")).with_suffix(".py") for module in imported]
            assert any("describe_machine" in other.read_text() for other in others if other.is_file()), file
