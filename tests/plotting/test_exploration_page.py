"""The page of an exploration: what it holds is what happened, and a browser shows it without complaint."""

from __future__ import annotations

import base64
import json
import re
import zlib
from dataclasses import replace
from html import escape, unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.exploration.made_exploration import made_exploration
from tests.helpers.browsing import browse, require_chromium

import trailmark.plotting.exploration_page as module
from trailmark.errors import OutputError
from trailmark.exploration.known_map import OCCUPIED, UNKNOWN
from trailmark.formats.outputs import require_replaceable
from trailmark.plotting import save_exploration_page


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "exploration.html"
    save_exploration_page(file, made_exploration())
    return file


def content(page: Path) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
    """Return what the page is told, and its arrays."""
    text = page.read_text()
    meta, data = (re.search(rf'id="{name}">(.*?)</script>', text, re.S) for name in ("meta", "data"))
    assert meta is not None
    assert data is not None
    told = json.loads(meta[1])
    raw, arrays, at = zlib.decompress(base64.b64decode(data[1])), {}, 0
    for name, kind, size in told["arrays"]:
        arrays[name] = np.frombuffer(raw, kind, size, at)
        assert at % arrays[name].itemsize == 0, "a browser reads aligned arrays only"
        at += arrays[name].nbytes
    assert at == len(raw)
    return told, arrays


def test_it_holds_the_map_as_it_became_known(page: Path) -> None:
    result = made_exploration()
    told, arrays = content(page)
    assert told["shape"] == list(result.known.state.shape)
    assert np.array_equal(arrays["state"].reshape(told["shape"]), result.known.state)
    for i in (0, 17, 40, len(result.history) - 1):
        shown = (arrays["first"] <= i).reshape(told["shape"])
        assert np.array_equal(shown, result.first_known <= np.float32(result.history[i].time))


def test_it_holds_poses_paths_targets_and_figures(page: Path) -> None:
    result = made_exploration()
    told, arrays = content(page)
    poses = arrays["pose"].reshape(-1, 3) * [told["unit"], told["unit"], told["angle"]]
    assert poses == pytest.approx(np.array([row.pose for row in result.history]), abs=1e-4)
    for i, row in enumerate(result.history):
        begin, end = arrays["span"].reshape(-1, 2)[i]
        assert (begin < 0) == (row.path is None)
        assert bool(arrays["aimed"][i]) == (row.target is not None)
        if row.path is not None and row.target is not None:
            path = arrays["path"].reshape(-1, 2)[begin:end] * told["unit"]
            assert path == pytest.approx(row.path[:, :2], abs=1e-4)
            assert arrays["target"].reshape(-1, 2)[i] * told["unit"] == pytest.approx(row.target[:2], abs=1e-4)
    assert arrays["clock"] * told["scales"]["clock"] == pytest.approx([row.time for row in result.history])
    assert arrays["landmarks"].tolist() == [row.landmarks for row in result.history]
    assert [text for _, text in told["events"]] == [row.event for row in result.history if row.event]
    assert len(arrays["places"]) == 2 * result.history[-1].landmarks


def test_it_needs_nothing_else_and_may_be_written_again(page: Path) -> None:
    text = page.read_text()
    assert "://" not in text
    assert 'src="' not in text
    assert page.stat().st_size < 60_000
    require_replaceable(page)
    with pytest.raises(OutputError, match=r"expected a file that ends in \.html, got \.htm"):
        save_exploration_page(page.with_suffix(".htm"), made_exploration())


def test_a_name_is_no_markup(tmp_path: Path) -> None:
    result = made_exploration()
    row = result.history[3]._replace(event="</script><script>alert(1)</script>")
    name = "$data <b>rooms</b> ${meta}"
    odd = replace(result, world=replace(result.world, name=name), history=(*result.history[:3], row))
    save_exploration_page(tmp_path / "a.html", odd)
    text = (tmp_path / "a.html").read_text()
    assert text.count("</script>") == 3
    assert escape(name) in text
    assert content(tmp_path / "a.html")[0]["events"] == [[3, row.event]]


