"""A path file's content as the path to audit: the curves of a car that trailmark planned for, else its states."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

from trailmark.arguments import brief, real
from trailmark.curves import CurvePath, Steering
from trailmark.errors import FormatError, TrailmarkError
from trailmark.formats.any_path import PathFile
from trailmark.path import Path
from trailmark.robot import TURNING_LIMIT

__all__ = ["recorded_path"]

SMALLEST_RADIUS = 1e-6
"""Metres: who follows a smaller turning radius turns in place, and its arcs would be more than can be audited."""


def recorded_path(found: PathFile, file: FilePath) -> Path:
    """Return what a path file describes: a :class:`~trailmark.curves.CurvePath` if it records curves, else its states.

    Curves count as long as the states beside them are theirs: who edits the states wants those.

    Raises:
        FormatError: curves that are none.
    """
    if found.curve is None:
        return found.path
    curve = found.curve if isinstance(found.curve, dict) else {}
    kind, radius, knots, places = (curve.get(key) for key in ("kind", "turning_radius", "knots", "places"))
    if kind not in ("dubins", "reeds-shepp"):
        raise FormatError(file, f"curve: kind: expected dubins or reeds-shepp, got {brief(kind)}")
    if not SMALLEST_RADIUS <= real(radius) <= TURNING_LIMIT:
        allowed = f"expected metres from {SMALLEST_RADIUS:g} to {TURNING_LIMIT:g}"
        raise FormatError(file, f"curve: turning radius: {allowed}, got {brief(radius)}")
    try:
        curves = CurvePath(knots, Steering(real(radius), reverse=kind == "reeds-shepp"), places)  # type: ignore[arg-type]  # checked
    except TrailmarkError as error:
        raise FormatError(file, f"curve: {error}") from None
    same = len(curves) == len(found.path) and np.allclose(curves.states, found.path.states, rtol=0.0, atol=1e-6)
    return curves if same else found.path
