"""The report's page: figures are those of the runs, it loads nothing, charts are drawn; statistics by hand."""

from __future__ import annotations

import math
import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.helpers.chromium import browser, program
from tests.helpers.made_results import random_results, run, write_results

from trailmark.benchmark.report import failures, html_report, paired_ratio, ranked, step_values, summary, wilson
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
    wrong = [run(seed, 0.2, 5.0, correct_solution=False, failure="far\noff") for seed in range(4)]
    return write_results(tmp_path / "r.db", {"<yard>": {"slow": slow, "fast": fast, "wrong": wrong}})


def test_the_figures_are_those_of_the_runs(small: Path) -> None:
    results = load_results(small)
    assert ranked(results) == ["fast", "slow", "wrong"]
    assert summary(results, ["wrong", "slow"])[1:] == [
        ["wrong", "0/4", "4", "–", "–"],
        ["slow", "3/4", "0", "0.4", "2"],
    ]
    assert failures(results, ["fast", "wrong"]) == [["wrong", "4 refused by the referee", "far off (4)"]]
    page = Cells(html_report(results))
    ranking = {row[0]: row for row in page.rows[1:4]}
    assert ranking["fast"] == ["fast", "4/4", "0", "0.1", "1", "51 to 100 %", "0.1", "1", "1"]
    # Seconds to the first path, failures at the limit of 1 s: (4 · 4 · 4 · 10)^(1/4).
    assert float(ranking["slow"][7].split()[0]) == pytest.approx(640 ** (1 / 4), rel=1e-2)
    assert ranking["slow"][8] == "2 (2 to 2)"
    assert ["wrong", "4 refused by the referee", "far off (4)"] in page.rows


@pytest.mark.slow
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


@pytest.mark.parametrize(
    ("successes", "n", "expected"),
    # By hand, with z = 1.959964: (p + z²/2n ± z √(p(1 - p)/n + z²/4n²)) / (1 + z²/n).
    [(0, 10, (0.0, 0.27753)), (4, 8, (0.21521, 0.78479)), (10, 10, (0.72247, 1.0)), (0, 0, (0.0, 1.0))],
)
def test_wilson_by_hand(successes: int, n: int, expected: tuple[float, float]) -> None:
    assert wilson(successes, n) == pytest.approx(expected, abs=1e-5)


def test_step_values_hold_between_steps() -> None:
    found = step_values([0.1, 0.5], [9.0, 7.0], [0.05, 0.1, 0.3, 0.5, 2.0])
    assert found.tolist() == [math.inf, 9.0, 9.0, 7.0, 7.0]
    # A worse path later is no step back; no path at all is none at any time.
    assert step_values([0.1, 0.5], [7.0, 9.0], [1.0]).tolist() == [7.0]
    assert step_values([], [], [1.0]).tolist() == [math.inf]


def test_ratios_of_pairs_by_hand() -> None:
    # 2 / 1 and 8 / 1: the geometric mean is 4, and either may be all that a resample holds.
    assert paired_ratio([([2.0, 2.0], [1.0, 1.0]), ([8.0], [1.0])]) == pytest.approx((4.0, 2.0, 8.0))
    assert paired_ratio([([3.0, 3.0], [1.0, 1.0])]) == pytest.approx((3.0, 3.0, 3.0))
    assert all(math.isnan(value) for value in paired_ratio([]))


@pytest.mark.slow
def test_an_interval_holds_the_true_ratio_about_as_often_as_it_says() -> None:
    rng, held = np.random.default_rng(0), 0
    for _ in range(60):
        pairs = [(np.exp(rng.normal(0.5, 1.0, 3)), np.ones(3)) for _ in range(25)]
        _, low, high = paired_ratio(pairs)
        held += low <= math.exp(0.5) <= high
    assert 50 <= held <= 60
