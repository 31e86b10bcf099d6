"""Plain data as the models of :mod:`trailmark.formats.schema`, or one line that says what is wrong with it."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from trailmark.errors import FormatError, expected_name
from trailmark.formats import schema

__all__ = ["validate"]

_KINDS: dict[str, dict[str, type[BaseModel]]] = {
    "robot": {"disc": schema.DiscRobot, "rectangle": schema.RectangleRobot, "polygon": schema.PolygonRobot},
    "obstacles": {
        "disc": schema.DiscObstacle,
        "rectangle": schema.RectangleObstacle,
        "polygon": schema.PolygonObstacle,
    },
    "mean": {"disc": schema.DiscShape, "rectangle": schema.RectangleShape, "polygon": schema.PolygonShape},
    "zones": {
        "cost": schema.CostZoneEntry,
        "keep-out": schema.KeepOutZoneEntry,
        "one-way": schema.OneWayZoneEntry,
        "speed": schema.SpeedZoneEntry,
    },
}
_PARTS: dict[str, type[BaseModel]] = {
    "queries": schema.QueryEntry,
    "goal": schema.GoalEntry,
    "estimate": schema.EstimateEntry,
    "motion": schema.MotionEntry,
    "risk": schema.RiskEntry,
    "grid": schema.GridEntry,
}
_MODELS = (*(model for name in ("robot", "obstacles", "zones") for model in _KINDS[name].values()), *_PARTS.values())
_POINT_DEPTH = {"vertices": 1, "boundary": 1, "holes": 2}  # indices from the field down to one point
_GOALS = {"a pose", "one goal", "several goals"}
_TAGS = {"shape": ("disc", "polygon", "rectangle"), "kind": ("cost", "keep-out", "one-way", "speed")}
_ALL_TAGS = {tag for tags in _TAGS.values() for tag in tags} | _GOALS

ModelT = TypeVar("ModelT", bound=BaseModel)

_short = reprlib.Repr()
_short.maxstring = 60
_short.maxlist = _short.maxdict = 5
_short.maxlevel = 3


def validate(model: type[ModelT], data: dict[str, Any], path: Path) -> ModelT:
    """Return the data as a model.

    Args:
        model: :class:`.schema.WorldFile`, :class:`.schema.MapFile` or :class:`.schema.RobotFile`.
        data: plain data, as :func:`trailmark.formats.yaml_data.parse_yaml` gives it.
        path: the file it came from, for messages.

    Raises:
        FormatError: the data breaks the model's rules; the message names the first field that does, its value
            and what is allowed, and how many more there are.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        # An unknown key goes first: a key that is missing elsewhere is often the same one, misspelt.
        problems = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise FormatError(path, _describe(model, problems[0]) + more) from None


def _describe(model: type[BaseModel], problem: Any) -> str:
    *before, last = problem["loc"]
    # Who made up a key may have given it the name of a tag, but for those of goals, which hold a blank.
    ends = [] if last in _GOALS else [last]
    kind, location = problem["type"], [*(part for part in before if part not in _ALL_TAGS), *ends]
    where, value = _where(location), _short.repr(problem["input"])
    if kind == "extra_forbidden":
        allowed = expected_name(str(location[-1]), _model_at(model, problem["loc"]).model_fields)
        return f"{where}: unknown key; {allowed}"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        key = problem["ctx"]["discriminator"].strip("'")
        given = problem["input"].get(key) if isinstance(problem["input"], dict) else problem["input"]
        if kind == "union_tag_not_found":
            return f"{where}.{key}: expected {', '.join(_TAGS[key])}, got nothing"
        return f"{where}.{key}: {expected_name(str(given), _TAGS[key])}"
    allowed = _allowed(model, location, kind)
    return f"{where}: expected {allowed}, got {'nothing' if kind == 'missing' else value}"


def _allowed(model: type[BaseModel], location: Sequence[str | int], kind: str) -> str:
    depth = next(i for i, part in enumerate(reversed(location)) if isinstance(part, str))
    field = str(location[-1 - depth])
    if depth and kind in ("float_type", "finite_number"):
        return schema.ANGLE if field in ("start", "goal") and location[-1] == 2 else "a finite number"
    if depth and field in ("obstacles", "queries", "zones", "goal") and kind.startswith("model"):
        return "a mapping"
    if depth and depth == _POINT_DEPTH.get(field):
        return schema.POINT
    owners = (model, *_MODELS) if len(location) == 1 else (*_MODELS, model)
    allowed = next(owner.model_fields[field].description for owner in owners if field in owner.model_fields)
    return allowed or ", ".join(_TAGS[field])


def _model_at(model: type[BaseModel], location: Sequence[str | int]) -> type[BaseModel]:
    """Return the model that the last key of a location was given to."""
    names = [part for part in location if isinstance(part, str) and part not in _GOALS][:-1]
    if not names:
        return model
    return _PARTS[names[-1]] if names[-1] in _PARTS else _KINDS[names[-2]][names[-1]]


def _where(location: Sequence[str | int]) -> str:
    # A key that someone made up may hold anything: what is no plain name is quoted and cut.
    named = (part if isinstance(part, int) or part.isidentifier() else _short.repr(part) for part in location)
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in named).removeprefix(".")
