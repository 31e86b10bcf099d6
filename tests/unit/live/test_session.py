from __future__ import annotations

import json
from dataclasses import replace
from threading import Event
from typing import Any

import numpy as np
import pytest
import shapely

from trailmark import Disc, PlanResult, Polygon, Rectangle, Robot, TrailmarkError, World
from trailmark.live.messages import FIELDS, MAX_BYTES, Message, MessageError, read_message
from trailmark.live.session import MAX_OBSTACLES, Session

WALL = Rectangle((5.0, 3.0), 0.4, 6.0)
WORLD = World("room", (0.0, 0.0, 10.0, 8.0), (WALL, Disc((8.0, 2.0), 0.5)), ids=("wall", None))
ROBOT = Robot.rectangle(0.6, 0.4)
START, GOAL = [1.0, 1.0, 0.0], [9.0, 1.0, 0.0]


class Client:
    """A session, and what it told."""

    def __init__(self, world: World = WORLD, robot: Robot = ROBOT) -> None:
        self.told: list[dict[str, Any]] = []
        self.stop_at_first: Event | None = None
        self.session = Session(world, robot, self.take)

    def take(self, answer: dict[str, Any]) -> None:
        """Keep an answer; the plan that it is of may have to end at it."""
        self.told.append(answer)
        if self.stop_at_first is not None:
            self.stop_at_first.set()

    def ask(self, kind: str, stop: Event | None = None, **fields: Any) -> list[dict[str, Any]]:
        """Return the answers to a message."""
        for name, value in fields.items():
            assert FIELDS[kind][name].allows(value)
        before = len(self.told)
        self.session.handle(Message(kind, 7, fields), stop or Event())
        answers = self.told[before:]
        assert all(answer["id"] == 7 for answer in answers)
        return answers

    def states(self) -> np.ndarray[Any, Any]:
        """Return the states of the path from START to GOAL."""
        answers = self.ask("plan", start=START, goal=GOAL, time_limit=0.15)
        assert [answer["final"] for answer in answers] == [False] * (len(answers) - 1) + [True]
        assert answers[-1]["status"] == "solved"
        return np.array(answers[-1]["states"])

    def first_states(self) -> np.ndarray[Any, Any]:
        """Return the states of the first path from START to GOAL, with which the plan ends."""
        self.stop_at_first = Event()
        answers = self.ask("plan", self.stop_at_first, start=START, goal=GOAL, time_limit=10.0)
        self.stop_at_first = None
        assert answers[-1]["status"] == "solved"
        return np.array(answers[-1]["states"])


@pytest.fixture(scope="module")
def unchanged() -> Client:
    """Return a client for what changes nothing."""
    client = Client()
    assert client.first_states()[:, 1].max() > 6.0, "above the wall"
    return client


def swept(states: np.ndarray[Any, Any]) -> Any:
    """Return about what the robot's middle covers: its inscribed disc along the path."""
    return shapely.LineString(states[:, :2]).buffer(0.19)


@pytest.mark.slow
def test_a_plan_passes_via_points_in_their_order(unchanged: Client) -> None:
    via = [[2.0, 7.0], [8.0, 7.0, 1.0]]
    record = unchanged.ask("plan", start=START, goal=GOAL, time_limit=0.5, via=via)[-1]
    assert (record["status"], len(record["legs"])) == ("solved", 3)
    line = shapely.LineString(np.array(record["states"])[:, :2])
    along = [line.project(shapely.Point(place[:2])) for place in via]
    assert [line.distance(shapely.Point(place[:2])) for place in via] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert along == sorted(along)
    assert any(np.allclose(state, via[1]) for state in record["states"])
    blocked = unchanged.ask("plan", start=START, goal=GOAL, time_limit=0.5, via=[[5.0, 3.0]])[-1]
    assert blocked["status"] == "infeasible"
    assert blocked["reason"].startswith("leg 1 of 2, from start to via point 1")
    for wrong in ([[1.0]], ["a"], [[1.0, 2.0, 3.0, 4.0]], [[1.0, None]]):
        with pytest.raises(TrailmarkError, match=r"^goals: goal: pose: .*[^\n]$"):
            unchanged.ask("plan", start=START, goal=GOAL, via=wrong)
    with pytest.raises(MessageError, match=r"plan\.via: expected at most 100 places"):
        read_message(json.dumps({"type": "plan", "start": START, "goal": GOAL, "via": [[1, 1]] * 101}))


def test_unknown_regions_are_told_and_kept_while_the_world_is_the_same() -> None:
    hole = np.array([[4.0, 4.0], [5.0, 4.0], [5.0, 5.0], [4.0, 5.0]])
    region = Polygon(np.array([[3.0, 3.0], [6.0, 3.0], [6.0, 6.0], [3.0, 6.0]]), (hole,))
    client = Client(replace(WORLD, unknown=(region,)))
    told = client.ask("hello")[-1]
    assert told["unknown"] == [{"vertices": region.vertices.tolist(), "holes": [region.holes[0].tolist()]}]
    again = client.ask("world", world=told["world"])[-1]
    assert again["unknown"] == told["unknown"]
    assert client.ask("world", world={**told["world"], "name": "another"})[-1]["unknown"] == []


