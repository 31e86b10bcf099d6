"""PlannerServer: the lifecycle node, with nav2's actions and services and what RViz shows."""

from __future__ import annotations

import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from functools import partial
from importlib import import_module
from typing import Any
from uuid import uuid4

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, Pose, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from nav_msgs.srv import GetPlan
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from trailmark import se2
from trailmark.errors import ConfigurationError, TrailmarkError
from trailmark.ros import messages
from trailmark.ros.planning import Answer, PlanningSite, warm_up
from trailmark.ros.planning import Pose as Configuration
from trailmark.ros.settings import Settings
from trailmark.shapes import Shape

try:
    from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
except ImportError:  # Humble
    from rclpy.qos_event import PublisherEventCallbacks, SubscriptionEventCallbacks

__all__ = ["PlannerServer", "run"]

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
"""Of maps and plans: who comes late gets the newest."""

THREADS = 7
"""Of the executor: a goal pose, following, a map and its change, a pose, a service, a parameter. As many plan goals."""

NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
"""No callbacks for events of topics (such as QoS that do not match): the executor would wait for each of them, which
took half of its time."""

SIGNAL_PERIOD = 0.2
"""Seconds at most between two looks whether a signal came that ends the node."""

HEARTBEAT = 0.1
"""Seconds between heartbeats of the bond by which nav2's lifecycle manager watches its nodes."""


ENDED = Answer("UNKNOWN", "ended: a newer goal came, or it was cancelled, or the node deactivated")


class _FrameError(TrailmarkError):
    """A pose that cannot be told in the map's frame."""