def test_long_explorations_of_large_worlds_are_thinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_ROWS", 20)
    monkeypatch.setattr(module, "MAX_CELLS", 500)
    result = made_exploration()
    save_exploration_page(tmp_path / "a.html", result)
    told, arrays = content(tmp_path / "a.html")
    rows, columns = told["shape"]
    assert told["times"] == 20
    assert rows * columns <= 500
    assert arrays["clock"][-1] * told["scales"]["clock"] == pytest.approx(result.history[-1].time)
    assert [text for _, text in told["events"]] == [row.event for row in result.history if row.event]
    assert all(0 <= i < 20 for i, _ in told["events"])
    assert len(arrays["places"]) == 2 * result.history[-1].landmarks
    for begin, end in arrays["span"].reshape(-1, 2):
        assert (begin, end) == (-1, -1) or 0 <= begin < end <= len(arrays["path"]) // 2
    assert arrays["span"].max() == len(arrays["path"]) // 2
    state = arrays["state"].reshape(rows, columns)
    size = round(told["cell"] / result.known.cell)
    for i, j in ((0, 0), (3, 5), (rows - 1, columns - 1)):
        part = result.known.state[i * size : (i + 1) * size, j * size : (j + 1) * size]
        assert state[i, j] == part.max()
    assert (state == OCCUPIED).any()
    assert ((arrays["first"] == module.NEVER) == (arrays["state"] == UNKNOWN)).all()


def test_an_exploration_that_ended_at_once(tmp_path: Path) -> None:
    result = made_exploration()
    save_exploration_page(tmp_path / "a.html", replace(result, history=result.history[:1], evaluation=None))
    told, arrays = content(tmp_path / "a.html")
    assert told["times"] == 1
    assert (arrays["first"] == 0).sum() == (result.first_known <= 0.0).sum()


TELL = """
const waiting = setInterval(() => {
  if (!document.documentElement.dataset.ready) return;
  clearInterval(waiting);
  const copy = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
  const corner = () => { copy.drawImage(canvas, 0, 0); return [...copy.getImageData(0, 0, 1, 1).data.slice(0, 3)]; };
  const told = {page: document.documentElement.scrollWidth, shown: [], themes: []};
  for (const i of [0, 40, 12, count - 1]) {
    show(i);
    told.shown.push({row: row, painted: painted, cells: $("cells").textContent, clock: $("clock").textContent});
  }
  for (const theme of ["dark", "light"]) { setTheme(theme); told.themes.push(corner()); }
  dispatchEvent(new KeyboardEvent("keydown", {key: "Home"}));
  for (let i = 0; i < 3; i++) dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowRight"}));
  told.keys = row;
  dispatchEvent(new KeyboardEvent("keydown", {key: " "}));
  told.playing = play.textContent;
  told.small = [...document.querySelectorAll("button, select, dd, #time")].filter(
    (e) => e.getBoundingClientRect().right > innerWidth || e.getBoundingClientRect().width < 1).length;
  parent.document.querySelector("pre").textContent = JSON.stringify(told);
}, 20);
"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 1400])
def test_a_browser_shows_it(page: Path, width: int) -> None:
    require_chromium()
    result = made_exploration()
    text = page.read_text().replace("</body>", f"<script>{TELL}</script></body>")
    frame = f'<iframe style="border:0;width:{width}px;height:900px" srcdoc="{escape(text)}"></iframe>'
    copy = page.with_name(f"probe-{width}.html")
    copy.write_text(f'<!DOCTYPE html><meta charset="utf-8"><body><pre></pre>{frame}')
    done = browse(copy, "--dump-dom", "--enable-logging=stderr", "--v=0", "--virtual-time-budget=5000")
    assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
    found = re.search(r"<pre>(.*?)</pre>", done.stdout, re.S)
    assert found is not None
    told = json.loads(unescape(found[1]))
    assert told["page"] <= width
    assert told["small"] == 0
    for shown in told["shown"]:
        time = result.history[shown["row"]].time
        known = int((result.first_known <= np.float32(time)).sum())
        assert shown["painted"] == known
        assert shown["cells"] == f"{100.0 * known / result.known.state.size:.1f} %"
        assert shown["clock"] == f"{time:.1f} s"
    assert told["themes"] == [[58, 66, 78], [201, 204, 210]]  # its upper left corner is unknown
    assert told["keys"] == 3
    assert told["playing"] == "Pause"
