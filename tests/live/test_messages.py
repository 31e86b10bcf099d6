from __future__ import annotations

import json

import pytest

from trailmark.live.messages import FIELDS, MAX_BYTES, MessageError, read_message


def test_a_message_keeps_its_id_and_fields() -> None:
    text = json.dumps({"type": "plan", "id": "seven", "start": [1, 2, 0], "goal": [3, 4], "time_limit": 0.5})
    message = read_message(text)
    assert (message.type, message.id) == ("plan", "seven")
    assert message.fields == {"start": [1, 2, 0], "goal": [3, 4], "time_limit": 0.5}


BAD = {
    "no JSON": ("{", None, "expected a JSON object"),
    "a list": ("[1]", None, "expected a JSON object, got [1]"),
    "a number that is none": ('{"type": "stop", "id": NaN}', None, "expected a JSON object"),
    "deep nesting": ("[" * 100_000, None, "expected a JSON object"),
    "no type": ('{"id": 3}', 3, "type: expected"),
    "another type": ('{"id": 3, "type": "plann"}', 3, "did you mean 'plan'?"),
    "a type that is no text": ('{"id": 3, "type": ["plan"]}', 3, "type: expected"),
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
    assert read_message(json.dumps(world)).type == "world"
    world["world"] = {"name": "a" * (MAX_BYTES - short + 1)}
    with pytest.raises(MessageError, match="at most 1,000,000 bytes"):
        read_message(json.dumps(world))
    with pytest.raises(MessageError, match="at most 1,000,000 bytes"):
        read_message(json.dumps({"type": "é" * 600_000}, ensure_ascii=False))


def test_each_type_is_known_to_somebody() -> None:
    assert {"world", "edit", "plan"} <= set(FIELDS)
