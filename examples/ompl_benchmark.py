"""The landmark planner beside OMPL's own in OMPL's Benchmark; the log becomes a database that Planner Arena reads.

python examples/ompl_benchmark.py [WORLD] [FOLDER]
"""

import subprocess
import sys
from pathlib import Path

from ompl import geometric as og
from ompl import tools as ot

from trailmark import World
from trailmark.ompl_bridge import LandmarkPlanner, SE2Problem, planning

world = World.load(sys.argv[1] if len(sys.argv) > 1 else "worlds/office.yaml")
folder = Path(sys.argv[2] if len(sys.argv) > 2 else ".")

problem = SE2Problem(world)
benchmark = ot.Benchmark(problem.setup, world.name)
benchmark.addPlanner(og.RRTConnect(problem.information))
benchmark.addPlanner(og.PRM(problem.information))
# Each run is to start from nothing, as the others' do.
benchmark.addPlanner(LandmarkPlanner(problem.information, seed=0, keep_roadmap=False))

request = ot.Request()
request.maxTime, request.maxMem, request.runCount, request.displayProgress = 1.0, 4000.0, 3, False
request.saveConsoleOutput = False
with planning():  # Ctrl-C and errors in callbacks are raised at the end of the block
    benchmark.benchmark(request)

log, database = folder / f"{world.name}.log", folder / f"{world.name}.db"
benchmark.saveResultsToFile(str(log))
statistics = Path(sys.executable).with_name("ompl_benchmark_statistics")
subprocess.run([statistics, str(log), "-d", str(database)], check=True)
print(f"written: {log}, {database}")
