"""Wrong arguments to the public names of trailmark.estimation are told in one line of trailmark's own."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.helpers.worlds import grown_world
from tests.helpers.wrong import WRONG

from trailmark import Disc, Robot, TrailmarkError, World
from trailmark import estimation as e
from trailmark.world import ObstacleEstimate

WORLD = World("room", (0.0, 0.0, 6.0, 4.0), (Disc((3.0, 2.0), 0.5),), Robot.disc(0.2))
ESTIMATE = ObstacleEstimate(Disc((3.0, 2.0), 0.5), 0.01 * np.eye(2))
GROWN = grown_world([ESTIMATE], WORLD.bounds, 0.9, robot=WORLD.robot)
MOTION, SENSOR = e.Unicycle(0.01, 0.01), e.RangeBearing(0.05, 0.02)
SCANS = tuple(e.Scan(float(t), np.full(31, 2.0), -1.0, 2.0 / 30.0, 5.0) for t in range(3))
LOG = e.Log("room", (e.Pose(0.0, 1.0, 1.0, 0.0), *SCANS, e.Odometry(3.0, 1.0, 0.0)), np.empty((0, 3)))
PATH = [[1.0, 1.0, 0.0], [5.0, 1.0, 0.0]]
READ = {"format": None, "skip_bad": False, "robot": None, "corrected": None, "scan_topic": None, "odometry_topic": None}
DRIVE = {"detector": None, "scanner": None, "speed": 1.0, "turn_rate": 1.0, "period": 0.5, "name": None}
SENSE = {"points_per_obstacle": 4, "readings_per_point": 2, "max_range": 9.0, "random_state": 0}


READING = {"z": (2.0, 0.5), "sensor": SENSOR, "R": None}
METHODS: dict[str, dict[str, Any]] = {
    "predict": {"motion": MOTION, "u": (1.0, 0.1, 0.1), "Q": np.eye(2)},
    "set_pose": {"pose": PATH[0], "P": np.eye(3)},
    "predict_readings": {"sensor": SENSOR},
    "innovation": READING | {"feature_id": 0},
    "update": READING | {"feature_id": 0},
    "update_batch": READING | {"z": [(2.0, 0.5)], "ids": [0]},
    "add_feature": READING,
    "add_known_feature": {"feature": (2.0, 0.5), "P": np.eye(2)},
    **{name: {"feature_id": 0} for name in ("remove_feature", "feature", "feature_covariance")},
}


def filled() -> e.SlamFilter:
    ekf = e.SlamFilter()
    for z in ((2.0, 0.5), (3.0, -0.5)):
        ekf.add_feature(z, SENSOR)
    return ekf


def called(method: str, **given: Any) -> object:
    return getattr(filled(), method)(**given)


def entries(file: Path) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Return the public ways in, each with arguments that are right."""
    file.write_text('{"trailmark_log": 1}\n{"type": "odometry", "t": 0.0, "v": 1.0, "omega": 0.0}\n')
    methods = {name: (partial(called, name), right) for name, right in METHODS.items()}
    return methods | {
        "load_log": (e.load_log, {"path": file} | READ),
        "save_log": (e.save_log, {"log": LOG, "path": file.with_name("new.jsonl")}),
        "map_log": (e.map_log, {"log": LOG, "settings": None, "robot": None, "confidence": None, "on_progress": None}),
        "map_scans": (
            e.map_scans,
            {"log": SCANS, "poses": "auto", "settings": None, "robot": None, "confidence": None, "on_progress": None},
        ),
        "simulate": (e.simulate, {"world": WORLD, "states": PATH, "motion": MOTION, **DRIVE, "random_state": 0}),
        "sense_obstacles": (e.sense_obstacles, {"world": WORLD, "poses": 4, "sensor": SENSOR, **SENSE}),
        "refine_points": (e.refine_points, {"readings": [[[2.0, 0.5]]], "poses": PATH[0], "sensor": SENSOR}),
        "disc_estimates": (
            e.disc_estimates,
            {"points": [[1.0, 1.0]], "covariances": [np.eye(2)], "radius": 1.0, "radius_sigma": 0.1},
        ),
        "wall_estimate": (
            e.wall_estimate,
            {
                "line": (1.0, 0.0),
                "covariance": np.eye(2),
                "span": (0.0, 1.0),
                "thickness": 0.1,
                "along_sigma": 0.1,
                "end_sigma": 0.1,
            },
        ),
        "grow": (e.grow, {"estimate": ESTIMATE, "confidence": 0.9, "pose_covariance": None, "reach": 0.0, "sides": 16}),
        "regrow": (e.regrow, {"world": GROWN, "confidence": 0.9, "weights": None, "pose_covariance": None}),
        "refined": (e.refined, {"world": GROWN, "estimates": {0: ESTIMATE}}),
        "path_risk": (e.path_risk, {"world": GROWN, "states": PATH, "draws": 10, "seed": 0, "margin": 0.0}),
        "SlamFilter": (e.SlamFilter, {"pose": PATH[0], "P": np.eye(3), "curvature": 1.0}),
        "EkfSlam": (
            e.EkfSlam,
            {"sensor": SENSOR, "velocity": MOTION, "settings": None, "start": PATH[0], "P": None, "mode": "slam"},
        ),
        "add_landmark": (
            lambda **given: slam().add_landmark(**given),
            {"feature": (1.0, 1.0), "P": None, "identity": 3},
        ),
        "run": (lambda **given: slam().run(**given), {"records": LOG.records}),
        "process": (lambda **given: slam().process(**given), {"record": LOG.records[-1]}),
        "Odometry": (lambda **given: slam().run([e.Odometry(**given)] * 2), {"t": 0.0, "v": 1.0, "omega": 0.1}),
        "Increment": (
            lambda **given: slam().run([e.Increment(**given)]),
            {"t": 0.0, "dx": 1.0, "dy": 0.1, "dtheta": 0.1, "covariance": None},
        ),
        "Detection": (
            lambda **given: slam().run([e.Detection(**given)]),
            {"t": 0.0, "z": (1.0, 1.0), "kind": "range-bearing", "identity": 3, "covariance": None},
        ),
        "SlamSettings": (e.SlamSettings, {"association": "known", "confirm": 2}),
        "ScanSettings": (e.ScanSettings, {"sigma_range": 0.1, "max_range": 9.0}),
        "MappingSettings": (e.MappingSettings, {"pose_sigma": (0.1, 0.1), "cell": 0.1}),
        "MapSettings": (e.MapSettings, {"slam": e.SlamSettings(), "radius": 1.0, "start": None, "stated_noise": True}),
        "Unicycle": (e.Unicycle, {"sigma_v": 0.1, "sigma_omega": 0.1, "alpha": (0.0, 0.0, 0.0, 0.0), "period": None}),
        "PoseIncrement": (e.PoseIncrement, {"sigma_x": 0.1, "sigma_y": 0.1, "sigma_theta": 0.1, "growth": (0, 0, 0)}),
        "RangeBearing": (e.RangeBearing, {"sigma_range": 0.1, "sigma_bearing": 0.1, "growth": 0.1}),
        "Detector": (e.Detector, {"model": SENSOR, "max_range": 1.0, "identities": True, "detection_rate": 0.5}),
        "Scanner": (e.Scanner, {"beams": 3, "field_of_view": 1.0, "mount": (0, 0, 0), "bounds": True, "drop_out": 0.1}),
    }


