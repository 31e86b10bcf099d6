"""First paths of robots that keep a clearance, and of differential drives, beside those of the same robots without.

The problems are those of benchmarks/ahead_problems.py, whose robots move in every direction. Each is answered in turns
in one run: plainly, with a clearance of a tenth of the robot's inscribed radius, and as a differential drive. A problem
counts for a ratio if both were solved; whose ends do not keep the clearance is left out there. Writes
results/drives.{json,md}.

    python -m benchmarks.drives [--worlds 2] [--seeds 1] [--limit 1.0] [--no-data]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from benchmarks.ahead_problems import cases
from benchmarks.machine import describe_machine, markdown_table
from trailmark import LandmarkPlanner, Robot
from trailmark.errors import ConfigurationError
from trailmark.planning.warmup import warm_up

SHARE = 0.1
"""Of the inscribed radius: the clearance."""

RESULTS = Path(__file__).parent / "results"


def variants(robot: Robot) -> dict[str, Robot]:
    """Return the robots that are compared, by name."""
    kept = robot.keeping(SHARE * robot.inscribed_disc.radius)
    return {"plain": robot, "clearance": kept, "differential": robot.differential()}


def run(worlds: int, seeds: int, limit: float, data: bool) -> list[dict[str, object]]:
    """Return a row for each answer: problem, variant, status, seconds to the first path, its cost and the last one."""
    for kind in ("straight", "translation", "differential"):
        warm_up(kind)
    rows: list[dict[str, object]] = []
    for case in cases(worlds, data):
        for seed in range(seeds):
            for name, robot in variants(case.problem.robot).items():
                planner = LandmarkPlanner(case.problem.world, robot, seed=seed)
                try:
                    result = planner.plan(case.problem.query.start, case.problem.query.pose(), limit)
                except ConfigurationError:
                    continue
                rows.append(
                    {
                        "problem": case.problem.key,
                        "seed": seed,
                        "variant": name,
                        "status": result.status,
                        "first": result.time["first_solution"],
                        "first_cost": result.first_cost,
                        "cost": result.cost,
                        "min_clearance": result.min_clearance,
                    }
                )
    return rows


def summary(rows: list[dict[str, object]]) -> str:
    """Return a table of what was solved, and of the ratios to the plain answers."""
    plain = {(row["problem"], row["seed"]): row for row in rows if row["variant"] == "plain"}
    lines = []
    for name in ("plain", "clearance", "differential"):
        mine = [row for row in rows if row["variant"] == name]
        pairs = [(row, plain[row["problem"], row["seed"]]) for row in mine]
        both = [(row, other) for row, other in pairs if row["first"] is not None and other["first"] is not None]
        firsts = np.array([float(str(row["first"])) for row in mine if row["first"] is not None])
        times, firsts_cost, costs = (
            np.array([float(str(row[key])) / float(str(other[key])) for row, other in both])
            for key in ("first", "first_cost", "cost")
        )
        lines.append(
            [
                name,
                str(len(mine)),
                str(sum(row["status"] == "solved" for row in mine)),
                str(sum(row["status"] == "infeasible" for row in mine)),
                f"{1e3 * np.median(firsts):.1f}",
                f"{np.exp(np.log(times).mean()):.2f}",
                f"{np.exp(np.log(firsts_cost).mean()):.3f}",
                f"{np.exp(np.log(costs).mean()):.3f}",
            ]
        )
    head = ["variant", "answers", "solved", "infeasible", "first path, median ms", "ratio of first paths"]
    return markdown_table([*head, "of their costs", "of last costs"], lines)


def main() -> None:
    """Run the comparison and write its results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=2)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--limit", type=float, default=1.0)
    parser.add_argument("--no-data", action="store_true")
    words = parser.parse_args()
    rows = run(words.worlds, words.seeds, words.limit, not words.no_data)
    asked = f"{words.worlds} random worlds of each kind, {words.seeds} seeds, {words.limit:g} s for each answer"
    text = f"# Clearances and drives\n\n{describe_machine()}; {asked}\n\n{summary(rows)}\n"
    record = {"machine": describe_machine(), "answers": rows}
    RESULTS.joinpath("drives.json").write_text(json.dumps(record, indent=1) + "\n")
    RESULTS.joinpath("drives.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
