"""A ROS 2 node that plans, without nav2
=====================================

In one command: the map of a warehouse as a latched topic, ``trailmark ros`` in a process of its own, and a client that
sends goals as RViz does and drops pallets in the robot's way. The picture is drawn from the messages that come back.
On a machine's first use run ``trailmark warmup`` before.

``python examples/ros2_planner.py [PICTURE.png]``, with your ROS 2 sourced or ``pip install 'trailmark[ros2]'``.
"""

import atexit
import math
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.collections import LineCollection, PolyCollection

from trailmark import Rectangle, World

# sphinx_gallery_thumbnail_path = "pictures/ros2.png"
try:
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import Point, Pose, PoseStamped, PoseWithCovarianceStamped, Quaternion
    from nav_msgs.msg import OccupancyGrid, Path
    from nav_msgs.srv import GetPlan
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from visualization_msgs.msg import Marker, MarkerArray
except ImportError as error:
    sys.exit(f"this example needs ROS 2 ({error}): source yours, or pip install 'trailmark[ros2]'")

# %%
# The node. In a namespace of its own it sends nothing to a robot that is near. The footprint is a text, as in nav2.
SPACE, CELL = "warehouse_example", 0.1
world = World.load("warehouse")
assert world.robot is not None
outline = world.robot.footprint.polygon().vertices.tolist()
words = ["-r", f"__ns:=/{SPACE}", "-p", f"footprint:='{outline}'", "-p", "motion_model:=differential"]
server = subprocess.Popen([sys.executable, "-m", "trailmark", "ros", "--ros-args", *words])
atexit.register(server.wait)
atexit.register(server.terminate)

# %%
# The map. A cell is occupied if an obstacle reaches into it.
x0, y0, x1, y1 = world.bounds
x, y = np.meshgrid(np.arange(x0, x1 - 1e-9, CELL), np.arange(y0, y1 - 1e-9, CELL))
cells = shapely.box(x + 1e-9, y + 1e-9, x + CELL - 1e-9, y + CELL - 1e-9)
shapes = [shape.polygon(1e-3) for shape in world.obstacles]
bodies = [shapely.Polygon(shape.vertices, shape.holes) for shape in shapes]
occupied = np.zeros(cells.shape, np.int8)
occupied.flat[shapely.STRtree(cells.ravel()).query(bodies, "intersects")[1]] = 100
grid = OccupancyGrid(data=occupied.ravel())
grid.header.frame_id, grid.info.resolution = "map", CELL
grid.info.height, grid.info.width = cells.shape
grid.info.origin.position.x, grid.info.origin.position.y = x0, y0

# %%
# The client: what it publishes, and the newest message of each topic that it listens to.
rclpy.init()
node = rclpy.create_node("client", namespace=SPACE)
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
maps = node.create_publisher(OccupancyGrid, "map", latched)
poses = node.create_publisher(PoseWithCovarianceStamped, "initialpose", 1)
goals = node.create_publisher(PoseStamped, "goal_pose", 1)
obstacles = node.create_publisher(MarkerArray, "obstacles", 1)
plans = node.create_client(GetPlan, "get_plan")
heard: dict[str, Any] = {}
markers = dict.fromkeys(("swept_footprint", "roadmap", "landmarks"), MarkerArray)
for name, kind in {"plan": Path, **markers}.items():
    node.create_subscription(kind, name, partial(heard.__setitem__, name), latched)
node.create_subscription(DiagnosticArray, "/diagnostics", partial(heard.__setitem__, "diagnostics"), 10)


def pose(x: float, y: float, theta: float) -> PoseStamped:
    """Return a configuration as a message."""
    turned = Quaternion(z=math.sin(0.5 * theta), w=math.cos(0.5 * theta))
    return PoseStamped(header=grid.header, pose=Pose(position=Point(x=x, y=y), orientation=turned))