@pytest.mark.slow
def test_a_plan_answers_at_once_and_ends_with_the_record_of_the_shell() -> None:
    client = Client()
    answers = client.ask("plan", start=START, goal=GOAL, time_limit=0.5)
    record = set(PlanResult("timeout", None, 0, None, None, None, 0, 0).to_dict(world="room"))
    for answer in answers:
        assert record | {"type", "id", "final"} <= set(answer)
        assert answer["type"] == "path"
        assert answer["status"] == "solved"
        assert answer["states"][0] == START
        assert answer["states"][-1] == GOAL
    costs = [answer["cost"] for answer in answers]
    assert costs == sorted(costs, reverse=True)
    assert len({answer["time"]["first_solution"] for answer in answers[:-1]}) <= 1
    assert answers[-1]["final"]
    assert answers[-1]["lower_bound"] <= answers[-1]["cost"]
    assert not swept(np.array(answers[-1]["states"])).intersects(shapely.box(4.8, 0.0, 5.2, 6.0))


@pytest.mark.slow
def test_edits_change_what_is_planned_in() -> None:
    client = Client()
    above = client.states()
    assert above[:, 1].max() > 6.0
    (moved,) = client.ask("edit", move={"wall": [0.0, 2.0]})
    assert moved["type"] == "world"
    assert [shape["id"] for shape in moved["world"]["obstacles"]] == ["wall", "o1"]
    assert moved["world"]["robot"] == {"shape": "rectangle", "length": 0.6, "width": 0.4}
    assert moved["world"]["obstacles"][0]["center"] == [5.0, 5.0]
    assert "world" not in client.ask("edit", brief=True)[0]
    assert client.states()[:, 1].max() < 2.0
    client.ask("edit", remove=["wall"])
    assert len(client.states()) == 2
    (added,) = client.ask(
        "edit",
        add=[
            {"shape": "polygon", "vertices": [[4.8, -0.5], [5.2, -0.5], [5.2, 5.0], [4.8, 5.0]], "id": "new wall"},
            {"shape": "disc", "center": [1.0, 6.0], "radius": 0.2},
        ],
        remove=[0],
    )
    assert added["added"][0] == "new wall"
    assert added["obstacles"] == 2
    assert [type(shape) for shape in client.session.world.obstacles] == [Polygon, Disc]
    assert client.states()[:, 1].max() > 5.0
    # An index may come as a key.
    (moved,) = client.ask("edit", move={"1": [0.5, 0.0]})
    assert moved["world"]["obstacles"][1]["center"] == [1.5, 6.0]


BAD_EDITS: dict[str, dict[str, Any]] = {
    "unknown id": {"remove": ["nobody"]},
    "negative index key": {"move": {"-1": [0.0, 0.0]}},
    "no number": {"move": {"wall": ["a", 0.0]}},
    "twice": {"remove": ["wall"], "move": {"wall": [1.0, 0.0]}},
    "taken": {"add": [{"shape": "disc", "center": [1.0, 1.0], "radius": 0.1, "id": "wall"}]},
    "the same twice": {"add": [{"shape": "disc", "center": [1.0, 1.0], "radius": 0.1, "id": "new"}] * 2},
    "no shape": {"add": [{"shape": "blob"}]},
    "no mapping": {"add": [3]},
    "crossing itself": {"add": [{"shape": "polygon", "vertices": [[0, 0], [1, 1], [1, 0], [0, 1]]}]},
    "half right": {"move": {"wall": [0.0, 1.0]}, "add": [{"shape": "disc", "center": [1.0, 1.0], "radius": -1.0}]},
    "a list for an id": {"remove": [["wall"]]},
}


@pytest.mark.parametrize("name", BAD_EDITS)
def test_a_bad_edit_changes_nothing(name: str, unchanged: Client) -> None:
    client, world = unchanged, unchanged.session.world
    with pytest.raises(TrailmarkError):
        client.ask("edit", **BAD_EDITS[name])
    assert client.session.world is world
    assert client.session.planner.world is world
    assert client.first_states()[:, 1].max() > 6.0


@pytest.mark.slow
def test_a_world_that_cannot_be_planned_in_leaves_the_old_one() -> None:
    client = Client()
    client.states()
    with pytest.raises(TrailmarkError, match="at most 20,000 obstacles"):
        client.ask("edit", add=[{"shape": "disc", "center": [1.0, 6.0], "radius": 0.01}] * (MAX_OBSTACLES - 1))
    content = client.ask("hello")[0]["world"]
    bad: list[dict[str, Any]] = [
        {**content, "bounds": [0, 0, 0, 0]},
        {**content, "robot": {"shape": "disc", "radius": 0}},
        {**content, "more": 1},
        {**content, "trailmark": 2},
    ]
    for world in bad:
        with pytest.raises(TrailmarkError):
            client.ask("world", world=world)
    client.states()
    (answer,) = client.ask("world", world={**content, "robot": {"shape": "disc", "radius": 0.2}}, clearance=0.1)
    assert answer["world"]["robot"] == {"shape": "disc", "radius": 0.2}
    final = client.ask("plan", start=START, goal=GOAL, time_limit=0.2)[-1]
    assert final["min_clearance"] >= 0.1 - 1e-9