class PlannerServer(LifecycleNode):  # type: ignore[misc]  # rclpy ships no types
    """A lifecycle node ``planner_server`` that plans certified paths for a footprint.

    Configured it listens to maps, poses and obstacles; active it plans. A map that changes is looked at where it
    changed, and the plan that is followed is kept, led around or made anew.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("planner_server", **options)
        for setting in fields(Settings):
            about = ParameterDescriptor(description=setting.metadata["about"], dynamic_typing=True)
            self.declare_parameter(setting.name, setting.default, about)
        self.site: PlanningSite | None = None  # from configure to cleanup
        self._active = False
        self._bond: _Bond | None = None
        self._pool = ThreadPoolExecutor(THREADS, "goal")
        self._goal_lock, self._stop = threading.Lock(), threading.Event()  # set to end the newest goal
        self._goal = self._stop  # of the goal whose plan is followed
        self._cells_lock, self._map_lock = (
            threading.Lock(),
            threading.Lock(),
        )  # while cells are written, and while the planner changes its map
        self._map: OccupancyGrid | None = None
        self._obstacles: dict[tuple[str, int], list[Shape]] = {}
        self._pose: Configuration | None = None
        self._odom: Configuration | None = None
        self._odom_at_pose: Configuration | None = None  # when the pose was received
        self._create_interfaces()
        self.add_on_set_parameters_callback(self._on_parameters)

    # Lifecycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters, load the kernels, and take up the map that is known."""
        try:
            settings = self.read_settings()
            self.get_logger().info("loading (the first use on a machine compiles, for a minute or more)")
            warm_up(settings)
        except TrailmarkError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self.site = PlanningSite(settings)
        self._logging_errors("map", self._change_map)()
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Plan from now on."""
        self._goal = self._begin()
        self._active = True
        if (kind := _interface("bond.msg", "Status")) is not None:
            self._bond = _Bond(self, kind)
        self._follow.trigger()
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Plan no more; maps, obstacles and poses are still taken."""
        self.end_goal()
        if self._bond is not None:
            self._bond.end()
            self._bond = None
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the planner and what it planned."""
        self.on_deactivate(state)
        self.site = None
        return TransitionCallbackReturn.SUCCESS

    on_shutdown = on_error = on_cleanup

    def _create_interfaces(self) -> None:
        """Create publishers, subscriptions, services and actions, which do nothing until the node is active."""
        planning, (maps, change, follow, poses, service, accepting) = (
            ReentrantCallbackGroup(),
            (MutuallyExclusiveCallbackGroup() for _ in "123456"),
        )

        def subscribe(kind: Any, name: str, call: Callable[[Any], None], group: Any, qos: Any = 10) -> None:
            called = self._logging_errors(name, call)
            self.create_subscription(
                kind, name, called, qos, callback_group=group, event_callbacks=NO_SUBSCRIPTION_EVENTS
            )

        self._plan = self.create_publisher(Path, "plan", LATCHED, event_callbacks=NO_PUBLISHER_EVENTS)
        self._roadmap = self.create_publisher(MarkerArray, "roadmap", LATCHED, event_callbacks=NO_PUBLISHER_EVENTS)
        self._landmarks = self.create_publisher(MarkerArray, "landmarks", LATCHED, event_callbacks=NO_PUBLISHER_EVENTS)
        self._swept = self.create_publisher(
            MarkerArray, "swept_footprint", LATCHED, event_callbacks=NO_PUBLISHER_EVENTS
        )
        self._diagnostics = self.create_publisher(
            DiagnosticArray, "/diagnostics", 10, event_callbacks=NO_PUBLISHER_EVENTS
        )
        self._map_changed = self.create_guard_condition(
            self._logging_errors("map", self._change_map), callback_group=change
        )
        self._follow = self.create_guard_condition(
            self._logging_errors("map", self._follow_plan), callback_group=follow
        )
        self._tf = _tf_buffer(self)
        subscribe(OccupancyGrid, "map", self._on_map, maps, LATCHED)
        if (updates := _interface("map_msgs.msg", "OccupancyGridUpdate")) is not None:
            # Costmaps publish what changed beside themselves, in order and without loss.
            subscribe(updates, self.resolve_topic_name("map") + "_updates", self._on_map_update, maps, 50)
        subscribe(MarkerArray, "obstacles", self._on_obstacles, maps)
        subscribe(PoseStamped, "goal_pose", self._on_goal_pose, planning)
        subscribe(PoseWithCovarianceStamped, "initialpose", self._on_pose, poses)
        subscribe(PoseWithCovarianceStamped, "amcl_pose", self._on_pose, poses)
        subscribe(Odometry, "odom", self._on_odom, poses)
        self.create_service(
            GetPlan, "get_plan", self._logging_errors("get_plan", self._get_plan), callback_group=service
        )
        if (valid := _interface("nav2_msgs.srv", "IsPathValid")) is None:
            self.get_logger().warning("nav2_msgs is not there: no actions are offered, only get_plan and goal_pose")
            return
        name, call = "is_path_valid", self._is_path_valid
        self.create_service(valid, name, self._logging_errors(name, call), callback_group=service)
        for name, action in (("to_pose", "ToPose"), ("through_poses", "ThroughPoses")):
            kind = _interface("nav2_msgs.action", f"ComputePath{action}")
            ActionServer(
                self,
                kind,
                f"compute_path_{name}",
                lambda handle: None,  # goals bring theirs
                callback_group=accepting,
                goal_callback=lambda _: GoalResponse.ACCEPT if self._active else GoalResponse.REJECT,
                handle_accepted_callback=partial(self._on_accepted, kind),
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )

    def _logging_errors(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that logs its errors: in rclpy they would end the node."""

        def called(*given: Any) -> Any:
            try:
                return call(*given)
            except TrailmarkError as error:
                self.get_logger().warning(f"{name} ignored: {error}")
            except Exception:
                if rclpy.ok():  # else a signal has ended all that it would use
                    self.get_logger().error(f"{name} ignored: {traceback.format_exc()}")
            return given[-1] if given else None  # a service's response as it is

        return called

    # Parameters

    def read_settings(self, **changed: Any) -> Settings:
        """Return the parameters as they are, or will be; a TrailmarkError says which is not allowed."""
        return Settings(**{one.name: self.get_parameter(one.name).value for one in fields(Settings)} | changed)

    def _on_parameters(self, parameters: Sequence[Any]) -> SetParametersResult:
        values = {parameter.name: parameter.value for parameter in parameters}
        try:
            values = Settings.checked(values)
            settings = self.read_settings(**values)
            if self.site is not None and values:
                self.site.change_settings(settings)
                self._logging_errors("map", self._change_map)()
                self._follow.trigger()
        except TrailmarkError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    # Maps and obstacles

    def _on_map(self, message: OccupancyGrid) -> None:
        messages.grid_map(message, 100, False)  # says what is wrong with it
        self._map = message
        self._map_changed.trigger()

    def _on_map_update(self, update: Any) -> None:
        if self._map is not None:  # it comes first
            with self._cells_lock:
                messages.patched(self._map, update)
            self._map_changed.trigger()

    def _on_obstacles(self, message: MarkerArray) -> None:
        for marker in message.markers:  # one that is none takes none of the others with it
            self._logging_errors(f"obstacle {marker.ns}/{marker.id}", self._on_obstacle)(marker)
        self._map_changed.trigger()

    def _on_obstacle(self, marker: Marker) -> None:
        if marker.action == Marker.DELETEALL:
            self._obstacles.clear()
        elif marker.action == Marker.DELETE:
            self._obstacles.pop((marker.ns, marker.id), None)
        else:
            shapes = messages.marker_shapes(marker, self._frame(marker.header.frame_id))
            self._obstacles[marker.ns, marker.id] = shapes

    def _change_map(self) -> None:
        """Bring the planner up to date with the newest map and obstacles; what came meanwhile is taken all at once."""
        with self._map_lock:
            site = self.site
            if self._map is None or site is None:
                return
            with self._cells_lock:
                grid = messages.grid_map(self._map, site.settings.lethal_cost_threshold, site.settings.allow_unknown)
            shapes = [shape for some in list(self._obstacles.values()) for shape in some]
            if site.change_map(grid.with_shapes(shapes)):
                self._follow.trigger()

    def _follow_plan(self) -> None:
        """Look at the plan that is followed, after the map or a parameter changed."""
        site = self.site
        if site is not None and self._active:
            with site.planning:
                answer = site.follow(self._here(), self._goal.is_set)
                if answer is not None and not self._goal.is_set():
                    self._publish(answer, site)

    # Where the robot is

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        self._pose, self._odom_at_pose = self._in_map(message.header, message.pose.pose), self._odom

    def _on_odom(self, message: Odometry) -> None:
        self._odom = messages.configuration(message.pose.pose)
        self._odom_at_pose = self._odom_at_pose or self._odom

    def _here(self) -> Configuration | None:
        """Return the robot's pose in the map: by tf, else the last pose told and the odometry since; None: unknown."""
        if self._tf is not None and self.site is not None:
            try:
                return self._transform(self._frame(""), self.site.settings.robot_base_frame)
            except _FrameError:
                pass
        if self._pose is None or self._odom is None:
            return self._pose or self._odom
        (x0, y0, theta0), (x, y, theta) = self._odom_at_pose or self._odom, self._odom
        moved = se2.compose((0.0, 0.0, -theta0), (x - x0, y - y0, theta))
        x, y, theta = se2.compose(self._pose, moved).tolist()
        return x, y, theta

    def _frame(self, otherwise: str) -> str:
        """Return the map's frame."""
        return otherwise if self._map is None else self._map.header.frame_id

    def _in_map(self, header: Header, pose: Pose) -> Configuration:
        """Return a pose in the map's frame; an error where nobody tells the way from its own."""
        found, frame = messages.configuration(pose), self._frame(header.frame_id)
        if header.frame_id in ("", frame):
            return found
        x, y, theta = se2.compose(self._transform(frame, header.frame_id), found).tolist()
        return x, y, theta

    def _transform(self, target: str, source: str) -> Configuration:
        """Return where a frame lies in another one, as tf last told."""
        if self._tf is None:
            raise _FrameError(f"expected a pose in frame {target!r} as tf2_ros is not there, got one in {source!r}")
        try:
            found = self._tf.lookup_transform(target, source, Time()).transform
        except Exception as error:  # tf2's own, which may be missing, are of no common class
            raise _FrameError(f"expected a pose in frame {target!r}, got one in {source!r}: {error}") from None
        at = found.translation
        return messages.configuration(Pose(position=Point(x=at.x, y=at.y), orientation=found.rotation))

    # Plans

    def _on_accepted(self, kind: Any, handle: Any) -> None:
        """Begin a goal at once, in a thread beside the executor's."""
        self._pool.submit(self._logging_errors("goal", self._execute), kind, self._begin(), handle)

    def _execute(self, kind: Any, newer: threading.Event, handle: Any) -> None:
        """Answer a goal of an action of either kind."""
        request, goals = handle.request, getattr(handle.request, "goals", None)
        answer, path = Answer("UNKNOWN", "an error of trailmark's own, which the log tells of"), Path()
        try:
            answer, path = self._answer(
                request.start if request.use_start else None,
                [request.goal] if goals is None else getattr(goals, "goals", goals),  # nav_msgs/Goals since Kilted
                lambda: newer.is_set() or handle.is_cancel_requested,
            )
        finally:
            if rclpy.ok():  # else a signal came, and nobody can be told
                handle.execute(partial(_finish_goal, kind, answer, path))

    def _get_plan(self, request: Any, response: Any) -> Any:
        start = request.start if request.start.header.frame_id else None
        _, response.plan = self._answer(start, [request.goal], lambda: not self._active, follow=False)
        return response

    def _on_goal_pose(self, message: PoseStamped) -> None:
        self._answer(None, [message], self._begin().is_set)

    def end_goal(self) -> None:
        """End the goal that is planned for, and the ones that wait."""
        self._active = False
        self._stop.set()

    def _begin(self) -> threading.Event:
        """End the goal that is planned for, as a newer one is there; return what ends the newer one."""
        with self._goal_lock:
            self._stop.set()
            self._stop = begun = threading.Event()
        return begun

    def _answer(
        self, start: PoseStamped | None, goals: Sequence[PoseStamped], stop: Callable[[], bool], follow: bool = True
    ) -> tuple[Answer, Path]:
        """Plan from a pose (None: the robot's) through goals; return what came of it, and the path, which may be empty.

        To follow the plan is to publish it, and to keep it free while the map changes.
        """
        site = self.site
        if site is None or not self._active:
            return Answer("UNKNOWN", "the node is not active"), Path()
        while not site.planning.acquire(timeout=0.02):  # waiting for good, goals might take all threads
            if stop():
                return ENDED, Path()
        try:
            self._goal = self._stop if follow else self._goal
            answer = self._plan_from(start, goals, site, stop, follow)
            if answer.code == "TIMEOUT" and stop():
                return ENDED, Path()
            if not follow:
                return answer, self._path(answer, site)
            if answer.code != "NONE":
                self.get_logger().warning(f"{answer.code}: {answer.message}")
                self._follow.trigger()  # a plan that is followed still may have made way for this goal
            return answer, self._publish(answer, site)
        finally:
            site.planning.release()

    def _plan_from(
        self, start: PoseStamped | None, goals: Sequence[PoseStamped], site: PlanningSite, *how: Any
    ) -> Answer:
        try:
            if not goals:
                return Answer("NO_VIAPOINTS_GIVEN", "expected a goal, got none")
            here = self._here() if start is None else self._in_map(start.header, start.pose)
            if here is None:
                raise _FrameError("expected a start, or the robot's pose from tf, amcl_pose, initialpose or odom")
            return site.plan(here, [self._in_map(goal.header, goal.pose) for goal in goals], *how)
        except TrailmarkError as error:
            return Answer("TF_ERROR" if isinstance(error, _FrameError) else "UNKNOWN", str(error))

    def _is_path_valid(self, request: Any, response: Any) -> Any:
        response.is_valid = False
        if self.site is None or not self._active:
            raise ConfigurationError("the node is not active")
        if request.path.poses:
            header, states = request.path.header, messages.states_of(request.path.poses)
            if header.frame_id not in ("", self._frame("")):
                states = se2.compose(self._transform(self._frame(""), header.frame_id), states)
            invalid = self.site.invalid_poses(states, self._here())
            response.is_valid = not invalid
            if hasattr(response, "invalid_pose_indices"):
                response.invalid_pose_indices = invalid
        return response

    # What others see

    def _path(self, answer: Answer, site: PlanningSite) -> Path:
        """Return a plan as a message, empty if there is none."""
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id=self._frame("map"))
        return messages.path_message(answer.states(site.settings.path_spacing), site.settings.robot, header)

    def _publish(self, answer: Answer, site: PlanningSite) -> Path:
        """Publish a plan with its roadmap and footprints, say how good it is, and return it."""
        path = self._path(answer, site)
        self._plan.publish(path)
        self._diagnostics.publish(messages.diagnostics(self.get_fully_qualified_name(), answer, path.header))
        if self._swept.get_subscription_count():
            states = answer.states(site.settings.path_spacing)
            self._swept.publish(messages.swept_footprint(site.settings.robot, states, path.header))
        shown = self._roadmap.get_subscription_count() + self._landmarks.get_subscription_count()
        if shown and site.planner is not None:
            edges, landmarks = messages.roadmap_markers(site.planner.roadmap.graph, path.header)
            self._roadmap.publish(edges)
            self._landmarks.publish(landmarks)
        return path


