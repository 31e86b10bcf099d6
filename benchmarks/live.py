"""How soon the live page shows a certified path after a drag, and what else issue and users ask of it.

Writes results/live.{json,md}. In headless Chromium, with a server of its own for each world: an end is dragged through
free space, then an obstacle to and fro; times are from a move of the mouse to the frame in which the path for it, or
for a newer one, is drawn. Then frames while an end is dragged with thousands of landmarks drawn, the first paint, and
minutes of random drags by several clients at once: complaints, and memory of server and page.

    python -m benchmarks.live [--minutes 10] [--clients 5] [--base OTHER_CHECKOUT] [--part soak] [--report]
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import connect

from benchmarks.chromium import Browser, browser
from benchmarks.machine import describe_machine, markdown_table
from trailmark import LandmarkPlanner, Robot, World
from trailmark.benchmark.public.made_worlds import random_world
from trailmark.formats.files import write_atomically

RESULTS = Path(__file__).resolve().parent / "results"
DATA = Path(os.environ.get("TRAILMARK_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
ROBOTS = {"disc": Robot.disc(0.25), "rectangle": Robot.rectangle(0.6, 0.4)}
MOVES, PAUSE = 120, 0.016
FIGURES = "(() => [...trailmark.latencies])()"


def worlds() -> dict[str, World]:
    """Return the worlds by name."""
    found = {name: World.load(f"worlds/{name}.yaml") for name in ("office", "warehouse")}
    if (DATA / "nav2" / "depot.yaml").exists():
        found["depot"] = World.load(DATA / "nav2" / "depot.yaml")
    return found | {"200 polygons": random_world(0)}


@contextmanager
def server(world: World, robot: Robot, checkout: str | None = None) -> Iterator[tuple[str, int]]:
    """Serve a world, by another checkout's code if one is named, and yield its address and the server's process."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "world.yaml"
        world.with_robot(robot).save(file)
        words = [sys.executable, "-m", "trailmark.cli", "live", str(file), "--port", "0", "--no-browser"]
        path = {} if checkout is None else {"PYTHONPATH": str(Path(checkout) / "src")}
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=os.environ | path) as process:
            try:
                assert process.stdout is not None
                found = re.search(r"http://\S+", process.stdout.readline())
                assert found is not None
                yield found[0], process.pid
            finally:
                process.terminate()


def on_screen(tab: Browser, x: float, y: float) -> tuple[float, float]:
    """Return where a point of the world is in the window."""
    box = "document.getElementById('map').getBoundingClientRect()"
    place = f"const b = {box}, p = trailmark.view.toScreen({x}, {y}); return [p[0] + b.left, p[1] + b.top];"
    px, py = tab.run(f"(() => {{ {place} }})()")
    return float(px), float(py)


