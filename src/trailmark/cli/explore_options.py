"""What the options of ``trailmark explore`` mean: with what an exploration is begun, and where it ends."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from trailmark.cli.map_settings import read_probability
from trailmark.cli.options import (
    Configuration,
    UsageError,
    read_configuration,
    read_count,
    read_length,
    read_number,
    read_robot,
    robot_file,
    robot_of,
)
from trailmark.errors import expected_name

if TYPE_CHECKING:
    from trailmark.exploration.exploration_folder import SavedExploration
    from trailmark.exploration.explorer import Explorer
    from trailmark.robot import Robot
    from trailmark.world import World

__all__ = ["Beginning", "Limits"]

SENSORS = ("laser", "detections")
STRATEGIES = ("tour", "gain-per-cost", "nearest-frontier")  # those of trailmark.exploration, which is heavy to import

RANGE = 0.2
"""Of the sensor by default, as a share of the world's longer side: so that a map takes some landmarks."""


class Limits(NamedTuple):
    """Where an exploration ends, whatever is left to be seen."""

    time: float
    """Seconds of the robot's clock."""
    distance: float
    """Metres driven."""
    return_home: bool
    """Whether it drives back to its start then."""


class Beginning(NamedTuple):
    """With what an exploration is begun."""

    words: dict[str, str]
    """The options that were given, by their names without dashes, and the world."""
    world: str
    robot: Robot | None
    start: Configuration | None
    sensor: str
    sensor_range: float | None
    strategy: str
    confidence: float | None
    noise: float
    seed: int

    @classmethod
    def read(cls, given: Mapping[str, object]) -> Beginning:
        """Return what options say that are looked at before the world is read.

        Raises:
            TrailmarkError: one of them cannot be read, or there is no world.
        """
        words = {name: str(text) for name, text in given.items()}
        if "world" not in words:
            raise UsageError("WORLD is missing; expected a file, a shipped world's name, or --resume DIR")
        start, reach, probability = (words.get(name) for name in ("start", "sensor-range", "confidence"))
        return cls(
            words,
            words["world"],
            read_robot(words.get("robot")),
            None if start is None else read_configuration(start, "--start"),
            _name(words.get("sensor", SENSORS[0]), "--sensor", SENSORS),
            None if reach is None else read_length(reach, "--sensor-range"),
            _name(words.get("strategy", STRATEGIES[0]), "--strategy", STRATEGIES),
            None if probability is None else read_probability(probability, "--confidence"),
            read_number(words.get("noise", "1"), "--noise", "a finite number of 0 or more", low=0.0),
            read_count(words.get("seed", "0"), "--seed", 0),
        )

    @property
    def robot_file(self) -> tuple[Path, ...]:
        """The file that the robot was read from, if it was."""
        return robot_file(self.words.get("robot"))

    def kept(self) -> dict[str, str]:
        """Return the words by which the same exploration goes on, from whatever folder."""
        names = ("world", "robot") if self.robot_file else ("world",)
        files = {name: Path(self.words[name]) for name in names}
        return self.words | {name: str(file.absolute()) for name, file in files.items() if file.exists()}

    def explorer(self, world: World, limits: Limits, saved: SavedExploration | None) -> Explorer:
        """Return what explores the world.

        Raises:
            TrailmarkError: the world does not go with the options, or with what was saved.
        """
        from trailmark.exploration.exploration_settings import ExplorationSettings
        from trailmark.exploration.explorer import Explorer
        from trailmark.exploration.simulated_robot import disc_detector, laser_scanner

        body = robot_of(world, self.robot)
        if self.start is None and not world.queries:
            raise UsageError(f"world {world.name!r} holds no query to start from; expected --start X,Y,T")
        settings = ExplorationSettings(
            confidence=self.confidence,
            time_limit=limits.time,
            distance_limit=limits.distance,
            return_home=limits.return_home,
        )
        xmin, ymin, xmax, ymax = world.bounds
        reach = RANGE * max(xmax - xmin, ymax - ymin) if self.sensor_range is None else self.sensor_range
        laser = self.sensor == "laser"
        sensor = laser_scanner(reach, settings.cell_side(body, world.bounds)) if laser else disc_detector(reach)
        return Explorer(
            world,
            body,
            sensor,
            strategy=self.strategy,
            start=self.start or world.query().start,
            settings=settings,
            seed=self.seed,
            noise=self.noise,
            resumed=saved,
        )


def _name(text: str, option: str, known: tuple[str, ...]) -> str:
    if text not in known:
        raise UsageError(f"{option}: {expected_name(text, known)}")
    return text