def wait(condition: Callable[[], Any], seconds: float = 60.0) -> None:
    """Take messages until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        rclpy.spin_once(node, timeout_sec=0.05)
        assert time.monotonic() < end, "no answer"
        assert server.poll() is None, "the node has ended"


def sent(publisher: Any, message: Any, what: str) -> list[tuple[float, float]]:
    """Publish a message, print what comes of it, and return the positions of the plan."""
    heard.clear()
    begin = time.perf_counter()
    publisher.publish(message)
    wait(lambda: "plan" in heard)
    milliseconds = 1e3 * (time.perf_counter() - begin)
    wait(lambda: all(name in heard for name in ("diagnostics", *markers)))
    status = heard["diagnostics"].status[0]
    facts = {pair.key: pair.value for pair in status.values}
    print(f"{what}: {status.message}, cost {facts['cost']} m, at least {facts['lower bound']} m", end=", ")
    print(f"{milliseconds:.0f} ms from message to path, {1e3 * float(facts['seconds']):.0f} ms of them planning")
    return [(stamped.pose.position.x, stamped.pose.position.y) for stamped in heard["plan"].poses]


def planned(start: PoseStamped, goal: PoseStamped) -> Path:
    """Call the service until it has a plan, for which it needs the map and, without a start, the robot's pose."""
    answer = GetPlan.Response()
    while not answer.plan.poses:
        future = plans.call_async(GetPlan.Request(start=start, goal=goal))
        wait(future.done, 600.0)
        answer = future.result()
    return answer.plan


# %%
# A service that other programs call, with a start of their own. At a machine's first use the node compiles before.
query, other = world.query("dock"), world.query("pick")
maps.publish(grid)
wait(plans.service_is_ready)
print(f"get_plan: {len(planned(pose(*other.start), pose(*other.pose())).poses)} poses")

# %%
# RViz's tools: "2D Pose Estimate" says where the robot is, "2D Goal Pose" where it is to go.
wait(lambda: all(topic.get_subscription_count() for topic in (poses, goals, obstacles)))
start = PoseWithCovarianceStamped(header=grid.header)
start.pose.pose = pose(*query.start).pose
poses.publish(start)
planned(PoseStamped(), pose(*query.pose()))
positions = first = sent(goals, pose(*query.pose()), "goal")

# %%
# Pallets in the way. The plan is led around each of them without being asked for again.
pallets: list[np.ndarray] = []
for i in range(3):
    x, y = positions[(i + 1) * len(positions) // 4]
    pallets.append(Rectangle((x, y), 1.2, 0.8, 0.3 * i).polygon().vertices)
    marker = Marker(header=grid.header, ns="pallets", id=i, type=Marker.LINE_STRIP)
    marker.points = [Point(x=x, y=y) for x, y in pallets[-1].tolist()]
    positions = sent(obstacles, MarkerArray(markers=[marker]), f"pallet {i}")
rclpy.shutdown()

# %%
# The picture, as RViz shows it.
figure, axes = plt.subplots(figsize=(9, 6.2), layout="constrained", subplot_kw={"xlabel": "x [m]", "ylabel": "y [m]"})
axes.imshow(100 - occupied, cmap="gray", vmin=-15, vmax=112, extent=(x0, x1, y0, y1), origin="lower")


def lines(name: str, corners: int, every: int = 1, **style: Any) -> None:
    """Draw a marker's lines of so many ends each."""
    ends = [(point.x, point.y) for point in heard[name].markers[0].points]
    axes.add_collection(LineCollection([*np.reshape(ends, (-1, corners, 2))[::every]], **style))


lines("roadmap", 2, label="roadmap", colors="#dca6c5", linewidths=0.6)
lines("swept_footprint", 8, 5, label="swept footprint", colors="#56b4e9", linewidths=0.5)
points = [(point.x, point.y) for point in heard["landmarks"].markers[0].points]
axes.plot(*np.transpose(points), ".", ms=4, color="#9c4a79", label="landmarks")
axes.plot(*np.transpose(first), "--", lw=1.2, color="#55585f", label="plan before the pallets")
axes.plot(*np.transpose(positions), lw=1.8, color="#0072b2", label="plan")
axes.add_collection(PolyCollection(pallets, color="#e69f00", label="obstacles"))
for at, mark, colour, label in ((0, "o", "#009e73", "start"), (-1, "s", "#d55e00", "goal")):
    axes.plot(*positions[at], mark, ms=7, mec="white", color=colour, ls="none", label=label)
figure.legend(loc="outside upper center", ncols=4, frameon=False)
if len(sys.argv) > 1:
    figure.savefig(sys.argv[1], dpi=100)
plt.show()