class _Bond:
    """Heartbeats that tell nav2's lifecycle manager that the node lives, where the package ``bond`` is there."""

    def __init__(self, node: LifecycleNode, kind: Any) -> None:
        self._node, self._publisher = node, node.create_publisher(kind, "bond", 10)
        self._status = kind(id=node.get_name(), instance_id=uuid4().hex, active=True)
        self._status.heartbeat_period, self._status.heartbeat_timeout = HEARTBEAT, 40.0 * HEARTBEAT
        self._timer = node.create_timer(HEARTBEAT, self._beat, MutuallyExclusiveCallbackGroup())

    def _beat(self) -> None:
        self._status.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(self._status)

    def end(self) -> None:
        """Say that the node stopped as it should."""
        self._node.destroy_timer(self._timer)
        self._status.active = False
        self._beat()
        self._node.destroy_publisher(self._publisher)


def run(args: list[str]) -> None:
    """Run the node until it is interrupted (:func:`trailmark.ros.main`)."""
    sys.setswitchinterval(1e-3)  # while one thread plans, the others answer
    try:
        # Python's handlers end the node: compiling kernels puts its own in place for a while, and loses rclpy's.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy's own, and those of its C layer, have no common class
        raise ConfigurationError(f"trailmark ros: {error}") from None
    node, ended = PlannerServer(), threading.Event()
    try:
        executor = MultiThreadedExecutor(THREADS)
        executor.add_node(node)
        if node.get_parameter("autostart").value is not False:
            _ = node.read_settings().robot
            node.trigger_configure()
            node.trigger_activate()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: ended.set())
        while not ended.is_set():
            executor.spin_once(timeout_sec=SIGNAL_PERIOD)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.end_goal()  # its thread is waited for
        rclpy.try_shutdown()


def _finish_goal(kind: Any, answer: Answer, path: Path, handle: Any) -> Any:
    """Return an action's result, and end its goal."""
    result = kind.Result()
    result.planning_time = Duration(seconds=answer.seconds).to_msg()
    if hasattr(result, "error_code"):  # not in Humble
        result.error_code = getattr(kind.Result, answer.code, kind.Result.UNKNOWN)
    if hasattr(result, "error_msg"):
        result.error_msg = answer.message
    if answer.code == "NONE":
        result.path = path
        handle.succeed()
    elif handle.is_cancel_requested:
        handle.canceled()
    else:
        handle.abort()
    return result


def _interface(module: str, name: str) -> Any:
    """Return a message, service or action of a package that may not be there; None if it is not."""
    try:
        return getattr(import_module(module), name, None)
    except ImportError:
        return None


def _tf_buffer(node: LifecycleNode) -> Any:
    """Return tf's transforms; None where tf2_ros is not there."""
    if (made := _interface("tf2_ros", "Buffer")) is None:
        return None
    buffer = made()
    buffer.listener = _interface("tf2_ros", "TransformListener")(buffer, node)  # lives as long
    return buffer
