"""The report as text: complete, self-contained, safe whatever the database holds; and its tables in Markdown."""

from __future__ import annotations

import base64
import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from tests.helpers.made_results import START, random_results, run, write_results

from trailmark.benchmark.report import html_report, load_results, markdown_report
from trailmark.benchmark.report.tables import Table
from trailmark.sketch.svg import points

PLANNERS = ["landmark", "PRM", "PRM+certified", "native:PRM", "RRTstar", "RRTstar+certified", "RRTConnect"]
VOID = {"meta", "link", "br", "wbr", "input"}


class Page(HTMLParser):
    """Checks that elements are closed in order; notes ids, references and what is loaded from elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []
        self.loaded: list[str] = []
        self.tags: dict[str, int] = {}
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] = self.tags.get(tag, 0) + 1
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("href", "src", "srcset", "action", "data", "xlink:href"):
                (self.references if (value or "").startswith("#") else self.loaded).append(value or "")
            assert not name.startswith("on"), f"{tag} runs a script"
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return random_results(tmp_path_factory.mktemp("results") / "some.db", PLANNERS, problems=3, runs=6)


@pytest.fixture(scope="module")
def text(database: Path) -> str:
    return html_report(load_results(database))


@pytest.mark.slow
def test_the_page_is_whole_and_asks_for_nothing(text: str) -> None:
    page = Page(text)
    assert page.loaded == ["data:,"]
    assert page.tags["script"] == 3, "two of data, and its own"
    assert not re.search(r"https?:|@import|url\((?!#)", text.replace("url(#${clip})", ""))
    # References to parts of the page find them.
    assert {r[1:] for r in page.references} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))


def test_only_its_own_script_may_run(text: str) -> None:
    own = re.search(r"<script>(.*?)</script>", text, re.DOTALL)
    assert own is not None
    digest = base64.b64encode(hashlib.sha256(own[1].encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'" in text
    # What a database holds is compressed: no text in it can end the element.
    data = re.findall(r'<script type="text/plain" id="\w+">([^<]*)</script>', text)
    assert len(data) == 2
    assert all(re.fullmatch(r"[A-Za-z0-9+/=]+", part) for part in data)


def test_all_that_was_asked_for_is_there(text: str) -> None:
    for words in ("Summary", "Charts", "Who is ahead of whom", "Environment", "Holm", "van Elteren", "Wilson", "Dolan"):
        assert words in text
    for words in ("Starting the process", "2048", "3.11.7", "a processor, 2 cores", "@media print"):
        assert words in text


@pytest.mark.slow
def test_the_same_database_gives_the_same_page(database: Path, text: str) -> None:
    assert html_report(load_results(database)) == text


def test_names_from_the_database_are_only_text(tmp_path: Path) -> None:
    evil = '<script>alert("1")</script>'
    rows = [run(0, 0.1, 10.0), run(1, None, failure=evil)]
    file = write_results(tmp_path / "r.db", {evil: {evil: rows, "PRM|*": rows}}, text=evil, hostname=evil)
    results = load_results(file)
    page = Page(html_report(results))
    assert page.tags["script"] == 3
    assert evil not in html_report(results)
    assert "PRM\\|*" in markdown_report(results)


@pytest.mark.parametrize("planners", [["landmark"], ["landmark", "PRM"]])
def test_the_smallest_benchmarks(tmp_path: Path, planners: list[str]) -> None:
    problems = {"yard": {name: [run(0, 0.1, 10.0)] for name in planners}}
    results = load_results(write_results(tmp_path / "r.db", problems))
    Page(html_report(results))
    assert "# Benchmark: r" in markdown_report(results)


def test_nothing_solved_is_reported_too(tmp_path: Path) -> None:
    problems = {"yard": {name: [run(k, None) for k in range(3)] for name in ("landmark", "PRM")}}
    text = html_report(load_results(write_results(tmp_path / "r.db", problems)))
    Page(text)
    assert "no run of any planner" in text


def test_a_path_of_cost_nothing_is_no_trouble(tmp_path: Path) -> None:
    rows = [run(k, 0.001, 0.0, path=[START, START]) for k in range(3)]
    Page(html_report(load_results(write_results(tmp_path / "r.db", {"yard": {"landmark": rows}}))))


@pytest.mark.slow
def test_markdown_tables_line_up(database: Path) -> None:
    text = markdown_report(load_results(database))
    tables = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    assert len(tables) == 3 + 3 + 2 + 3
    for table in tables:
        lines = table.splitlines()
        assert len({len(line) for line in lines}) == 1
        assert re.fullmatch(r"\|(-+:?\|)+", lines[1])
    assert text.count("▲") == text.count("▼") > 1
    assert not re.search(r"[^\S\n]+$", re.sub(r"^\|.*$", "", text, flags=re.MULTILINE), re.MULTILINE)


def test_a_table_by_hand() -> None:
    table = Table("t", ["planner", "ms"], [["PRM", "1.0"], ["RRT", "12.5"]])
    assert table.markdown() == "| planner |   ms |\n|---------|-----:|\n| PRM     |  1.0 |\n| RRT     | 12.5 |"


def test_lines_of_few_characters() -> None:
    assert points([0.0, 1.0, 2.0, 2.0], [0.0, 0.0, 0.0, -1.25]) == "M0 0l2 0 0-1.2"
    assert points([0.0, 1.0, 0.5], [0.0, 0.0, 0.04], closed=True) == "M0 0l1 0-.5 0z"
    assert points([], []) == ""