def slam() -> e.EkfSlam:
    return e.EkfSlam(SENSOR, velocity=MOTION, increment=e.PoseIncrement(0.1, 0.1, 0.1))


NAMES = list(entries(Path(os.devnull)))


@pytest.mark.parametrize("name", NAMES)
def test_nothing_raw_comes_out(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # some of the wrong arguments are paths that can be written
    call, right = entries(tmp_path / "log.jsonl")[name]
    call(**right)
    messages: list[str] = []
    for argument in right:
        for wrong in WRONG:
            try:
                call(**(right | {argument: wrong}))
            except TrailmarkError as error:
                messages.append(str(error))
            except Exception as error:
                raise AssertionError(f"{name}({argument}={wrong!r})") from error
    assert len(messages) > 5 * len(right)
    assert [line for line in messages if "\n" in line or len(line) > 500] == []


def test_all_public_callables_are_tried() -> None:
    values = {
        "EstimationError",
        "NotCertifiedError",
        "RecordError",
        "Innovation",
        "Prediction",
        "MapFeature",
        "MappedLog",
        "ScanMap",
    }
    values |= {"MotionModel", "Pose", "Scan", "Log", "Simulation", "SlamResult"}
    assert set(e.__all__) - set(NAMES) == values - {"MapFeature"}