@pytest.mark.slow
def test_goals_as_a_world_file_has_them() -> None:
    client = Client()
    final = client.ask("plan", start=START, goal=GOAL[:2], time_limit=0.2)[-1]
    assert final["states"][-1][:2] == GOAL[:2]
    region = {"region": [[8.5, 6.0], [9.5, 6.0], [9.5, 7.0], [8.5, 7.0]]}
    final = client.ask("plan", start=START, goal=region, time_limit=0.2)[-1]
    assert final["states"][-1][1] >= 6.0


def test_a_plan_that_is_stopped_or_was_never_begun_has_an_end() -> None:
    client, stop = Client(), Event()
    stop.set()
    assert client.ask("plan", stop, start=START, goal=GOAL, time_limit=30.0)[-1]["final"]
    answer = client.session.not_planned(Message("plan", 9, {}))
    assert (answer["id"], answer["final"], answer["status"], answer["states"]) == (9, True, "timeout", [])


@pytest.mark.slow
def test_the_path_that_is_followed_is_kept_or_led_around() -> None:
    client = Client()
    states = client.states()
    here = states[0] + 0.3 * (states[1] - states[0])
    (kept,) = client.ask("replan", start=here.tolist(), goal=GOAL, time_limit=0.15)
    assert kept["kept"]
    x, y = states[len(states) // 2, :2]
    client.ask("edit", add=[{"shape": "disc", "center": [float(x), float(y) + 0.1], "radius": 0.2}])
    (around,) = client.ask("replan", start=here.tolist(), goal=GOAL, time_limit=0.5)
    assert not around["kept"]
    assert around["status"] == "solved"
    assert around["reason"]


def test_the_text_that_is_saved_is_the_world() -> None:
    client = Client()
    client.ask("edit", remove=["wall"])
    (saved,) = client.ask("save", start=START, goal=GOAL)
    other = Client()
    (opened,) = other.ask("open", text=saved["text"])
    assert opened["type"] == "world"
    assert opened["world"]["obstacles"] == [{"shape": "disc", "center": [8.0, 2.0], "radius": 0.5, "id": "o1"}]
    assert opened["world"]["queries"] == [{"name": "live", "start": START, "goal": GOAL}]


@pytest.mark.parametrize(
    "fields",
    [{"text": "image: x.pgm"}, {"text": "- 1"}, {"text": "{"}, {"name": "../office"}, {}],
    ids=["a map", "a list", "no YAML", "a path", "nothing"],
)
def test_what_is_opened_is_a_world_file_or_a_shipped_name(fields: dict[str, Any]) -> None:
    client = Client()
    with pytest.raises(TrailmarkError, match="expected"):
        client.ask("open", **fields)


BAD = {
    "no JSON": ("{", None, "expected a JSON object"),
    "a list": ("[1]", None, "expected a JSON object, got [1]"),
    "deep nesting": ("[" * 100_000, None, "expected a JSON object"),
    "no type": ('{"id": 3}', 3, "type: expected"),
    "another type": ('{"id": 3, "type": "plann"}', 3, "did you mean 'plan'?"),
    "a mapping for an id": ('{"id": {}, "type": "stop"}', None, "id: expected"),
    "an unknown field": ('{"id": 3, "type": "stop", "now": 1}', 3, "stop: unknown field"),
    "a field left out": ('{"id": 3, "type": "plan", "start": [0, 0, 0]}', 3, "plan.goal: expected"),
    "a text for seconds": ('{"id": 3, "type": "plan", "start": [], "goal": [], "time_limit": "1"}', 3, "time_limit"),
    "an hour": ('{"id": 3, "type": "plan", "start": [], "goal": [], "time_limit": 3600}', 3, "at most 60, got 3600"),
    "infinity": ('{"id": 3, "type": "plan", "start": [], "goal": [], "time_limit": 1e999}', 3, "time_limit"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_understood_is_told_in_a_line(name: str) -> None:
    text, identity, problem = BAD[name]
    with pytest.raises(MessageError) as raised:
        read_message(text)
    assert raised.value.id == identity
    assert problem in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_message_has_a_longest() -> None:
    world = {"type": "world", "id": 1, "world": {"name": ""}}
    short = len(json.dumps(world))
    world["world"] = {"name": "a" * (MAX_BYTES - short)}
    message = read_message(json.dumps(world))
    assert (message.type, message.id, message.fields["world"]) == ("world", 1, world["world"])
    world["world"] = {"name": "a" * (MAX_BYTES - short + 1)}
    with pytest.raises(MessageError, match="at most 1,000,000 bytes"):
        read_message(json.dumps(world))
    with pytest.raises(MessageError, match="at most 1,000,000 bytes"):
        read_message(json.dumps({"type": "é" * 600_000}, ensure_ascii=False))
