"""Conversions between arrays and OMPL's states, paths and planner data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from ompl import base as ob
from ompl import geometric as og

from trailmark import se2
from trailmark.trajectories import Path

if TYPE_CHECKING:
    import networkx as nx

__all__ = [
    "configuration",
    "path_to_ompl",
    "planner_data_graph",
    "starts_and_goal",
    "state",
    "states_of",
    "write_state",
]


def state(information: Any, q: ArrayLike) -> Any:
    """Return an OMPL state for a configuration.

    Args:
        information: the ``SpaceInformation`` of an SE(2)-like space.
        q: shape (3,), metres and radians.

    Raises:
        ConfigurationError: another shape, or values that are not finite.
    """
    made = information.allocState()
    write_state(made, se2.configurations(q))
    return made


def write_state(target: Any, q: ArrayLike) -> None:
    """Set x, y and heading of an OMPL state."""
    x, y, theta = np.asarray(q, dtype=np.float64).tolist()
    target.setX(x)
    target.setY(y)
    target.setYaw(float(se2.wrap(theta)))


def configuration(source: Any) -> se2.FloatArray:
    """Return an OMPL state as a configuration, shape (3,)."""
    return np.array([source.getX(), source.getY(), source.getYaw()])


def starts_and_goal(problem: Any) -> tuple[se2.FloatArray, se2.FloatArray | None]:
    """Return a problem's starts that OMPL holds valid, shape (n, 3), and its first valid goal, shape (3,), or None."""
    # Not ProblemDefinition.getStartState, whose state OMPL 2.0.1 frees twice.
    inputs = ob.PlannerInputStates()
    inputs.use(problem)
    starts = [configuration(start) for start in iter(inputs.nextStart, None)]
    goal = None if problem.getGoal() is None else inputs.nextGoal()
    return np.array(starts).reshape(-1, 3), None if goal is None else configuration(goal)


def states_of(path: Any) -> se2.FloatArray:
    """Return a ``PathGeometric``'s states, shape (n, 3)."""
    return np.array([configuration(path.getState(i)) for i in range(path.getStateCount())]).reshape(-1, 3)


def path_to_ompl(information: Any, path: Path | ArrayLike) -> Any:
    """Return a ``PathGeometric`` through the states of a path or of an array (n, 3).

    Exactly half a turn back, which OMPL would turn clockwise, gets a state in its middle.
    """
    rows = path.states if isinstance(path, Path) else np.atleast_2d(se2.configurations(path))
    back = np.flatnonzero(np.diff(rows[:, 2]) == -np.pi)
    rows = np.insert(rows, back + 1, se2.interpolate(rows[back], rows[back + 1], 0.5), axis=0)
    made = og.PathGeometric(information)
    for row in rows:
        made.append(state(information, row))
    return made


def planner_data_graph(source: Any) -> nx.Graph:
    """Return a planner's roadmap or tree as a networkx graph.

    Args:
        source: a ``SimpleSetup``, a ``Planner`` of OMPL's own, or ``PlannerData``.

    Returns:
        Nodes 0 … n−1 with ``configuration`` (x, y, theta), ``start`` and ``goal`` (bool); edges with ``length``
        (metres, the space's distance).
    """
    import networkx as nx

    data, information = _planner_data(source)
    space = information.getStateSpace()
    graph = nx.Graph()
    vertices = [data.getVertex(i) for i in range(data.numVertices())]
    for i, vertex in enumerate(vertices):
        graph.add_node(
            i,
            configuration=tuple(configuration(vertex.getState()).tolist()),
            start=bool(data.isStartVertex(i)),
            goal=bool(data.isGoalVertex(i)),
        )
    for i, vertex in enumerate(vertices):
        for j in map(int, data.getEdges(i)):
            graph.add_edge(i, j, length=float(space.distance(vertex.getState(), vertices[j].getState())))
    return graph


def _planner_data(source: Any) -> tuple[Any, Any]:
    if isinstance(source, ob.PlannerData):
        return source, source.getSpaceInformation()
    information = source.getSpaceInformation()
    data = ob.PlannerData(information)
    source.getPlannerData(data)
    return data, information
