"""The report's page: its figures are those of the runs, it loads nothing, and its charts are drawn."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
from tests.helpers.chromium import browser, program
from tests.helpers.made_results import random_results, run, write_results

from trailmark.benchmark.report import html_report, ranked
from trailmark.benchmark.results import load_results


class Cells(HTMLParser):
    """The rows of all tables of a page, as texts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.loads: list[str] = []
        self._cell = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._cell = tag in ("td", "th")
        if tag == "tr":
            self.rows.append([])
        if self._cell:
            self.rows[-1].append("")
        self.loads += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag: str) -> None:
        self._cell = False

    def handle_data(self, data: str) -> None:
        if self._cell:
            self.rows[-1][-1] += data


@pytest.fixture
def small(tmp_path: Path) -> Path:
    fast = [run(seed, 0.1, 10.0) for seed in range(4)]
    slow = [run(seed, 0.4, 20.0) for seed in range(3)] + [run(3, None)]
    wrong = [run(seed, 0.2, 5.0, correct_solution=False) for seed in range(4)]
    return write_results(tmp_path / "r.db", {"<yard>": {"slow": slow, "fast": fast, "wrong": wrong}})


def test_the_ranking_is_of_the_runs(small: Path) -> None:
    results = load_results(small)
    assert ranked(results) == ["fast", "slow", "wrong"]
    page = Cells(html_report(results))
    ranking = {row[0]: row for row in page.rows[1:4]}
    assert ranking["fast"][1:6] == ["4 of 4", "51 to 100 %", "0", "0.1", "0.1"]
    assert ranking["slow"][1:4] == ["3 of 4", "30 to 95 %", "0"]
    assert ranking["slow"][7:] == ["2", "2 (2 to 2)"]
    assert ranking["wrong"][1:5] == ["0 of 4", "0 to 49 %", "4", "–"]
    # Seconds to the first path, failures at the limit of 1 s: (4 · 4 · 4 · 10)^(1/4).
    assert float(ranking["slow"][6].split()[0]) == pytest.approx(640 ** (1 / 4), rel=1e-2)
    failures = next(row for row in page.rows if row[0] == "wrong" and "refused" in row[1])
    assert failures[1] == "4 refused by the referee"


def test_the_page_is_whole_and_asks_for_nothing(small: Path, tmp_path: Path) -> None:
    for file in (small, random_results(tmp_path / "m.db", ["landmark", "PRM", "native:RRT"], problems=3, runs=6)):
        text = html_report(load_results(file))
        assert text == html_report(load_results(file))
        page = Cells(text)
        assert all(link.startswith(("#", "data:")) for link in page.loads)
        charts = re.findall(r"<svg.*?</svg>", text, flags=re.S)
        assert len(charts) == 2
        for chart in charts:
            assert len(ElementTree.fromstring(chart).findall(".//{*}path")) > 6  # noqa: S314  # our own text
            assert "currentColor" in chart
    assert "&lt;yard&gt;" in html_report(load_results(small))


@pytest.mark.slow
@pytest.mark.skipif(program() is None, reason="Debian's chromium is not installed")
@pytest.mark.parametrize("width", [1200, 390])
def test_it_fits_the_window(tmp_path: Path, width: int) -> None:
    file = random_results(tmp_path / "m.db", ["landmark", "PRM+certified", "native:RRTConnect"], problems=3, runs=6)
    (tmp_path / "page.html").write_text(html_report(load_results(file)), encoding="utf-8")
    with browser() as tab:
        tab.open((tmp_path / "page.html").as_uri(), width, 900)
        assert tab.run("document.documentElement.scrollWidth") <= width
