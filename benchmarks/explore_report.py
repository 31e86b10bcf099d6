"""Figures of the exploration benchmark over all runs, and the page that shows them."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np

from benchmarks.explore_run import ANCHOR, WITHOUT_LOOPS
from benchmarks.machine import markdown_table

__all__ = ["report", "summarise"]

Rows = list[dict[str, Any]]

SAMPLES = 10_000
"""Of the bootstrap, over worlds."""

SURFACE = ("surfaces, RMS", "worst", "2 sigma", "missing")
DECIDING = ("decision", "99 %", "most", "a reading")
PATHS = ("paths within 5 %", "median ratio", "free")

WANTED = (0.99, 0.98)
"""Share of what can be seen that is to be seen, without and with noise."""

SIGMA = 0.01
"""Metres: of a laser reading, where there is noise."""


def summarise(rows: Rows) -> dict[str, Any]:
    """Return the figures of all runs, as JSON has them."""
    runs = [row for row in rows if row["job"][3] != ANCHOR]
    groups = sorted({(row["job"][2], row["job"][3]) for row in runs})
    anchors = {row["job"][0]: row["distance"] for row in rows if row["job"][3] == ANCHOR and "distance" in row}
    ratios = []
    for noise in sorted({noise for noise, _ in groups}):
        for other in ("nearest-frontier", "gain-per-cost", WITHOUT_LOOPS):
            pairs = _pairs(runs, noise, "tour", other)
            if other == WITHOUT_LOOPS and not pairs:
                continue
            ratios.append({"noise": noise, "of": "tour", "to": other, **_geometric(pairs)})
        to_anchor: dict[str, list[float]] = {}
        for row in _of(runs, noise, "tour"):
            if row.get("status") == "complete" and anchors.get(row["job"][0], 0.0) > 0.0:
                to_anchor.setdefault(row["job"][0], []).append(math.log(row["distance"] / anchors[row["job"][0]]))
        ratios.append({"noise": noise, "of": "tour", "to": ANCHOR, **_geometric(to_anchor)})
    groups_found = [_group(_of(runs, noise, strategy), noise, strategy) for noise, strategy in groups]
    bad = ("error", "died", "hang")
    failed = [row for row in runs if row["status"] in bad or row.get("seen", 1.0) < WANTED[row["job"][2] > 0.0]]
    return {
        "code": dict(Counter(row["code"] for row in runs if "code" in row)),
        "groups": groups_found,
        "ratios": ratios,
        "short": [{"job": row["job"], **{k: row.get(k) for k in ("status", "reason", "seen")}} for row in failed],
    }


def _of(runs: Rows, noise: float, strategy: str) -> Rows:
    return [row for row in runs if row["job"][2] == noise and row["job"][3] == strategy]


def _group(rows: Rows, noise: float, strategy: str) -> dict[str, Any]:
    """Return the figures of a strategy's runs with one noise."""
    ended = [row for row in rows if "seen" in row]
    decisions = np.array([seconds for row in ended for seconds in row.get("decisions", ())])
    paths = [path for row in ended for path in row.get("paths", ())]
    both = [path for path in paths if path.get("cost") and path.get("true_cost")]

    def column(key: str) -> Any:
        return np.array([row[key] for row in ended], dtype=float)

    def surface(key: str) -> Any:
        return np.array([row["boundary"][key] for row in ended], dtype=float)

    return {
        "noise": noise,
        "strategy": strategy,
        "runs": len(rows),
        "ends": dict(Counter(row["status"] for row in rows)),
        "seen_least": _number(column("seen").min(initial=np.inf)),
        "seen_mean": _number(column("seen").mean()) if ended else None,
        "seen_by_oracle_least": _number(column("seen_by_oracle").min(initial=np.inf)),
        "collisions": int(column("collisions").sum()),
        "overlaps": int(column("overlaps").sum()),
        "nees": _number(column("nees").mean()) if ended else None,
        "distance": _number(np.exp(np.log(np.maximum(column("distance"), 1e-3)).mean())) if ended else None,
        "surface_rms": _number(np.sqrt(np.nanmean(surface("rms") ** 2))) if ended else None,
        "surface_rms_worst": _number(np.nanmax(surface("rms"))) if ended else None,
        "surface_missing": _number(np.nanmean(surface("missing"))) if ended else None,
        "decision_median": _number(np.median(decisions)) if len(decisions) else None,
        "decision_99": _number(np.quantile(decisions, 0.99)) if len(decisions) else None,
        "decision_max": _number(decisions.max(initial=0.0)),
        "cpu_per_reading": _number(column("cpu").sum() / max(1.0, column("readings").sum())) if ended else None,
        "pairs": len(paths),
        "pairs_within": sum(path["cost"] <= 1.05 * path["true_cost"] for path in both),
        "pairs_valid": sum(bool(path["valid"]) for path in paths),
        "pairs_ratio": _number(np.median([path["cost"] / path["true_cost"] for path in both])) if both else None,
        "pairs_free": sum(bool(path.get("free")) for path in paths),
        "pairs_planned": sum("free" in path for path in paths),
    }


