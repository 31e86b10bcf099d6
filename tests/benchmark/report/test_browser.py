"""The report in a browser: nothing complains, no chart is blank, on a phone, on a desk and on paper."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.benchmark.report.browser import browse, probe, require_chromium
from tests.benchmark.report.made_results import random_results

from trailmark.benchmark.report import html_report, load_results

PLANNERS = ["landmark", "native:RRTConnect", "RRTConnect+certified", "RRTConnect", "PRM+certified", "PRM", "RRTstar"]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The smallest report that there is, and one that shows planners family by family."""
    require_chromium()
    folder = tmp_path_factory.mktemp("pages")
    found = {}
    for name, planners, problems, runs in (("small", ["landmark", "PRM"], 1, 3), ("large", PLANNERS, 2, 6)):
        results = load_results(random_results(folder / f"{name}.db", planners, problems, runs))
        found[name] = folder / f"{name}.html"
        found[name].write_text(html_report(results))
    return found


def complaints(errors: str) -> list[str]:
    return [line for line in errors.splitlines() if "CONSOLE" in line]


def test_the_browser_does_not_complain(pages: dict[str, Path]) -> None:
    done = browse(pages["large"], "--dump-dom", "--enable-logging=stderr", "--v=0")
    assert "</html>" in done.stdout
    assert complaints(done.stderr) == []


def test_a_complaint_would_be_seen(tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text("<!DOCTYPE html><title>bad</title><script>nothing.there()</script>")
    assert complaints(browse(page, "--dump-dom", "--enable-logging=stderr", "--v=0").stderr)


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("name", ["small", "large"])
def test_every_chart_is_drawn_and_fits(pages: dict[str, Path], name: str, width: int) -> None:
    found = probe(pages[name], width)
    assert found["width"] == width
    assert found["page"] <= width, "the page itself never scrolls sideways"
    planners = 2 if name == "small" else len(PLANNERS)
    assert len(found["charts"]) >= 6
    for chart in found["charts"]:
        where = f"{chart['label']} at {width} px"
        assert chart["width"] > 250, where
        assert chart["height"] > 80, where
        assert chart["marks"] >= 2, where
        assert chart["letters"] >= 10.0, where
        assert chart["outside"] == 0, where
        if chart["kind"] == "chart rows":
            assert chart["marks"] >= planners, where
    for table in found["tables"]:
        assert table["table"] <= table["box"] or table["overflow"] == "auto"


def test_no_chart_is_blank_to_the_eye(pages: dict[str, Path]) -> None:
    found = probe(pages["large"], 1280)
    picture = pages["large"].with_suffix(".png")
    copy = pages["large"].with_name("large-open.html")
    copy.write_text(pages["large"].read_text().replace("<details", "<details open"))
    browse(copy, f"--screenshot={picture}", height=found["height"] + 100)
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB"), dtype=np.float64)
    for chart in found["charts"]:
        left, top = int(chart["x"]), int(chart["y"])
        part = pixels[top : top + int(chart["height"]), left : left + int(chart["width"])]
        colours = np.unique(part.reshape(-1, 3) // 32, axis=0)
        assert part.std() > 12.0, chart["label"]
        assert len(colours) >= 8, chart["label"]


def test_it_prints_with_all_unfolded(pages: dict[str, Path]) -> None:
    folded = pages["large"]
    unfolded = folded.with_name("unfolded.html")
    unfolded.write_text(folded.read_text().replace("<details", "<details open"))
    counts = []
    for page in (folded, unfolded):
        paper = page.with_suffix(".pdf")
        browse(page, f"--print-to-pdf={paper}", "--no-pdf-header-footer")
        content = paper.read_bytes()
        assert content.startswith(b"%PDF")
        counts.append(len(re.findall(rb"/Type\s*/Page\b", content)))
    assert counts[0] == counts[1] >= 6
