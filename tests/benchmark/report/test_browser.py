"""The report in a browser: its figures are those of the tables, nothing complains, and it fits a phone and paper."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.benchmark.report.browser import draw, require_chromium
from tests.helpers.chromium import Browser, browser
from tests.helpers.made_results import random_results, run, write_results

from trailmark.benchmark.report import html_report, load_results
from trailmark.benchmark.report.data import Results
from trailmark.benchmark.report.digits import percent
from trailmark.benchmark.report.summary import summarise, summarise_runs

pytestmark = pytest.mark.slow

PLANNERS = ["landmark", "native:RRTConnect", "RRTConnect+certified", "RRTConnect", "PRM+certified", "PRM", "RRTstar"]
PLANNERS += [f"my_module:plan{i}" for i in range(8)]

CHARTS = """(() => {
document.querySelectorAll('details').forEach(d => { d.open = true; });
return [...document.querySelectorAll('svg.chart')].map(svg => {
  const box = svg.getBoundingClientRect();
  const texts = [...svg.querySelectorAll('text')].map(t => t.getBoundingClientRect());
  const marks = [...svg.querySelectorAll('.mark')].filter(m => {
    const b = m.getBBox(), style = getComputedStyle(m);
    return b.width + b.height > 1 && (style.stroke !== 'none' || style.fill !== 'none');
  });
  const ticks = [...svg.querySelectorAll('text.tick')].map(t => t.getBoundingClientRect());
  const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 3 && b.top < a.bottom - 3;
  return {label: svg.getAttribute('aria-label'), rows: svg.classList.contains('rows'), marks: marks.length,
    width: box.width, height: box.height, letters: Math.min(...texts.map(t => t.height)),
    outside: texts.filter(t => t.left < box.left - 2 || t.right > box.right + 2).length,
    collisions: ticks.filter((a, i) => ticks.slice(i + 1).some(b => meet(a, b))).length};
});})()"""
TABLE = "[...document.querySelectorAll('%s tbody tr')].map(r => [...r.children].map(c => c.textContent))"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    require_chromium()
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return load_results(random_results(tmp_path_factory.mktemp("results") / "large.db", PLANNERS, problems=4, runs=6))


@pytest.fixture(scope="module")
def pages(large: Results) -> dict[str, Path]:
    """The smallest report that there is, and one of many planners."""
    folder = large.file.parent
    small = load_results(random_results(folder / "small.db", ["landmark", "PRM"], 1, 3))
    found = {}
    for name, results in (("small", small), ("large", large)):
        found[name] = folder / f"{name}.html"
        found[name].write_text(html_report(results))
    return found


@pytest.mark.parametrize("width", [390, 1400])
@pytest.mark.parametrize("name", ["small", "large"])
def test_every_chart_is_drawn_and_fits(chromium: Browser, pages: dict[str, Path], name: str, width: int) -> None:
    draw(chromium, pages[name], width)
    charts: list[dict[str, Any]] = chromium.run(CHARTS)
    assert chromium.run("document.documentElement.scrollWidth") == width, "the page itself never scrolls sideways"
    assert len(charts) == (6 if name == "small" else 13)
    for chart in charts:
        where = f"{chart['label']} at {width} px"
        assert chart["width"] > 250, where
        assert chart["height"] > 80, where
        assert chart["marks"] >= 1, where
        assert chart["letters"] >= 10.0, where
        assert chart["outside"] == 0, where
        assert chart["collisions"] == 0, where
        if chart["rows"] and name == "large":
            assert chart["marks"] >= len(PLANNERS) - 3, where
    assert chromium.complaints == []


def test_a_complaint_would_be_seen(chromium: Browser, tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text("<!DOCTYPE html><title>bad</title><script>nothing.there()</script>")
    chromium.open(page, 800)
    assert len(chromium.complaints) == 1
    chromium.complaints.clear()


def test_the_charts_figures_are_the_tables(chromium: Browser, pages: dict[str, Path], large: Results) -> None:
    draw(chromium, pages["large"])
    summary = summarise(large)
    rows = chromium.run(TABLE % "#together")
    assert [row[0] for row in rows] == [s.planner for s in summary.planners]
    for row, s in zip(rows, summary.planners, strict=True):
        assert [int(row[1]), int(row[2])] == [s.problems, s.runs]
        assert row[3] == percent(s.success / s.runs)
        assert float(row[4]) == pytest.approx(1e3 * s.first_mean, rel=6e-3)
        assert (row[6] == "none") == (not np.isfinite(s.ratio[2]))
        if row[6] != "none":
            assert float(row[6]) == pytest.approx(s.ratio[2], rel=1e-3)


def test_problems_and_planners_are_chosen_by_clicking(
    chromium: Browser, pages: dict[str, Path], large: Results
) -> None:
    draw(chromium, pages["large"])
    redrawn = "new Promise(done => requestAnimationFrame(() => setTimeout(done)))"
    for click in ("#all-planners", "#all-problems", "label[data-s='0'] input", "label[data-s='5'] input"):
        chromium.run(f'document.querySelector("{click}").click()')
    chromium.run("document.querySelector('#problems input[value=\"2\"]').click()")
    chromium.run(redrawn)
    rows = chromium.run(TABLE % "#together")
    for row in rows:
        expected = summarise_runs(large.problems[2], row[0])
        assert float(row[4]) == pytest.approx(1e3 * expected.first_mean, rel=6e-3)
    assert {row[0] for row in rows} == {"landmark", "PRM"}
    # Cold: loading and building, 50 ms on every problem, come before each first path.
    warm = {row[0]: float(row[5]) for row in rows if row[5] != "none"}
    chromium.run("document.querySelector('#clocks input[value=file]').click()")
    chromium.run(redrawn)
    cold = {row[0]: float(row[5]) for row in chromium.run(TABLE % "#together") if row[5] != "none"}
    assert cold == pytest.approx({name: t + 50.0 for name, t in warm.items()}, rel=6e-3)
    # A click on a name shows that problem; the filter lists those that match.
    chromium.run("document.querySelector('#problems button[data-problem=\"3\"]').click()")
    chromium.run(redrawn)
    assert chromium.run("document.getElementById('name').textContent") == large.problems[3].name
    assert chromium.run("document.querySelectorAll('#single svg.world .line').length") == 2
    chromium.run("document.getElementById('filter').value = 'D1'")
    chromium.run("document.getElementById('filter').dispatchEvent(new Event('input'))")
    assert chromium.run("document.getElementById('problems').textContent") == large.problems[1].name


def test_the_profiles_are_dolans_and_mores(chromium: Browser, tmp_path: Path) -> None:
    # By hand: medians of A 0.1, 0.4, none; of B 0.2, 0.2, 0.2.
    times = {"one": (0.1, 0.2), "two": (0.4, 0.2), "three": (None, 0.2)}
    made = {
        name: {"A": [run(k, a, a and 10.0) for k in range(3)], "B": [run(k, b, 10.0) for k in range(3)]}
        for name, (a, b) in times.items()
    }
    page = tmp_path / "r.html"
    page.write_text(html_report(load_results(write_results(tmp_path / "r.db", made))))
    draw(chromium, page)
    profile = "[...document.querySelectorAll('svg[aria-label^=\"Performance profile of time\"] .line')]"
    lines = chromium.run(f"{profile}.map(l => [l.parentNode.dataset.s, l.getAttribute('d')])")
    heights = {s: [float(point.split(" ")[1]) for point in d[1:].split("L")] for s, d in lines}
    shares = {s: sorted({round((242.0 - y) / 230.0, 3) for y in ys}) for s, ys in heights.items()}
    # A is the best once in three, twice as long once in three; B twice, and then twice as long.
    assert shares == {"0": [0.0, 0.333, 0.667], "1": [0.0, 0.333, 0.667, 1.0]}
    assert chromium.complaints == []


def test_who_is_pointed_at_stands_out(chromium: Browser, pages: dict[str, Path]) -> None:
    draw(chromium, pages["large"])
    opacity = "[...document.querySelectorAll('#together svg .s')].map(g => [g.dataset.s, getComputedStyle(g).opacity])"
    assert {o for _, o in chromium.run(opacity)} == {"1"}
    chromium.run("document.querySelector('label[data-s=\"3\"] input').focus()")
    assert chromium.run("document.getElementById('pointed').textContent") == PLANNERS[3]
    assert set(map(tuple, chromium.run(opacity))) == {(str(i), "1" if i == 3 else "0.13") for i in range(len(PLANNERS))}


def test_a_table_says_that_there_is_more(chromium: Browser, pages: dict[str, Path]) -> None:
    draw(chromium, pages["large"], 390)
    more = "getComputedStyle(document.querySelector('#summary .table'), '::after').content !== 'none'"
    assert chromium.run(more)
    scrolled = "new Promise(done => requestAnimationFrame(() => setTimeout(done, 50)))"
    chromium.run(f"document.querySelector('#summary .scroll').scrollLeft = 99999; {scrolled}")
    assert not chromium.run(more)


def test_names_are_only_text(chromium: Browser, tmp_path: Path) -> None:
    evil = '</script><img src=x onerror="window.hacked = 1">\'"&<b>'
    rows = [run(0, 0.1, 10.0), run(1, 0.1, 10.0, correct_solution=False, failure=evil)]
    problems = {name: {evil: rows, "PRM": rows, f"{evil}+certified": rows} for name in (evil, "two")}
    page = tmp_path / "r.html"
    page.write_text(html_report(load_results(write_results(tmp_path / "r.db", problems, hostname=evil))))
    draw(chromium, page)
    assert chromium.run("[window.hacked, document.images.length, document.querySelectorAll('b').length]") == [
        *(None, 0, chromium.run("document.querySelectorAll('figcaption b, .warning b').length"))
    ]
    assert chromium.run("document.getElementById('name').textContent") == evil
    assert chromium.complaints == []


@pytest.mark.parametrize(
    "rows",
    [
        pytest.param([run(0, None), run(1, None)], id="all failed"),
        pytest.param([run(0, 0.0, 0.0)], id="nothing to do"),
        pytest.param([run(0, 0.1, None, setup_time=None)], id="no cost known"),
    ],
)
def test_odd_results_are_drawn_too(chromium: Browser, tmp_path: Path, rows: list[dict[str, Any]]) -> None:
    page = tmp_path / "r.html"
    page.write_text(
        html_report(load_results(write_results(tmp_path / "r.db", {"yard": {"A": rows}, "b": {"A": rows}})))
    )
    draw(chromium, page)
    chromium.run("document.querySelector('#clocks input[value=file]').click()")
    assert chromium.run("document.getElementById('failed').textContent") == ""
    assert not re.search(r"NaN|undefined|Infinity", chromium.run("document.getElementById('explore').innerHTML"))
    assert chromium.complaints == []


def test_it_prints_with_all_unfolded(chromium: Browser, pages: dict[str, Path]) -> None:
    counts = []
    for unfold in ("", "document.querySelectorAll('details').forEach(d => { d.open = true; })"):
        draw(chromium, pages["large"])
        chromium.run(unfold)
        paper = pages["large"].with_suffix(".pdf")
        chromium.print(paper)
        counts.append(len(re.findall(rb"/Type\s*/Page\b", paper.read_bytes())))
    assert counts[0] == counts[1] >= 4
