"""The report as text: complete, self-contained, safe whatever the database holds; and its tables in Markdown."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from tests.benchmark.report.made_results import GOAL, START, random_results, run, write_results

from trailmark.benchmark.report import html_report, load_results, markdown_report
from trailmark.benchmark.report.figures import panels
from trailmark.benchmark.report.tables import Table
from trailmark.benchmark.report.worlds import scene_of
from trailmark.sketch.svg import Scale, points

PLANNERS = ["landmark", "PRM", "PRM+certified", "native:PRM", "RRTstar", "RRTstar+certified", "RRTConnect"]
VOID = {"meta", "link", "br", "wbr"}


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


def test_the_page_is_whole_and_asks_for_nothing(text: str) -> None:
    page = Page(text)
    assert page.loaded == ["data:,"]
    assert "script" not in page.tags
    assert not re.search(r"https?:|@import|url\((?!#)", text)
    # References to parts of the page find them; clip paths of one world's pictures are the same.
    assert {r[1:] for r in page.references} <= set(page.ids)
    assert set(re.findall(r"url\(#(\w+)\)", text)) <= set(page.ids)


def test_every_drawing_is_well_formed_and_described(text: str) -> None:
    drawings = re.findall(r'<svg [^>]*class="chart.*?</svg>', text, re.DOTALL)
    # Three of rows, three panels each of lines, for all and for each problem; and the worlds.
    assert len(drawings) == (3 + 3 + 3) * 4 + 3 * 3
    for drawing in drawings:
        root = ET.fromstring(drawing)  # noqa: S314  # our own text
        assert root.get("aria-label")
        assert root.get("role") == "img"
        assert root.findall(".//*[@class]")
    assert "nan" not in re.sub(r'aria-label="[^"]*"', "", "".join(drawings)).lower()


def test_all_that_was_asked_for_is_there(text: str) -> None:
    for words in ("Summary", "Success rate", "Time to the first path", "Runs with a path", "Cost against time"):
        assert words in text
    for words in (
        "Cost ratio to the best known",
        "Who is ahead of whom",
        "Environment",
        "Holm",
        "van Elteren",
        "Wilson",
    ):
        assert words in text
    for words in (
        "Starting the process",
        "2048",
        "3.11.7",
        "a processor, 2 cores",
        f"{0:064x}",
        "0 to 5",
        "@media print",
    ):
        assert words in text
    assert text.count('<details class="problem"') == 3


def test_the_same_database_gives_the_same_page(database: Path, text: str) -> None:
    assert html_report(load_results(database)) == text


def test_names_from_the_database_are_only_text(tmp_path: Path) -> None:
    evil = '<script>alert("1")</script>'
    rows = [run(0, 0.1, 10.0), run(1, None, failure=evil)]
    file = write_results(tmp_path / "r.db", {evil: {evil: rows, "PRM|*": rows}}, text=evil, hostname=evil)
    results = load_results(file)
    page = Page(html_report(results))
    assert "script" not in page.tags
    assert "holds no world" in html_report(results)
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


def test_reasons_of_failures_are_reported_together(tmp_path: Path) -> None:
    rows = [run(k, None, failure="killed by signal 11") for k in range(3)]
    text = html_report(load_results(write_results(tmp_path / "r.db", {"yard": {"A": [*rows, run(3, 0.1, 9.0)]}})))
    assert text.count("killed by signal 11") == 1
    assert "Reasons of failures" in text


def test_a_path_of_cost_nothing_is_no_trouble(tmp_path: Path) -> None:
    rows = [run(k, 0.001, 0.0, path=[START, START]) for k in range(3)]
    Page(html_report(load_results(write_results(tmp_path / "r.db", {"yard": {"landmark": rows}}))))


def test_many_problems_and_planners_stay_small(tmp_path: Path) -> None:
    algorithms = [f"Planner{i}" for i in range(14)]
    names = ["landmark", *algorithms, *(f"{a}+certified" for a in algorithms), "native:Planner0"]
    text = html_report(load_results(random_results(tmp_path / "r.db", names, problems=3, runs=12)))
    # 60 problems of these are then below 10 MB: each has the same share but for what all of them share.
    assert len(text.encode()) / 4 * 61 < 11e6


def test_markdown_tables_line_up(database: Path) -> None:
    text = markdown_report(load_results(database))
    tables = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    assert len(tables) == 3 + 3 + 3
    for table in tables:
        lines = table.splitlines()
        assert len({len(line) for line in lines}) == 1
        assert re.fullmatch(r"\|(-+:?\|)+", lines[1])
    assert text.count("▲") == text.count("▼") > 1
    assert not re.search(r"[^\S\n]+$", re.sub(r"^\|.*$", "", text, flags=re.MULTILINE), re.MULTILINE)


def test_a_table_by_hand() -> None:
    table = Table("t", ["planner", "ms"], [["PRM", "1.0"], ["RRT", "12.5"]])
    assert table.markdown() == "| planner |   ms |\n|---------|-----:|\n| PRM     |  1.0 |\n| RRT     | 12.5 |"


def test_panels_keep_landmark_in_sight() -> None:
    assert panels(["landmark", "PRM", "RRT+certified"]) == [("", ["landmark", "PRM", "RRT+certified"])]
    found = panels(PLANNERS)
    assert [names for _, names in found] == [
        ["landmark", "PRM", "RRTstar", "RRTConnect"],
        ["landmark", "PRM+certified", "RRTstar+certified"],
        ["landmark", "native:PRM"],
    ]


def test_scales_and_ticks() -> None:
    assert Scale(0.0, 1.0, 10.0, 20.0).at([0.0, 0.5, 2.0, np.inf]).tolist() == [10.0, 15.0, 20.0, 20.0]
    assert Scale(0.01, 1.0, 0.0, 100.0, log=True).at([0.01, 0.1, 1.0]).tolist() == pytest.approx([0.0, 50.0, 100.0])
    assert Scale(0.01, 1.0, 0.0, 1.0, log=True).ticks(3) == pytest.approx([0.01, 0.1, 1.0])
    assert Scale(0.0, 1.0, 0.0, 1.0).ticks(4) == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    assert Scale(0.97, 1.02, 0.0, 1.0).ticks(5) == pytest.approx([0.97, 0.98, 0.99, 1.0, 1.01, 1.02])


def test_lines_of_few_characters() -> None:
    assert points([0.0, 1.0, 2.0, 2.0], [0.0, 0.0, 0.0, -1.25]) == "M0 0l2 0 0-1.2"
    assert points([0.0, 1.0, 0.5], [0.0, 0.0, 0.04], closed=True) == "M0 0l1 0-.5 0z"
    assert points([], []) == ""


def test_a_world_is_drawn_to_scale() -> None:
    from tests.benchmark.report.made_results import WORLD

    scene = scene_of(WORLD, 1)
    assert scene is not None
    ET.fromstring(scene.background())  # noqa: S314  # our own text
    drawn = scene.picture({}, {}, None, [np.array([START, GOAL])], "yard")
    # 10.4 m are 400 units wide: the refused way begins 1.2 m from the left and 5.2 m below the top.
    x, y = 1.2 / 10.4 * 400.0, 5.2 / 10.4 * 400.0
    refused = re.search(r'<path d="M(\S+) (\S+?)l[^"]*" class="refused', drawn)
    assert refused is not None
    assert (float(refused[1]), float(refused[2])) == pytest.approx((x, y), abs=0.06)
    assert scene_of("trailmark: 1", 1) is None
