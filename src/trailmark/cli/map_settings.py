"""What the options of ``trailmark map`` mean for :func:`trailmark.estimation.map_log`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from trailmark.cli.options import UsageError, read_configuration, read_count, read_length, read_number

if TYPE_CHECKING:
    from trailmark.estimation.maps.map_settings import MapSettings

__all__ = ["read_probability", "settings_of"]


def settings_of(**given: Any) -> MapSettings:
    """Return the settings that the options of ``trailmark map`` give, by their names.

    Raises:
        UsageError: an option that cannot be read.
        EstimationError: a value that is not allowed.
    """
    from trailmark.estimation.filter.motion import PoseIncrement, Unicycle
    from trailmark.estimation.filter.sensors import Cartesian, RangeBearing
    from trailmark.estimation.maps.map_settings import MappingSettings, MapSettings

    s = MapSettings(
        obstacles=given["obstacles"], poses=given["poses"], smooth=given["smooth"], fit_noise=given["fit_noise"]
    )
    slam = replace(s.slam, association=given["association"])
    sizes = _numbers(given["radius"], "--radius", (1, 2), "R or R,SIGMA in metres, R above 0")
    if sizes[0] == 0.0:
        raise UsageError(f"expected R or R,SIGMA in metres, R above 0, got --radius {given['radius']!r}")
    s = replace(s, radius=sizes[0], radius_sigma=sizes[1] if len(sizes) > 1 else 0.0)
    if given["start"] is not None:
        s = replace(s, start=read_configuration(given["start"], "--start"))
    s = replace(s, frame=given["frame"])
    if given["outlier_gate"] != "auto":
        word = given["outlier_gate"]
        gate = None if word == "none" else read_probability(word, "--outlier-gate", " (or none, auto)")
        slam = replace(slam, outlier_gate=gate)
    pair = _pair_of(given)
    if (noise := pair("sensor_noise", positive=True)) is not None:
        a, b = noise
        s = replace(s, range_bearing=RangeBearing(a, b), cartesian=Cartesian(a, b), stated_sensor_noise=False)
    if (noise := pair("odometry_noise")) is not None:
        a, b = noise
        increment = PoseIncrement(1e-3, 1e-3, 1e-3, growth=(a**2, b**2, b**2))
        s = replace(s, velocity=Unicycle(a, b, period=1.0), increment=increment, stated_motion_noise=False)
    if (noise := pair("robot_noise")) is not None:
        s = replace(s, robot_sigma=noise)
    if given["confirm"] is not None:
        count = read_count(given["confirm"], "--confirm", 1, 1_000_000)
        slam, s = replace(slam, confirm=count), replace(s, mapping=replace(s.mapping, confirm=count))
    mapping: MappingSettings = replace(
        s.mapping,
        unknown=given["unknown"],
        shapes=given["shapes"],
        cell=None if given["cell"] is None else read_length(given["cell"], "--cell"),
    )
    if given["pose_memory"] is not None:
        mapping = replace(mapping, pose_memory=read_length(given["pose_memory"], "--pose-memory"))
    if (noise := pair("pose_noise")) is not None:
        mapping = replace(mapping, pose_sigma=noise)
    if (noise := pair("scan_noise", positive=True)) is not None:
        mapping = replace(mapping, scan=replace(mapping.scan, sigma_range=noise[0], sigma_bearing=noise[1]))
    if given["scan_range"] is not None:
        reach = read_length(given["scan_range"], "--scan-range")
        mapping = replace(mapping, scan=replace(mapping.scan, max_range=reach))
    return replace(s, slam=slam, mapping=mapping)


def _pair_of(given: dict[str, Any]) -> Callable[..., tuple[float, float] | None]:
    """Return what reads an option of two numbers by its name."""

    def read(name: str, positive: bool = False) -> tuple[float, float] | None:
        text = given[name]
        if text is None:
            return None
        option = f"--{name.replace('_', '-')}"
        expected = f"A,B, two numbers {'above 0' if positive else 'of 0 or more'}"
        a, b = _numbers(text, option, (2,), expected)
        if positive and not min(a, b) > 0.0:
            raise UsageError(f"expected {expected}, got {option} {text!r}")
        return a, b

    return read


def _numbers(text: str, option: str, counts: tuple[int, ...], expected: str) -> list[float]:
    """Return the finite numbers of 0 or more that an option gives, as many as one of ``counts``."""
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or not all(0.0 <= value < math.inf for value in values):
        raise UsageError(f"expected {expected}, got {option} {text!r}")
    return values


def read_probability(text: str, option: str, more: str = "") -> float:
    """Return the probability, above 0 and below 1, that an option gives; ``more`` follows what is expected.

    Raises:
        UsageError: anything else.
    """
    expected = f"a probability above 0 and below 1{more}"
    return read_number(text, option, expected, above=0.0, high=math.nextafter(1.0, 0.0))
