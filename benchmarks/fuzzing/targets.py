"""What is fuzzed: each reader with files that it takes, real ones and such as the library writes."""

from __future__ import annotations

import gzip
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trailmark.errors import TrailmarkError
from trailmark.world import Robot, World

__all__ = ["TARGETS", "Target", "data_folder"]

ROOT = Path(__file__).resolve().parents[2]

LINES = 300
"""Lines of a real log that are used: readers go line by line."""


class Target(NamedTuple):
    """A reader.

    Attributes:
        make: writes files that are right into a folder.
        entry: name of the file that is handed to the reader; ``.``: the folder.
        read: reads it, and looks at what came out.
    """

    make: Callable[[Path], None]
    entry: str
    read: Callable[[Path], object]


def data_folder() -> Path:
    """Return the folder of real public data, which need not be there."""
    return Path(os.environ.get("TRAILMARK_DATA", ROOT.parent / "shared" / "data"))


def _copy(*names: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        for name in names:
            shutil.copy(data_folder() / name, folder)

    return make


def _head(name: str, lines: int = LINES) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        data = (data_folder() / name).read_bytes()
        if name.endswith(".gz"):
            data = gzip.decompress(data)
        target = folder / Path(name).name.removesuffix(".gz")
        target.write_bytes(b"\n".join(data.split(b"\n")[:lines]) + b"\n")

    return make


def _shipped(name: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        shutil.copy(ROOT / name, folder)

    return make


def _world(path: Path) -> None:
    world = World.load(path)
    # What was read can be written, and read again.
    copy = path.parent / "copy-of.yaml"
    world.save(copy)
    again = World.load(copy)
    if (again.bounds, again.obstacles, again.queries) != (world.bounds, world.obstacles, world.queries):
        raise AssertionError("a world that is saved and loaded is another")


def _checker() -> Any:
    from trailmark.collision import StateChecker

    return StateChecker(World("empty", (0.0, 0.0, 20.0, 12.0)), Robot.disc(0.2))


def _roadmap_files(folder: Path) -> None:
    from trailmark.roadmap import Roadmap

    roadmap = Roadmap(_checker())
    roadmap.add(np.random.default_rng(0).uniform((1.0, 1.0, -3.0), (19.0, 11.0, 3.0), (30, 3)))
    for suffix in (".npz", ".graphml"):
        roadmap.save(folder / f"roadmap{suffix}")


def _roadmap(path: Path) -> None:
    from trailmark.roadmap import load_roadmap

    roadmap = load_roadmap(path, _checker())
    edges = roadmap.edges
    assert edges.size == 0 or (edges.min() >= 0 and edges.max() < len(roadmap))
    assert np.isfinite(roadmap.configurations).all()


def _route(path: Path) -> None:
    from trailmark.roadmap import read_route_graph

    read_route_graph(path)


def _path_files(folder: Path) -> None:
    from trailmark.formats.path_files import write_path

    states = np.array([[1.0, 1.0, 0.0], [2.0, 1.5, 0.3], [3.0, 1.0, -3.0]])
    for suffix in (".json", ".csv", ".txt", ".yaml", ".nav2.json", ".geojson"):
        write_path(folder / f"path{suffix}", states)


def _maze(folder: Path) -> None:
    lines = ("m 1,2 3,0 0,4 -3,0 z", "M 8 2 h 3.5 v 2 l -1,1e0 z")
    paths = "".join(f'<path id="p{i}" d="{line}" />' for i, line in enumerate(lines))
    (folder / "maze.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg"><g>{paths}</g></svg>')


def _public(name: str, robot: Robot | None) -> Callable[[Path], None]:
    """Return a reader of a public suite's file."""

    def read(path: Path) -> None:
        from trailmark.benchmark.public import PUBLIC

        world = PUBLIC[name].world(path.parent, path, [0], robot)
        assert len(world.queries) == 1

    return read


def _robots(folder: Path) -> None:
    """Write a robot as world files have it, and as nav2's parameters have it."""
    (folder / "robot.yaml").write_text("robot: {shape: rectangle, length: 0.6, width: 0.4, turning_radius: 1.0}\n")
    costmap = 'ros__parameters: {footprint: "[[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2]]", robot_radius: 0.3}\n'
    lines = [f"{name}:\n  {name}:\n    {costmap}" for name in ("local_costmap", "global_costmap")]
    (folder / "nav2_params.yaml").write_text("".join(lines))


def _robot(path: Path) -> None:
    assert Robot.load(path).circumradius > 0.0


def _image(path: Path) -> None:
    assert World.from_image(path, 0.05, (1.0, 2.0, 0.3)).boundary is not None


def _messages(folder: Path) -> None:
    """Write a nav_msgs/Path as JSON, and twice as YAML, as it is printed."""
    poses = [
        {"pose": {"position": {"x": x, "y": 1.0, "z": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.5, "w": 0.8}}}
        for x in (1.0, 2.0, 3.5)
    ]
    (folder / "message.json").write_text(json.dumps({"header": {"frame_id": "map"}, "poses": poses}))
    lines = ["header:", "  frame_id: map", "poses:"]
    for entry in poses:
        lines += ["- pose:", *(f"    {key}: {json.dumps(value)}" for key, value in entry["pose"].items())]
    (folder / "message.yaml").write_text("\n".join([*lines, "---", *lines, "---", ""]))


def _any_path(path: Path) -> None:
    from trailmark.formats.any_path import read_any_path

    found = read_any_path(path)
    assert np.isfinite(found.states).all()
    assert np.isfinite(found.headings)


def _log(path: Path) -> None:
    from trailmark.estimation.readers import load_log

    for skip in (False, True):
        try:
            log = load_log(path, skip_bad=skip)
        except TrailmarkError:
            if skip:
                raise
            continue
        assert log.records


def _jsonl(folder: Path) -> None:
    from trailmark.estimation import Detector, RangeBearing, Scanner, Unicycle, save_log, simulate
    from trailmark.shapes import Disc

    world = World("yard", (0.0, 0.0, 12.0, 8.0), (Disc((5.0, 4.0), 0.3), Disc((8.0, 6.0), 0.3)))
    log = simulate(
        world,
        [[1.0, 1.0], [8.0, 2.6]],
        Unicycle(0.01, 0.002, period=1.0),
        detector=Detector(RangeBearing(0.03, 0.01), 7.0),
        scanner=Scanner(beams=21, max_range=9.0, period=2.0),
        random_state=3,
    ).log
    save_log(log, folder / "log.jsonl")


def _mrclam(folder: Path) -> None:
    for name in ("Robot1_Odometry.dat", "Robot1_Measurement.dat", "Barcodes.dat", "Landmark_Groundtruth.dat"):
        data = (data_folder() / "mrclam6" / name).read_bytes()
        (folder / name).write_bytes(b"\n".join(data.split(b"\n")[:LINES]) + b"\n")


def _bag(kind: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_typestore

        old = kind == "ros1"
        store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_HUMBLE)

        def make_message(name: str, **fields: Any) -> Any:
            return store.types[name](**fields)

        def header(t: int) -> Any:
            stamp = make_message("builtin_interfaces/msg/Time", sec=t, nanosec=0)
            return make_message("std_msgs/msg/Header", stamp=stamp, frame_id="base", **({"seq": 0} if old else {}))

        zero = make_message("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        turn = make_message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        twist = make_message("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        rows = []
        for t in range(10, 16):
            at = make_message("geometry_msgs/msg/Point", x=0.5 * t, y=2.0, z=0.0)
            pose = make_message("geometry_msgs/msg/Pose", position=at, orientation=turn)
            odometry = make_message(
                "nav_msgs/msg/Odometry",
                header=header(t),
                child_frame_id="base",
                pose=make_message("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
                twist=make_message("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
            )
            scan = make_message(
                "sensor_msgs/msg/LaserScan",
                header=header(t),
                angle_min=-1.0,
                angle_max=1.0,
                angle_increment=0.5,
                time_increment=0.0,
                scan_time=0.1,
                range_min=0.1,
                range_max=10.0,
                ranges=np.array([1.0, 2.0, 3.0, 4.0, 5.0], dtype=np.float32),
                intensities=np.zeros(0, dtype=np.float32),
            )
            rows += [(t, "/odom", "nav_msgs/msg/Odometry", odometry), (t, "/scan", "sensor_msgs/msg/LaserScan", scan)]
        writer: Any
        if old:
            writer = Writer1(folder / "drive.bag")
        else:
            plugin = StoragePlugin.SQLITE3 if kind == "sqlite3" else StoragePlugin.MCAP
            writer = Writer2(folder / "drive", version=8, storage_plugin=plugin)
        serialize = store.serialize_ros1 if old else store.serialize_cdr
        with writer:
            topics: dict[str, Any] = {}
            for t, topic, name, message in rows:
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, name, typestore=store)
                writer.write(topics[topic], t * 10**9, serialize(message, name))

    return make


def _suite(path: Path) -> None:
    from trailmark.benchmark.suites import read_suite

    read_suite(path)


def _database(folder: Path) -> None:
    from trailmark.benchmark.record import RunRecord
    from trailmark.benchmark.store import Store

    run = {
        "status": 6,
        "solved": True,
        "correct_solution": True,
        "time": 1.0,
        "time_to_first_solution": 0.25,
        "solution_length": 9.0,
        "first_solution_length": 12.0,
        "curve": [(0.25, 12.0), (0.75, 9.0)],
        "path": [[1.0, 1.0, 0.0], [9.0, 1.0, 0.0]],
    }
    with Store(folder / "results.db") as store:
        facts = {"text": "trailmark: 1"}
        experiment = store.experiment({"problem": "a"}, {}, facts, name="room", timelimit=1.0, runcount=2, seed=0)
        planner = store.planner("landmark", "{}")
        for seed in (0, 1):
            store.add(experiment, planner, RunRecord.from_json({**run, "seed": seed}))


def _results(path: Path) -> None:
    from trailmark.benchmark.results import load_results

    load_results(path)


def _store(path: Path) -> None:
    from trailmark.benchmark.store import Store

    with Store(path) as store:
        store.finished(1)


TARGETS: dict[str, Target] = {
    "world": Target(_shipped("worlds/office.yaml"), "office.yaml", _world),
    "world of polygons": Target(_shipped("worlds/environment1.yaml"), "environment1.yaml", _world),
    "world of a car": Target(_shipped("worlds/parking.yaml"), "parking.yaml", _world),
    "nav2 map": Target(_copy("nav2/tb3_sandbox.yaml", "nav2/tb3_sandbox.pgm"), "tb3_sandbox.yaml", _world),
    "Explore-Bench map": Target(
        _copy("explore/explorebench_room.yaml", "explore/explorebench_room.pgm"), "explorebench_room.yaml", _world
    ),
    "ARiADNE map": Target(_copy("explore/ariadne_easy_img_1.png"), "ariadne_easy_img_1.png", _world),
    "MovingAI": Target(
        _copy("movingai/Berlin_0_256.map", "movingai/Berlin_0_256.map.scen"), "Berlin_0_256.map", _world
    ),
    "OMPL.app": Target(
        _copy("omplapp/Maze_planar.cfg", "omplapp/Maze_planar_env.dae", "omplapp/car2_planar_robot.dae"),
        "Maze_planar.cfg",
        _world,
    ),
    "roadmap npz": Target(_roadmap_files, "roadmap.npz", _roadmap),
    "roadmap graphml": Target(_roadmap_files, "roadmap.graphml", _roadmap),
    "route graph": Target(_copy("nav2/depot_graph.geojson"), "depot_graph.geojson", _route),
    **{
        f"path {suffix}": Target(_path_files, f"path.{suffix}", _any_path)
        for suffix in ("json", "csv", "txt", "yaml", "nav2.json", "geojson")
    },
    "path message json": Target(_messages, "message.json", _any_path),
    "path message yaml": Target(_messages, "message.yaml", _any_path),
    "robot": Target(_robots, "robot.yaml", _robot),
    "robot of nav2": Target(_robots, "nav2_params.yaml", _robot),
    "image": Target(_copy("nav2/tb3_sandbox.pgm"), "tb3_sandbox.pgm", _image),
    "log jsonl": Target(_jsonl, "log.jsonl", _log),
    "log CARMEN": Target(_head("carmen/intel-corrected.log.gz", 60), "intel-corrected.log", _log),
    "log Victoria": Target(_head("victoria/victoria_park.txt"), "victoria_park.txt", _log),
    "log MRCLAM": Target(_mrclam, ".", _log),
    "bag of ROS 1": Target(_bag("ros1"), "drive.bag", _log),
    "bag of ROS 2": Target(_bag("sqlite3"), "drive", _log),
    "bag as MCAP": Target(_bag("mcap"), "drive", _log),
    "Gazebo world": Target(_copy("barn/world_0.world"), "world_0.world", _public("barn", None)),
    "SVG maze": Target(_maze, "maze.svg", _public("bench-mr", Robot.disc(0.2))),
    "nav2 map with pairs": Target(
        _copy("nav2/tb3_sandbox.yaml", "nav2/tb3_sandbox.pgm"), "tb3_sandbox.yaml", _public("nav2", Robot.disc(0.1))
    ),
    "suite": Target(_shipped("benchmarks/suites/quick.yaml"), "quick.yaml", _suite),
    "results": Target(_database, "results.db", _results),
    "store": Target(_database, "results.db", _store),
}
"""Name: the reader."""
