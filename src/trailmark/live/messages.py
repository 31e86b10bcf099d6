"""Messages of the live page's WebSocket: JSON objects, each with a type, and an id that its answers repeat."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from trailmark.arguments import brief
from trailmark.errors import ConfigurationError, expected_name

__all__ = ["FIELDS", "MAX_BYTES", "MAX_SECONDS", "Identity", "Message", "MessageError", "read_message"]

MAX_BYTES: Final = 1_000_000
"""Of a message: a world of some ten thousand obstacles."""

MAX_SECONDS: Final = 60.0
"""That a plan may take: one who is gone for good must not keep a processor busy."""

Identity = int | float | str | None
"""What a message calls itself; answers repeat it."""


class MessageError(ConfigurationError):
    """A message that cannot be understood.

    Attributes:
        id: the message's own, if it could be read.
    """

    def __init__(self, identity: Identity, problem: str) -> None:
        super().__init__(problem)
        self.id = identity


class Message(NamedTuple):
    """A message that was understood.

    Attributes:
        type: what it asks for, one of :data:`FIELDS`.
        id: repeated in each answer to it.
        fields: the others, by their names, each of the kind that :data:`FIELDS` says.
    """

    type: str
    id: Identity
    fields: Mapping[str, Any]


class Field(NamedTuple):
    """What a field may hold."""

    expected: str
    allows: Callable[[Any], bool]
    required: bool = False


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _is_list(value: Any) -> bool:
    return isinstance(value, list)


def _is_mapping(value: Any) -> bool:
    return isinstance(value, dict)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


_SECONDS = Field(
    f"a number of seconds above 0, at most {MAX_SECONDS:g}", lambda v: _is_number(v) and 0 < v <= MAX_SECONDS
)
_START = Field("a configuration [x, y, theta]", _is_list, required=True)
_GOAL = Field(
    "a configuration [x, y, theta], a point [x, y], or goals as a world file has them",
    lambda v: _is_list(v) or _is_mapping(v),
    required=True,
)
_VIA = Field("at most 100 places [x, y] or [x, y, theta] to pass", lambda v: _is_list(v) and len(v) <= 100)
_FLAG = Field("true or false", lambda v: isinstance(v, bool))
_TEXT = Field("a text", _is_text)

FIELDS: Final[Mapping[str, Mapping[str, Field]]] = {
    # The world as it is.
    "hello": {},
    "world": {
        "world": Field("a world file's content", _is_mapping, required=True),
        "clearance": Field("metres, 0 or more", lambda v: _is_number(v) and v >= 0),
        "objective": Field("length, time or clearance", lambda v: v in ("length", "time", "clearance")),
    },
    "edit": {
        "add": Field("a list of obstacles", _is_list),
        "remove": Field("a list of ids or indices", _is_list),
        "move": Field("a mapping of ids or indices to [dx, dy] or [dx, dy, dtheta]", _is_mapping),
        # Whether the answer leaves out the world: who drags knows it.
        "brief": _FLAG,
    },
    "plan": {"start": _START, "goal": _GOAL, "time_limit": _SECONDS, "via": _VIA},
    # A path from where the robot is, in a world that changed: the one being followed is kept or led around.
    "replan": {"start": _START, "goal": _GOAL, "time_limit": _SECONDS},
    "stop": {},
    # The text of a world file, or a shipped world's name; the world that it is answers.
    "open": {"text": _TEXT, "name": _TEXT},
    # The world as the text of a world file, with start and goal as its query.
    "save": {"start": _START, "goal": _GOAL},
}
"""What each type of message holds besides ``type`` and ``id``."""


def read_message(text: str) -> Message:
    """Return the message that a text frame holds.

    Raises:
        MessageError: it is too long, no JSON object, of no known type, or a field is missing, unknown or of another
            kind than is expected.
    """
    if len(text) > MAX_BYTES or len(text.encode(errors="surrogatepass")) > MAX_BYTES:
        raise MessageError(None, f"message: expected at most {MAX_BYTES:,} bytes, got {len(text.encode()):,}")
    try:
        data = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise MessageError(None, f"message: expected a JSON object, got {brief(text)} ({brief(str(error))})") from None
    if not isinstance(data, dict):
        raise MessageError(None, f"message: expected a JSON object, got {brief(data)}")
    identity, kind = data.pop("id", None), data.pop("type", None)
    if isinstance(identity, bool | list | dict) or (isinstance(identity, str) and len(identity) > 100):
        raise MessageError(None, f"id: expected a number or a text of at most 100 characters, got {brief(identity)}")
    if not isinstance(kind, str) or kind not in FIELDS:
        raise MessageError(identity, f"type: {expected_name(str(kind), FIELDS)}")
    fields = FIELDS[kind]
    for name, value in data.items():
        if name not in fields:
            raise MessageError(identity, f"{kind}: unknown field; {expected_name(name, fields)}")
        if not fields[name].allows(value):
            raise MessageError(identity, f"{kind}.{name}: expected {fields[name].expected}, got {brief(value)}")
    for name, field in fields.items():
        if field.required and name not in data:
            raise MessageError(identity, f"{kind}.{name}: expected {field.expected}, got nothing")
    return Message(kind, identity, data)


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON number")
