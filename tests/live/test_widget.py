from __future__ import annotations

import json
import queue
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from jupyter_client.manager import KernelManager
from tests.helpers.chromium import Browser

from trailmark import Disc, Rectangle, Robot, World
from trailmark.errors import ConfigurationError
from trailmark.live.widget import MAX_VIEWS

WORLD = World("room", (0.0, 0.0, 10.0, 8.0), (Rectangle((5.0, 3.0), 0.4, 6.0),), robot=Robot.disc(0.3))
PLAN = {"type": "plan", "id": 2, "start": [1.0, 1.0, 0.0], "goal": [9.0, 1.0, 0.0], "time_limit": 0.3}


class Notebook:
    """A widget, and what it sends."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **options: Any) -> None:
        self.sent = queue.Queue[dict[str, Any]]()
        self.widget = WORLD.live(**options)
        monkeypatch.setattr(self.widget, "send", self.sent.put)

    def give(self, content: object) -> None:
        """Give it what a page sends."""
        self.widget._handle_custom_msg(content, [])

    def states(self) -> np.ndarray[Any, Any]:
        """Return the states of the path that it knows."""
        path = self.widget.path
        assert path is not None
        states: np.ndarray[Any, Any] = path.states
        return states

    def ask(self, message: dict[str, Any], view: str = "a") -> dict[str, Any]:
        """Return the final answer to a message of a view."""
        self.give({"view": view, "frame": json.dumps(message)})
        while True:
            content = self.sent.get(timeout=60.0)
            answer: dict[str, Any] = json.loads(content["frame"])
            if content["view"] == view and answer["id"] == message["id"] and answer.get("final", True):
                return answer


@pytest.fixture
def notebook(monkeypatch: pytest.MonkeyPatch) -> Iterator[Notebook]:
    """Return a widget of the world."""
    found = Notebook(monkeypatch)
    yield found
    found.widget.close()


def test_messages_go_by_the_comm_to_the_page_s_session(notebook: Notebook) -> None:
    assert notebook.ask({"type": "hello", "id": 1})["world"]["name"] == "room"
    assert notebook.widget.path is None
    answer = notebook.ask(PLAN)
    assert answer["status"] == "solved"
    assert notebook.states().tolist() == answer["states"]
    notebook.ask(
        {"type": "edit", "id": 3, "add": [{"shape": "disc", "center": [8.0, 7.0], "radius": 0.5, "id": "new"}]}
    )
    world = notebook.widget.world
    assert world.obstacles[1] == Disc((8.0, 7.0), 0.5)
    assert world.queries[0].goal == (9.0, 1.0, 0.0)
    assert notebook.ask({"type": "fly", "id": 4})["message"].startswith("type: expected")
    # Another view goes on where this one is, and has a planner of its own.
    assert len(notebook.ask({"type": "hello", "id": 1}, view="b")["world"]["obstacles"]) == 2


def test_what_is_no_message_of_a_page_is_passed_over(notebook: Notebook) -> None:
    strange: list[object] = [{"view": 3, "frame": "{}"}, {"view": "a", "frame": 3}, {"view": "z", "frame": None}]
    for content in (None, "x", [], {}, *strange):
        notebook.give(content)
    for view in range(3 * MAX_VIEWS):
        notebook.give({"view": str(view), "frame": "{"})
    answers = [notebook.sent.get(timeout=30.0) for _ in range(MAX_VIEWS)]
    assert {json.loads(answer["frame"])["type"] for answer in answers} == {"error"}
    # A view that is closed makes room for another.
    notebook.give({"view": "0", "frame": None})
    assert notebook.ask({"type": "hello", "id": 1}, view="next")["type"] == "world"


def test_there_is_a_picture_where_no_widget_is_shown(notebook: Notebook) -> None:
    data, _ = notebook.widget._repr_mimebundle_()
    assert set(data) == {"application/vnd.jupyter.widget-view+json", "image/svg+xml", "text/plain"}
    assert data["image/svg+xml"].startswith("<svg")
    assert "room" in data["text/plain"]


def test_bad_arguments_and_a_missing_library_are_told_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigurationError, match="names none"):
        World("bare", (0.0, 0.0, 1.0, 1.0)).live()
    with pytest.raises(ConfigurationError, match=r"live: height: .*got 3"):
        WORLD.live(height=3)
    monkeypatch.setitem(sys.modules, "anywidget", None)
    monkeypatch.delitem(sys.modules, "trailmark.live.widget")
    with pytest.raises(ConfigurationError, match=r"needs anywidget: pip install 'trailmark\[notebook\]'"):
        WORLD.live()


HOST = """(async () => {
  const heard = new Set(), data = DATA;
  window.out = [];
  window.model = {get: (name) => data[name], send: (content) => out.push(content),
    on: (name, call) => heard.add(call), off: (name, call) => heard.delete(call)};
  window.answer = (content) => [...heard].forEach((call) => call(content));
  const esm = await import(URL.createObjectURL(new Blob([data._esm], {type: "text/javascript"})));
  document.body.innerHTML = "<div id=cell style='width: 1000px'></div>";
  window.leave = esm.default.render({model, el: document.getElementById("cell")});
})()"""
FRAME = "document.querySelector('iframe')"


def pump(tab: Browser, notebook: Notebook, until: str, seconds: float = 60.0) -> None:
    """Carry messages between the browser and the widget until an expression is true in the page."""
    deadline = time.monotonic() + seconds
    while not tab.run(f"(() => {{ try {{ return Boolean({until}); }} catch {{ return false; }} }})()"):
        assert time.monotonic() < deadline, (until, tab.complaints)
        for content in tab.run("out.splice(0)"):
            notebook.give(content)
        while not notebook.sent.empty():
            tab.run(f"answer({json.dumps(notebook.sent.get())})")
        time.sleep(0.01)


def test_the_page_runs_in_a_cell(tab: Browser, notebook: Notebook) -> None:
    traits = {name: getattr(notebook.widget, name) for name in ("page", "picture", "height", "_esm")}
    tab.complaints.clear()
    tab.open("data:text/html,<title>notebook</title>", 1400)
    tab.run(HOST.replace("DATA", json.dumps(traits).replace("</", "<\\/")))
    # Nobody has answered yet: the picture is shown.
    assert tab.run("document.querySelector('img').complete") is not None
    assert tab.run(f"{FRAME}.style.visibility") == "hidden"
    page = f"{FRAME}.contentWindow.trailmark"
    pump(tab, notebook, f"{page}.scene.path?.states.length > 2")
    assert tab.run(f"{FRAME}.style.visibility") == "visible"
    assert tab.run("document.querySelector('img')") is None
    assert tab.run("document.getElementById('cell').clientHeight") == 640
    x, y = tab.run(
        f"(() => {{ const f = {FRAME}, b = f.getBoundingClientRect(), c = f.contentDocument.getElementById('map')"
        f".getBoundingClientRect(), p = {page}.view.toScreen(...{page}.scene.goal);"
        " return [b.left + c.left + p[0], b.top + c.top + p[1]]; })()"
    )
    tab.drag((x, y), (x - 80, y), steps=5)
    pump(tab, notebook, f"{page}.inFlight.size === 0 && {page}.scene.path.final")
    goal = tab.run(f"{page}.scene.goal")
    assert notebook.widget.world.queries[0].goal == pytest.approx(goal)
    assert notebook.states()[-1].tolist() == pytest.approx(goal)
    tab.run("leave()")
    assert tab.run("out.at(-1).frame") is None
    assert tab.complaints == []


@pytest.mark.slow
def test_a_kernel_answers_a_page(tmp_path: Any) -> None:
    manager = KernelManager(kernel_name="python3")
    manager.start_kernel(cwd=str(tmp_path), extra_arguments=["--HistoryManager.enabled=False"])
    client = manager.client()
    client.start_channels()
    try:
        client.wait_for_ready(timeout=120)
        client.execute("import trailmark\nlive = trailmark.World.load('office').live()\nlive")
        shown, comm = None, None
        while shown is None or comm is None:
            message = client.get_iopub_msg(timeout=120)
            content = message["content"]
            assert message["msg_type"] != "error", content
            if message["msg_type"] == "comm_open" and "page" in content["data"]["state"]:
                comm = content["comm_id"]
            elif message["msg_type"] in ("execute_result", "display_data"):
                shown = content["data"]
        assert shown["application/vnd.jupyter.widget-view+json"]["model_id"] == comm
        assert "image/svg+xml" in shown
        frame = json.dumps({"type": "hello", "id": 1})
        data = {"method": "custom", "content": {"view": "a", "frame": frame}}
        client.shell_channel.send(client.session.msg("comm_msg", {"comm_id": comm, "data": data}))
        while True:
            message = client.get_iopub_msg(timeout=120)
            if message["msg_type"] == "comm_msg" and message["content"]["data"]["method"] == "custom":
                break
        answer = json.loads(message["content"]["data"]["content"]["frame"])
        assert (answer["type"], answer["id"], answer["name"]) == ("world", 1, "office")
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
