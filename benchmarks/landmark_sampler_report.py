"""What the runs of benchmarks/landmark_sampler.py say: success with Wilson intervals, cost with bootstrap intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, markdown_table

__all__ = ["mean_interval", "page", "ratio_interval", "summary", "wilson"]

Z = 1.959963984540054
"""95 % of a normal distribution lie within so many standard deviations."""

RESAMPLES = 4000
FEWEST = 5
"""Solved runs of both samplers below which costs are not compared."""

Interval = tuple[float, float, float]
"""An estimate and the ends of its 95 % interval."""


def wilson(hits: int, tries: int) -> Interval:
    """Return a share and its score interval (Wilson 1927)."""
    share = hits / tries
    scale = 1.0 + Z**2 / tries
    middle = (share + Z**2 / (2 * tries)) / scale
    half = Z / scale * math.sqrt(share * (1.0 - share) / tries + Z**2 / (4 * tries**2))
    # Rounding leaves a speck where nobody or everybody got through.
    return share, 0.0 if hits == 0 else middle - half, 1.0 if hits == tries else middle + half


def mean_interval(values: Sequence[float]) -> Interval:
    """Return a mean and its bootstrap interval (percentiles of the resampled means)."""
    means = _resampled(np.asarray(values, dtype=np.float64), np.random.default_rng(0))
    low, high = np.quantile(means, (0.025, 0.975))
    return float(np.mean(values)), float(low), float(high)


def ratio_interval(above: Sequence[float], below: Sequence[float]) -> Interval:
    """Return the ratio of two means and its bootstrap interval; the two are resampled independently."""
    rng = np.random.default_rng(0)
    ratios = _resampled(np.asarray(above), rng) / _resampled(np.asarray(below), rng)
    low, high = np.quantile(ratios, (0.025, 0.975))
    return float(np.mean(above) / np.mean(below)), float(low), float(high)


def _resampled(values: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    return np.asarray(values[rng.integers(0, len(values), (RESAMPLES, len(values)))].mean(axis=1))


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one record per case: success and cost of both samplers, and their ratio of costs."""
    cases: dict[tuple[str, str, str, float], list[dict[str, Any]]] = {}
    for row in rows:
        cases.setdefault((row["group"], row["world"], row["query"], row["limit"]), []).append(row)
    records = []
    for (group, world, query, limit), found in cases.items():
        costs = {s: [r["cost"] for r in found if r["sampler"] == s and r["cost"] is not None] for s in _samplers(found)}
        tries = {s: sum(r["sampler"] == s for r in found) for s in costs}
        enough = min(len(values) for values in costs.values()) >= FEWEST
        records.append(
            {
                "group": group,
                "world": world,
                "query": query,
                "limit": limit,
                "runs": tries,
                "success": {s: wilson(len(costs[s]), tries[s]) for s in costs},
                "cost": {s: mean_interval(costs[s]) if len(costs[s]) >= FEWEST else None for s in costs},
                "cost ratio": ratio_interval(costs["landmark"], costs["uniform"]) if enough else None,
                "wrong": sum(r["wrong"] for r in found),
                "lost": sum(r.get("lost", False) for r in found),
                "milestones": {
                    s: float(np.median([r["milestones"] for r in found if r["sampler"] == s])) for s in costs
                },
                "latest": max(r["seconds"] - limit for r in found),
            }
        )
    return records


def _samplers(rows: list[dict[str, Any]]) -> list[str]:
    return sorted({row["sampler"] for row in rows})


