from __future__ import annotations

import contextlib
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from PIL import Image
from tests.helpers.chromium import Browser
from tests.slow.live.conftest import serving

from trailmark import World, check_path

READY = "window.trailmark.scene.path && document.getElementById('verdict').textContent.startsWith('path found')"

BRIEFLY = """send = ((sent) => (kind, fields) => sent(kind,
  fields?.time_limit ? {...fields, time_limit: Math.min(fields.time_limit, 0.3)} : fields))(send), null"""
"""What is planned and compared takes up to two seconds on the page: a path that is good enough is there sooner."""


def show(tab: Browser, address: str, width: int = 1400) -> None:
    """Open the page, and wait until its first path is found."""
    tab.complaints.clear()
    tab.open("about:blank", width)  # else an address that differs in its fragment alone would load nothing
    tab.open(address, width, 850)
    tab.run(BRIEFLY)
    tab.wait(READY)


def on_screen(tab: Browser, point: str) -> tuple[float, float]:
    """Return where an expression's point of the world is in the window."""
    box = "document.getElementById('map').getBoundingClientRect()"
    place = f"const b = {box}, p = trailmark.view.toScreen(...{point}); return [p[0] + b.left, p[1] + b.top];"
    x, y = tab.run(f"(() => {{ {place} }})()")
    return float(x), float(y)


def pixel(tab: Browser, place: list[float]) -> list[int]:
    """Return the colour of the canvas at a place of the world."""
    at = f"trailmark.view.toScreen(...{place}).map((v) => v * trailmark.view.ratio)"
    found: list[int] = tab.run(f"[...view.brush.getImageData(...{at}, 1, 1).data].slice(0, 3)")
    tab.complaints = [said for said in tab.complaints if "readback" not in said]  # reading is slow, says the browser
    return found


def world_of(tab: Browser, tmp_path: Path) -> World:
    """Return the world as the page has it."""
    file = tmp_path / "world.yaml"
    file.write_text(tab.run("JSON.stringify(trailmark.scene.content())"))
    return World.load(file)


SETTLED = (
    "!pending && wanted === null && waiting.size === 0"
    " && [...inFlight.values()].every((asked) => asked.answered) && scene.path && scene.path.states"
)
"""No edit is unsent, no plan unasked, no answer outstanding: what is shown is for what was done last."""


def settled(tab: Browser) -> list[list[float]]:
    """Wait until all that was done is answered by a path, and return its states."""
    states: list[list[float]] = tab.wait(SETTLED)
    return states


