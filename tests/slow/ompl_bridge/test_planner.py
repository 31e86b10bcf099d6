"""The landmark planner as one of OMPL's."""

from __future__ import annotations

from typing import Any


def test_it_solves_in_a_simple_setup_and_keeps_its_roadmap(run_ompl: Any) -> None:
    found = run_ompl("""
from trailmark import PlannerSettings
problem = SE2Problem(shipped("environment2"))
quick = PlannerSettings(first_landmarks=60, patience=1)
planner = problem.set_planner(OmplLandmarkPlanner(problem.information, seed=0, settings=quick))
sizes, costs, words, names = [], [], [], []
for k in range(2):
    words.append(problem.solve(5.0).asString())
    path = problem.path.states
    costs.append([problem.path.cost, problem.setup.getSolutionPath().length(), planner.result.cost])
    names.append(problem.setup.getSolutionPlannerName())
    tell(certified=bool(problem.checker.motions_valid(path[:-1], path[1:]).all()),
         ends=[path[0].tolist(), path[-1].tolist()], wanted=[problem.start.tolist(), problem.goal.tolist()])
    sizes.append(len(planner.roadmap))
    problem.setup.clear()
fresh = OmplLandmarkPlanner(problem.information, seed=0, keep_roadmap=False, settings=quick)
problem.set_planner(fresh)
again = []
for k in range(2):
    problem.solve(5.0)
    again.append([len(fresh.roadmap), problem.path.cost])
    problem.setup.clear()
tell(sizes=sizes, costs=costs, words=words, names=names, again=again, cleared=fresh.roadmap is None)
""")
    assert found["words"] == ["Exact solution"] * 2
    assert found["names"] == ["landmark"] * 2
    assert found["certified"]
    assert found["ends"] == found["wanted"]
    for ours, theirs, result in found["costs"]:
        assert abs(ours - theirs) < 1e-9
        # With fewer vertices than the result, and hardly longer.
        assert -1e-2 * result < ours - result < 1.01e-4 * result
    # The roadmap grows from query to query, unless each is to start from nothing.
    assert found["sizes"] == sorted(found["sizes"])
    assert found["sizes"][0] > 20
    assert found["again"][0] == found["again"][1]
    assert found["cleared"]


def test_the_process_may_end_while_work_that_was_cut_short_goes_on(run_ompl: Any) -> None:
    # run_ompl looks at the exit status: a thread cut off in compiled code would abort the process.
    found = run_ompl(
        """
problem = SE2Problem(shipped("long"), query="corner")
words = []
for limit in (0.1, 0.002, 0.02, 0.3, 0.03):
    problem.set_planner(OmplLandmarkPlanner(problem.information, seed=0, keep_roadmap=False))
    words.append(problem.solve(limit).asString())
    problem.setup.clear()
tell(words=words)
""",
        whole=True,
    )
    # It ends by the condition; a path that comes while the planner is asked to stop is handed over.
    assert set(found["words"]) <= {"Timeout", "Exact solution"}
    assert found["words"][3] == "Exact solution"


def test_no_path_and_half_a_path_are_reported_as_such(run_ompl: Any) -> None:
    found = run_ompl("""
world = shipped("enclosed")
names = [q.name for q in world.queries]
problem = SE2Problem(world, query=names[0])
planner = problem.set_planner(OmplLandmarkPlanner(problem.information, seed=0))
status = problem.solve(10.0)
tell(infeasible=status.getStatus() == ob.PlannerStatus.INFEASIBLE, proven=planner.result.status)
# A gap as wide as the robot but for a hair: the relaxed disc gets through, the robot does not.
from trailmark.shapes import Rectangle
walls = (Rectangle((10.0, 2.25), 1.0, 4.5), Rectangle((10.0, 7.749), 1.0, 4.502))
world = World("slit", (0.0, 0.0, 20.0, 10.0), walls, Robot.disc(0.5))
problem = SE2Problem(world, query=((2.0, 5.0, 0.0), (18.0, 5.0, 0.0)))
planner = problem.set_planner(OmplLandmarkPlanner(problem.information, seed=0))
status = problem.solve(2.0)
tell(word=status.asString(), approximate=problem.setup.getProblemDefinition().hasApproximateSolution(),
     exact=problem.setup.haveExactSolutionPath(), path=problem.path is None,
     difference=problem.setup.getProblemDefinition().getSolutionDifference())
""")
    assert found["infeasible"]
    assert found["proven"] == "infeasible"
    if found["word"] == "Approximate solution":
        assert found["approximate"]
        assert 6.0 < found["difference"] < 16.0
    assert not found["exact"]
    assert found["path"]