def verdict(records: list[dict[str, Any]]) -> str:
    """Return in words how often the landmark sampler is ahead, behind, or neither; ``records`` at their first limit."""
    ahead = sum(r["success"]["landmark"][1] > r["success"]["uniform"][2] for r in records)
    behind = sum(r["success"]["landmark"][2] < r["success"]["uniform"][1] for r in records)
    ratios = [r["cost ratio"] for r in records if r["cost ratio"] is not None]
    cheaper = sum(high < 1.0 for _, _, high in ratios)
    dearer = sum(low > 1.0 for _, low, _ in ratios)
    return (
        f"PRM solves more with the landmark sampler in {ahead} of {len(records)} problems, fewer in {behind} "
        f"(intervals apart); its paths are cheaper in {cheaper} of the {len(ratios)} problems where costs can be "
        f"compared, dearer in {dearer} (interval of the ratio apart from 1)."
    )


MARKS = {"shipped": "", "generated": " *", "longer": " +"}


def page(rows: list[dict[str, Any]], seconds: float, load: float) -> str:
    """Return the Markdown page; ``load`` is the machine's load average."""
    records = summary(rows)
    table = [
        [
            record["world"] + MARKS[record["group"]],
            record["query"],
            f"{record['limit']:g}",
            *(_share(record["success"][s]) for s in ("landmark", "uniform")),
            *(_cost(record["cost"][s]) for s in ("landmark", "uniform")),
            _ratio(record["cost ratio"]),
            *(f"{record['milestones'][s]:.0f}" for s in ("landmark", "uniform")),
        ]
        for record in records
    ]
    header = ["world", "query", "limit s", "success %, landmarks", "success %, own", "cost m, landmarks", "cost m, own"]
    header += ["cost ratio", "milestones, landmarks", "own"]
    lost, wrong = (sum(record[key] for record in records) for key in ("lost", "wrong"))
    latest = 1e3 * max(record["latest"] for record in records)
    runs = "/".join(str(count) for count in sorted({count for record in records for count in record["runs"].values()}))
    return f"""# Does the landmark sampler help OMPL's PRM?

Written by `python -m benchmarks.landmark_sampler`.

**{verdict([record for record in records if record["group"] != "longer"])}**

It is behind, or level, where uniform samples get through in about the time that making the first landmarks takes: 5 to
60 ms of a core, most where the relaxed way is long or keeps close to obstacles (clutter, maze), and where a manoeuvre
off the short way is needed (lshape turn). The rows with a plus are these problems again, with more time: the landmark
sampler catches up without getting ahead in success, and has the cheaper paths in all but lshape turn.

{markdown_table(header, table)}

- Both: OMPL's PRM with its own neighbours, trailmark's checker and certified motion validator, path length as
  objective, the same wall-clock limit, within which the landmark sampler also makes its landmarks. {runs} runs each,
  the samplers in turns, each run in a process of its own.
- The limits were chosen by PRM's own sampler alone, on other seeds, so that it neither always nor never gets through.
- Success: a path within the limit that the referee finds no fault in; 95 % Wilson intervals. A run that had to be
  ended would count as failed; there were {lost}. Paths with a fault: {wrong}.
- Cost: mean over the solved runs at the end of the limit, metres (0.5 m a radian), not shortened; 95 % bootstrap
  intervals. Solved runs of a sampler that solves few are its luckiest ones. Ratio: landmarks' mean over own mean.
- Worlds with a star are generated, and the sampler's numbers were not chosen on them: all are feasible, since
  PRM's own sampler got through on the seeds that chose the limits.
- Left out, since PRM's own sampler never got through when the limits were chosen: narrow third and all, passages-7.
- Worlds with a plus were added after the others had run, with another limit.
- Milestones: median number of PRM's nodes at the end. The latest run returned {latest:.0f} ms after its limit.
- {seconds:.0f} s at a load average of {load:.1f}, so that runs got a part of a core, both samplers alike;
  {describe_machine()}
"""


def _share(found: Interval) -> str:
    return "{:.0f} ({:.0f} to {:.0f})".format(*(100.0 * value for value in found))


def _cost(found: Interval | None) -> str:
    return "" if found is None else "{:.1f} ({:.1f} to {:.1f})".format(*found)


def _ratio(found: Interval | None) -> str:
    return "" if found is None else "{:.2f} ({:.2f} to {:.2f})".format(*found)