def free_way(world: World, robot: Robot, seed: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return two configurations between which an end can be dragged straight, some metres apart."""
    checker, rng = LandmarkPlanner(world, robot, seed=0).checker, np.random.default_rng(seed)
    xmin, ymin, xmax, ymax = world.bounds
    reach = 0.12 * max(xmax - xmin, ymax - ymin)
    while True:
        q = rng.uniform((xmin, ymin, -np.pi), (xmax, ymax, np.pi))
        angle = rng.uniform(-np.pi, np.pi)
        other = q + np.array([reach * np.cos(angle), reach * np.sin(angle), 0.0])
        if checker.valid(np.array([q, other])).all() and checker.motions_valid(q[None], other[None])[0]:
            return q, other


def quantiles(values: list[float]) -> dict[str, float]:
    """Return median, 95th percentile and most, milliseconds."""
    low, high = np.quantile(values, [0.5, 0.95])
    return {"count": len(values), "median": float(low), "95 %": float(high), "most": max(values)}


def drags(tab: Browser, address: str, world: World, robot: Robot) -> dict[str, Any]:
    """Return how long paths took to follow an end, and an obstacle."""
    tab.open("about:blank", 1400)
    tab.complaints.clear()
    tab.open(address, 1400)
    tab.wait("trailmark.scene.world")
    found: dict[str, Any] = {}
    here, there = free_way(world, robot, 1)
    start, _ = free_way(world, robot, 2)
    ends = f"trailmark.scene.start = {start.tolist()}; trailmark.scene.goal = {here.tolist()}; changed()"
    tab.run(f"(() => {{ {ends} }})()")
    tab.wait("trailmark.scene.path && trailmark.inFlight.size === 0", 30.0)
    for name, a, b in (("end", here, there), ("obstacle", None, None)):
        if name == "obstacle":
            x, y = (start[:2] + 0.5 * (there[:2] - start[:2])).tolist()
            size = 0.3 * robot.inscribed_disc.radius
            shape = {"shape": "disc", "center": [x, y], "radius": size, "id": "dragged"}
            tab.run(f"edit({{add: [{json.dumps(shape)}]}})")
            a = np.array([x, y])
            b = a + 0.05 * (world.bounds[2] - world.bounds[0])
        time.sleep(3.0)
        tab.run("latencies.length = 0")
        assert a is not None
        assert b is not None
        places = on_screen(tab, a[0], a[1]), on_screen(tab, b[0], b[1])
        tab.drag(places[0], places[1], steps=MOVES, pause=PAUSE)
        tab.drag(places[1], places[0], steps=MOVES, pause=PAUSE)
        time.sleep(1.0)
        found[name] = quantiles(tab.run(FIGURES) or [float("inf")])
    return found


WATCH = """(() => { const [a, b, c, d] = trailmark.scene.world.bounds, nodes = [], edges = [];
  for (let i = 0; i < 5000; i++) { nodes.push(a + Math.random() * (c - a), b + Math.random() * (d - b), 0);
    if (i) edges.push(i - 1, i); }
  document.querySelector('[data-layer=roadmap]').checked = true;
  trailmark.layers.set('roadmap', {nodes, edges}); requestLayer = () => {}; view.forget('roadmap');
  window.drawnAt = []; window.shownAt = [];
  const before = draw; draw = (now) => { before(now); drawnAt.push(now); };
  const tick = (now) => { shownAt.push(now); requestAnimationFrame(tick); }; requestAnimationFrame(tick); })()"""
RATES = "[drawnAt, shownAt].map((times) => 1000 * (times.length - 1) / (times.at(-1) - times[0]))"


def frames(tab: Browser, address: str) -> dict[str, Any]:
    """Return frames a second while something is dragged with 5,000 landmarks drawn, and the page's first paint.

    Of each, frames that were drawn anew, and those that the browser began meanwhile, which others' work may keep it
    from: a move of the mouse comes in for each.
    """
    tab.open("about:blank", 1400)
    tab.open(address, 1400)
    tab.wait("trailmark.scene.path")
    # The browser reports its paint some time later; the path may be there first.
    found = {"first paint, ms": tab.wait("performance.getEntriesByName('first-contentful-paint')[0]?.startTime")}
    time.sleep(3.0)
    tab.run(WATCH)
    disc = "centreOf([...trailmark.scene.obstacles.values()].find((shape) => shape.shape === 'disc'))"
    for name, point in (("end", "trailmark.scene.goal.slice(0, 2)"), ("obstacle", disc), ("view", "[-0.5, 13]")):
        place = on_screen(tab, *tab.run(point))
        tab.run("void (drawnAt.length = shownAt.length = 0)")
        tab.drag(place, (place[0] - 60, place[1]), steps=300, pause=0.004)
        drawn, shown = tab.run(RATES)
        found[f"frames a second, {name} dragged"] = round(drawn, 1)
        found[f"of the browser's, {name} dragged"] = round(drawn / shown, 3)
        tab.drag((place[0] - 60, place[1]), place, steps=10)
        time.sleep(1.0)
    return found


def memory(pid: int) -> float:
    """Return the MB (2^20 bytes) that a process has in memory."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def soak(tab: Browser, address: str, pid: int, minutes: float, clients: int) -> dict[str, Any]:
    """Return complaints and growth of memory over minutes of random drags, with programs as further clients."""
    tab.open("about:blank", 1400)  # the page before seeks its server, which has ended
    tab.complaints.clear()
    tab.open(address, 1400)
    tab.wait("trailmark.scene.path")
    end, rng, errors = time.monotonic() + 60.0 * minutes, np.random.default_rng(0), list[str]()

    def client(seed: int) -> None:
        own = np.random.default_rng(seed)
        with connect(address.replace("http", "ws") + "ws", max_size=None) as socket:
            socket.send(json.dumps({"type": "hello", "id": 0}))
            query = json.loads(socket.recv(timeout=30.0))["world"]["queries"][0]
            while time.monotonic() < end:
                goal = [query["goal"][0] + own.uniform(-1, 1), query["goal"][1] + own.uniform(-1, 1), 0.0]
                plan = {"type": "plan", "id": 1, "start": query["start"], "goal": goal, "time_limit": 0.05}
                socket.send(json.dumps(plan))
                answer = json.loads(socket.recv(timeout=30.0))
                while not (answer["type"] == "error" or answer.get("final")):
                    answer = json.loads(socket.recv(timeout=30.0))
                if answer["type"] == "error" and "not valid" not in answer["message"]:
                    errors.append(answer["message"])
                time.sleep(0.2)

    threads = [threading.Thread(target=client, args=(i,)) for i in range(clients - 1)]
    for thread in threads:
        thread.start()
    begun, taken = time.monotonic(), list[tuple[float, float]]()
    while time.monotonic() < end:
        a, b = rng.uniform((100, 150), (1000, 800), (2, 2)).tolist()
        goal = on_screen(tab, *tab.run("trailmark.scene.goal.slice(0, 2)"))
        tab.drag(goal if rng.random() < 0.7 else (a[0], a[1]), (b[0], b[1]), steps=30)
        if time.monotonic() - begun > 20.0 * (1 + len(taken)):
            page = float(tab.run("performance.memory.usedJSHeapSize")) / 2**20
            taken.append((memory(pid), page))
    for thread in threads:
        thread.join()
    third = max(1, len(taken) // 3)
    grown = np.median(taken[-third:], axis=0) - np.median(taken[:third], axis=0)
    return {
        "minutes": minutes,
        "clients": clients,
        "complaints": tab.complaints + errors,
        "server grew, MB": float(grown[0]),
        "page grew, MB": float(grown[1]),
    }


PARTS = ("drags", "page", "soak")


def measured(tab: Browser, part: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of a part."""
    found: dict[str, Any] = {"measured": describe_machine()}
    if part == "drags":
        for name, world in worlds().items():
            for kind, robot in ROBOTS.items():
                with server(world, robot) as (address, _):
                    found[f"{name}, {kind}"] = drags(tab, address, world, robot)
                    print(name, kind, found[f"{name}, {kind}"], flush=True)
        return found
    office = World.load("worlds/office.yaml"), ROBOTS["rectangle"]
    if part == "page" and arguments.base is not None:
        with server(*office, arguments.base) as (address, _):
            found |= {f"before: {key}": value for key, value in frames(tab, address).items()}
    with server(*office) as (address, pid):
        if part == "page":
            return found | frames(tab, address)
        return found | soak(tab, address, pid, arguments.minutes, arguments.clients)


def main() -> None:
    """Measure, print, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0, help="of random drags")
    parser.add_argument("--clients", type=int, default=5, help="at once, the browser among them")
    parser.add_argument("--base", help="another checkout, whose frames a second are measured in the same run")
    parser.add_argument("--part", choices=PARTS, action="append", help="to measure; others stay as they were")
    parser.add_argument("--report", action="store_true", help="write the results")
    arguments = parser.parse_args()
    file = RESULTS / "live.json"
    found: dict[str, Any] = json.loads(file.read_text()) if arguments.part else {}
    with browser() as tab:
        for part in arguments.part or PARTS:
            found[part] = measured(tab, part, arguments)
    rows = [
        [*name.split(", "), what, *(f"{values[key]:.0f} ms" for key in ("median", "95 %", "most"))]
        for name, figures in found["drags"].items()
        if name != "measured"
        for what, values in figures.items()
    ]
    page = [
        "# The live page",
        "From a move of the mouse to the frame with the certified path (33 ms wanted for ends, 50 for obstacles):",
        markdown_table(["world", "robot", "dragged", "median", "95 %", "most"], rows),
        found["drags"]["measured"],
    ]
    for part in PARTS[1:]:
        page.append("\n".join(f"- {key}: {value}" for key, value in found[part].items() if key != "measured"))
        page.append(found[part]["measured"])
    print("\n\n".join(page))
    if arguments.report:
        write_atomically(file, json.dumps(found, indent=1) + "\n")
        write_atomically(RESULTS / "live.md", "\n\n".join(page) + "\n")


if __name__ == "__main__":
    main()