def _pairs(runs: Rows, noise: float, one: str, other: str) -> dict[str, list[float]]:
    """Return logarithms of the ratios of two strategies' distances, of runs that both completed, by world."""
    distances: dict[str, dict[tuple[str, int], float]] = {}
    for name in (one, other):
        done = [row for row in _of(runs, noise, name) if row.get("status") == "complete"]
        distances[name] = {(row["job"][0], row["job"][1]): row["distance"] for row in done}
    found: dict[str, list[float]] = {}
    for key in sorted(distances[one].keys() & distances[other].keys()):
        found.setdefault(key[0], []).append(math.log(distances[one][key] / distances[other][key]))
    return found


def _geometric(logs: dict[str, list[float]]) -> dict[str, Any]:
    """Return the geometric mean of ratios and its 95 % interval, by a bootstrap over worlds."""
    means = np.array([np.mean(values) for values in logs.values()])
    if not len(means):
        return {"worlds": 0, "ratio": None, "low": None, "high": None}
    drawn = np.random.default_rng(0).choice(means, (SAMPLES, len(means))).mean(axis=1)
    low, high = np.exp(np.quantile(drawn, [0.025, 0.975]))
    return {"worlds": len(means), "ratio": float(np.exp(means.mean())), "low": float(low), "high": float(high)}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def report(summary: dict[str, Any], machine: str) -> str:
    """Return the Markdown page."""
    parts = [f"# Exploration\n\n{machine}\n"]
    if len(summary["code"]) > 1:
        told = "; ".join(f"{count} runs {code}" for code, count in summary["code"].items())
        parts.append(f"Not all runs are of the same code: {told}.\n")
    parts.append("Seen: share of what can be seen from where the robot can get to, of the run that saw least; in")
    parts.append("brackets by shapely, for a disc around the robot. Distances are geometric means.\n")
    header = ("noise", "strategy", "runs", "ends", "seen, least", "seen, mean", "collisions", "NEES", "driven")
    parts.append(
        markdown_table(
            header,
            [
                (
                    f"{g['noise']:g}",
                    g["strategy"],
                    str(g["runs"]),
                    ", ".join(f"{count} {end}" for end, count in sorted(g["ends"].items())),
                    f"{_percent(g['seen_least'])} ({_percent(g['seen_by_oracle_least'])})",
                    _percent(g["seen_mean"]),
                    f"{g['collisions']} ({g['overlaps']} poses overlap)",
                    _text(g["nees"], "{:.2f}"),
                    _text(g["distance"], "{:.1f} m"),
                )
                for g in summary["groups"]
            ],
        )
    )
    parts.append("\nDriven distances, ratios of runs that both completed, 95 % intervals by a bootstrap over worlds:\n")
    parts.append(
        markdown_table(
            ("noise", "of", "to", "worlds", "ratio", "interval"),
            [
                (
                    f"{r['noise']:g}",
                    r["of"],
                    r["to"],
                    str(r["worlds"]),
                    _text(r["ratio"], "{:.3f}"),
                    f"{_text(r['low'], '{:.3f}')} to {_text(r['high'], '{:.3f}')}",
                )
                for r in summary["ratios"]
            ],
        )
    )
    parts += [
        "\nThe map made, decisions, and paths in it (tour only). Surfaces: those that can be seen. Free: in the true",
        "world, by the audit, which allows 1e-7 m; with noise obstacles are grown for the confidence, without they",
        "are as measured, and shortest paths touch them.\n",
    ]
    parts.append(
        markdown_table(
            ("noise", "strategy", *SURFACE, *DECIDING, *PATHS),
            [
                (
                    f"{g['noise']:g}",
                    g["strategy"],
                    _text(g["surface_rms"], "{:.4f} m"),
                    _text(g["surface_rms_worst"], "{:.4f} m"),
                    f"{2.0 * SIGMA * g['noise']:g} m",
                    _percent(g["surface_missing"]),
                    _milliseconds(g["decision_median"]),
                    _milliseconds(g["decision_99"]),
                    _milliseconds(g["decision_max"]),
                    _milliseconds(g["cpu_per_reading"]),
                    f"{g['pairs_within']} of {g['pairs_valid']}",
                    _text(g["pairs_ratio"], "{:.3f}"),
                    f"{g['pairs_free']} of {g['pairs_planned']}",
                )
                for g in summary["groups"]
            ],
        )
    )
    if summary["short"]:
        parts.append("\nRuns that fall short:\n")
        for row in summary["short"]:
            world, seed, noise, strategy = row["job"]
            seen = "" if row["seen"] is None else f", seen {_percent(row['seen'])}"
            parts.append(f"- {world}, seed {seed}, noise {noise:g}, {strategy}: {row['status']}{seen}: {row['reason']}")
    return "\n".join(parts) + "\n"


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100.0 * value:.2f} %"


def _milliseconds(value: float | None) -> str:
    return "-" if value is None else f"{1e3 * value:.0f} ms"
