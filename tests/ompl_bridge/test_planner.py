"""The landmark planner as one of OMPL's."""

from __future__ import annotations

from typing import Any

import pytest


@pytest.mark.slow
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


@pytest.mark.slow
def test_it_ends_with_the_termination_condition(run_ompl: Any) -> None:
    found = run_ompl("""
problem = SE2Problem(shipped("long"), query="corner")
planner = problem.set_planner(OmplLandmarkPlanner(problem.information, seed=0, keep_roadmap=False))
problem.solve(0.1)
problem.setup.clear()
words = []
for limit in (0.002, 0.02, 0.1, 0.3):
    words.append(problem.solve(limit).asString())
    problem.setup.clear()
tell(words=words)
""")
    # By how many milliseconds it is late benchmarks/limits.py tells; here only that it ends by the condition.
    # A path that comes while the planner is asked to stop is handed over.
    assert set(found["words"]) <= {"Timeout", "Exact solution"}
    assert found["words"][-1] == "Exact solution"


@pytest.mark.slow
def test_the_process_may_end_while_work_that_was_cut_short_goes_on(run_ompl: Any) -> None:
    # run_ompl looks at the exit status: a thread cut off in compiled code would abort the process.
    found = run_ompl(
        """
problem = SE2Problem(shipped("long"), query="corner")
problem.set_planner(OmplLandmarkPlanner(problem.information, seed=0))
tell(status=problem.solve(0.03).asString())
""",
        whole=True,
    )
    assert found["status"]


@pytest.mark.slow
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


@pytest.mark.slow
def test_it_runs_in_ompls_benchmark_beside_the_others(run_ompl: Any, tmp_path: Any) -> None:
    found = run_ompl(
        f"""
from ompl import tools as ot
problem = SE2Problem(shipped("office"))
bench = ot.Benchmark(problem.setup, "office")
bench.addPlanner(og.RRTConnect(problem.information))
bench.addPlanner(OmplLandmarkPlanner(problem.information, seed=0, keep_roadmap=False))
request = ot.Request()
request.maxTime, request.maxMem, request.runCount, request.displayProgress = 0.1, 2000.0, 3, False
request.saveConsoleOutput = False
with planning():
    bench.benchmark(request)
bench.saveResultsToFile({str(tmp_path / "office.log")!r})
tell(done=True)
"""
    )
    assert found["done"]
    log = (tmp_path / "office.log").read_text()
    assert "geometric_RRTConnect" in log
    rows = log.split("geometric_landmark")[1].split("3 runs")[1].split(".\n")[0]
    assert len([row for row in rows.splitlines() if row.strip()]) == 3