def test_what_is_dragged_is_followed_by_a_certified_path(tab: Browser, address: str, tmp_path: Path) -> None:
    show(tab, address)
    goal, start = (
        on_screen(tab, "trailmark.scene.goal.slice(0, 2)"),
        on_screen(tab, "trailmark.scene.start.slice(0, 2)"),
    )
    tab.drag(goal, on_screen(tab, "[6.0, 6.0]"), steps=40)
    states = settled(tab)
    assert states[-1] == tab.run("trailmark.scene.goal")
    assert states[-1][:2] == pytest.approx([6.0, 6.0], abs=0.1)
    assert tab.run("trailmark.latencies.length") > 3
    # An obstacle into its way: the path leads around it.
    x, y = states[len(states) // 2][:2]
    tab.run("document.querySelector('[data-tool=disc]').click()")
    middle = on_screen(tab, f"[{x}, {y}]")
    tab.drag(middle, (middle[0] + 12, middle[1]), steps=4)
    tab.run("document.querySelector('[data-tool=move]').click()")
    around = settled(tab)
    world = world_of(tab, tmp_path)
    assert len(world.obstacles) == len(World.load("office").obstacles) + 1
    assert check_path(world, world.robot, around).free
    assert not check_path(world, world.robot, states).free
    # And away with it.
    tab.key("Delete", "Delete")
    settled(tab)
    assert len(world_of(tab, tmp_path).obstacles) == len(World.load("office").obstacles)
    tab.key("z", "KeyZ", modifiers=2)
    tab.wait(f"trailmark.scene.obstacles.size === {len(world.obstacles)}")
    tab.drag(start, (start[0] + 30, start[1]), steps=5)
    settled(tab)
    assert tab.complaints == []


def test_keys_do_what_the_mouse_does(tab: Browser, address: str) -> None:
    show(tab, address)
    tab.run("document.getElementById('map').focus()")
    before = tab.run("[trailmark.scene.start, trailmark.scene.goal]")
    for key in ("ArrowLeft", "ArrowDown", "["):
        tab.key(key, key)
    x, y, theta = tab.run("trailmark.scene.goal")
    assert x < before[1][0]
    assert y < before[1][1]
    assert theta > before[1][2]
    tab.key("n")
    assert tab.run("document.getElementById('selected').value") == "o0"
    tab.key("N", modifiers=8)
    tab.key("N", modifiers=8)
    tab.key("ArrowRight", "ArrowRight")
    assert tab.run("trailmark.scene.start")[0] > before[0][0]
    for _ in range(4):
        tab.key("z", "KeyZ", modifiers=2)
    assert tab.run("[trailmark.scene.start, trailmark.scene.goal]") == before
    # Everything can be reached, and has a name.
    unnamed = tab.run(
        "[...document.querySelectorAll('button, select, input, canvas')].filter(e => !(e.labels?.length"
        " || e.textContent.trim() || e.getAttribute('aria-label'))).map(e => e.id || e.outerHTML)"
    )
    assert unnamed == []
    tab.key(" ", "Space")
    tab.wait("document.getElementById('play').textContent === 'Stop'")
    tab.key(" ", "Space")
    assert tab.complaints == []


CONTRAST = """(() => {
  const light = (c) => { const f = (v) => (v /= 255) <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    return 0.2126 * f(c[0]) + 0.7152 * f(c[1]) + 0.0722 * f(c[2]); };
  const parts = (text) => text.match(/[\\d.]+/g).map(Number);
  const behind = (e) => { for (; e; e = e.parentElement) { const c = parts(getComputedStyle(e).backgroundColor);
    if (c.length < 4 || c[3] > 0) return c; } return [255, 255, 255]; };
  const bad = [];
  for (const e of document.querySelectorAll('body *')) {
    const own = [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
    if (!own || e.disabled || !e.getClientRects().length || ['SCRIPT', 'STYLE', 'OPTION'].includes(e.tagName)) continue;
    const a = light(parts(getComputedStyle(e).color)), b = light(behind(e));
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) bad.push([e.tagName, e.textContent.trim().slice(0, 30), ratio]);
  }
  return bad;
})()"""


@pytest.mark.parametrize("width", [1400, 390])
def test_it_fits_and_can_be_read(tab: Browser, address: str, width: int) -> None:
    show(tab, address, width)
    assert tab.run("document.documentElement.scrollWidth") <= width
    assert tab.run("document.getElementById('map').clientHeight") > 250
    assert tab.run("document.querySelector('aside').scrollWidth - document.querySelector('aside').clientWidth") <= 0
    for _ in range(2):
        assert tab.run(CONTRAST) == []
        tab.run("document.getElementById('theme').click()")
    assert tab.complaints == []


def test_files_are_read_in_the_browser(tab: Browser, address: str, tmp_path: Path) -> None:
    show(tab, address)
    drop = """(files) => { const data = new DataTransfer();
      for (const [name, text] of files) data.items.add(new File([text], name));
      document.dispatchEvent(new DragEvent('drop', {dataTransfer: data, bubbles: true, cancelable: true})); }"""
    disc = "obstacles:\n  - shape: disc\n    center: [2, 1]\n    radius: 0.3\n"
    text = f"trailmark: 1\nname: dropped\nbounds: [0, 0, 4, 3]\n{disc}"
    tab.run(f"({drop})({json.dumps([['w.yaml', text]])})")
    tab.wait("trailmark.scene.world.name === 'dropped'")
    settled(tab)
    tab.run(f"({drop})({json.dumps([['x.yaml', 'trailmark: 1' + chr(10) + 'bounds: 3']])})")
    tab.wait("document.getElementById('error').textContent.includes('bounds')")
    tab.run(f"({drop})({json.dumps([['x.exe', 'MZ']])})")
    tab.wait("document.getElementById('error').textContent.includes('expected a world')")
    tab.run(
        f"({drop})({json.dumps([['w.json', json.dumps({'trailmark': 1, 'name': 'told', 'bounds': [0, 0, 4, 3]})]])})"
    )
    tab.wait("trailmark.scene.world.name === 'told'")
    tab.key("z", "KeyZ", modifiers=2)
    tab.wait("trailmark.scene.world.name === 'dropped'")
    assert tab.run("trailmark.scene.world.name") == "dropped"
    # The address holds the world: a page that is opened by it shows the same.
    tab.run("document.getElementById('share').click()")
    shared = tab.wait("location.hash.length > 10 && location.href")
    show(tab, shared)
    assert tab.run("trailmark.scene.world.name") == "dropped"
    assert tab.complaints == []


def test_fingers_drag_and_pinch(tab: Browser, address: str) -> None:
    show(tab, address, 390)
    goal = on_screen(tab, "trailmark.scene.goal.slice(0, 2)")
    tab.touch((goal, on_screen(tab, "[6.0, 6.0]")))
    states = settled(tab)
    assert states[-1] == tab.run("trailmark.scene.goal")
    assert states[-1][:2] == pytest.approx([6.0, 6.0], abs=0.2)
    scale, (x, y) = tab.run("trailmark.view.scale"), on_screen(tab, "[10.0, 6.0]")
    tab.touch(((x - 20, y), (x - 60, y)), ((x + 20, y), (x + 60, y)))
    assert tab.run("trailmark.view.scale") == pytest.approx(3.0 * scale, rel=0.1)
    assert on_screen(tab, "[10.0, 6.0]") == pytest.approx((x, y), abs=3.0)
    assert tab.complaints == []


def test_what_is_exported_is_what_is_shown(tab: Browser, address: str, tmp_path: Path) -> None:
    show(tab, address)
    tab.run("clearance.value = 0.05, objective.value = 'clearance', objective.dispatchEvent(new Event('change'))")
    tab.wait(f"settle === 0 && inFlight.size === 0 && {SETTLED}")  # the plan that takes longer has ended, too
    states = settled(tab)
    tab.run("""window.kept = new Map(); navigator.clipboard.writeText = () => Promise.reject(new Error('forbidden'));
      URL.createObjectURL = (blob) => (window.last = blob, 'data:,');
      HTMLAnchorElement.prototype.click = function () {
        window.last.arrayBuffer().then((held) => kept.set(this.download, [...new Uint8Array(held)])); }; null""")
    kept = {}
    for button, name in zip(("png", "json", "save", "python"), ("png", "json", "yaml", ""), strict=True):
        file = f"office.{name}" if name else "plan.py"
        tab.run(f"document.getElementById('{button}').click()")
        kept[file] = bytes(tab.wait(f"kept.get('{file}')"))
        (tmp_path / file).write_bytes(kept[file])
    assert "plan.py" in tab.run("document.getElementById('told').textContent")
    box = tab.run("[trailmark.view.canvas?.width ?? document.getElementById('map').width]")[0]
    with Image.open(tmp_path / "office.png") as picture:
        assert picture.width == box
        assert len(picture.getcolors(1 << 24) or ()) > 10
    path, world = json.loads(kept["office.json"]), World.load(tmp_path / "office.yaml")
    assert path["states"] == states
    assert world.obstacles == World.load("office").obstacles
    assert check_path(world, world.robot, path["states"]).free
    # The program plans what the page planned.
    program = kept["plan.py"].decode()
    assert 'clearance=0.05, objective="clearance"' in program
    names: dict[str, Any] = {}
    assert "time_limit=1.0" in program
    with contextlib.chdir(tmp_path), contextlib.redirect_stdout(io.StringIO()) as said:
        exec(program.replace("time_limit=1.0", "time_limit=0.3"), names)  # noqa: S102  # what is exported is to be run
    assert said.getvalue().startswith("solved")
    assert names["result"].path.states[[0, -1]] == pytest.approx(np.array(states)[[0, -1]], abs=1e-5)
    assert tab.complaints == []


def test_via_points_are_set_and_taken_away_by_shift_and_a_click(tab: Browser, address: str) -> None:
    show(tab, address)
    places = [[3.5, 5.8], [12.0, 10.8]]
    for place in places:
        tab.click(on_screen(tab, str(place)), modifiers=8)
    states = settled(tab)
    assert np.array(tab.run("trailmark.scene.via")) == pytest.approx(np.array(places), abs=0.02)
    line = shapely.LineString([state[:2] for state in states])
    along = [line.project(shapely.Point(place)) for place in places]
    assert [line.distance(shapely.Point(place)) for place in places] == pytest.approx([0.0, 0.0], abs=0.02)
    assert along == sorted(along)
    tab.click(on_screen(tab, str(places[0])), modifiers=8)
    assert shapely.LineString([state[:2] for state in settled(tab)]).distance(shapely.Point(places[0])) > 0.5
    tab.run("document.getElementById('undo').click(), document.getElementById('undo').click()")
    assert len(tab.run("trailmark.scene.via")) == 1
    tab.run("clicks.undo()")
    assert tab.complaints == []


def test_what_a_map_says_nothing_of_is_shaded(tab: Browser, tmp_path: Path) -> None:
    pixels = np.full((40, 60), 254, np.uint8)
    pixels[10:20, 20:30] = 205
    Image.fromarray(pixels).save(tmp_path / "map.pgm")
    (tmp_path / "map.yaml").write_text(
        "image: map.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    with serving(str(tmp_path / "map.yaml"), "--robot", "disc:0.2", "--unknown", "free") as address:
        show(tab, address)
        for _ in range(2):
            colours = [pixel(tab, place) for place in ([2.5, 2.5], [0.5, 3.8])]
            assert sum(colours[0]) < sum(colours[1]) - 30
            tab.run("changeRobot()")  # the world is sent to the server and comes back
            tab.wait(READY)
    assert tab.complaints == []


def test_a_start_in_an_obstacle_says_how_deep_it_is_and_how_far_out(tab: Browser, address: str) -> None:
    show(tab, address)
    tab.run("scene.note(), scene.start = [3.0, 3.7, 0], changed()")
    said = tab.wait("badEnd === 'start' && document.getElementById('verdict').textContent")
    assert re.search(r"overlaps .* by [\d.]+ m.*; the way out is [\d.]+ m long", said)
    tab.run("clicks.undo()")
    assert tab.complaints == []


def test_a_world_without_a_way_shows_why(tab: Browser, address: str) -> None:
    show(tab, address)
    wall = {"shape": "rectangle", "center": [10.0, 6.0], "length": 0.3, "width": 12.0, "id": "wall"}
    tab.run(f"edit({{add: [{json.dumps(wall)}]}})")
    tab.wait("document.getElementById('verdict').textContent.startsWith('proven')", 60.0)
    tab.wait("document.getElementById('why').textContent.includes('shut in')")
    tab.run("document.getElementById('undo').click(), edit({remove: ['wall']})")
    tab.wait(READY)
    assert tab.run("document.getElementById('why').textContent") == ""
    assert tab.complaints == []


def test_driving(tab: Browser, address: str) -> None:
    show(tab, address, 800)
    tab.run("document.getElementById('speed').value = 20, document.getElementById('play').click()")
    tab.wait("document.getElementById('play').textContent === 'Stop'")
    tab.wait("document.getElementById('play').textContent === 'Play'")
    tab.wait(READY)
    assert tab.complaints == []
