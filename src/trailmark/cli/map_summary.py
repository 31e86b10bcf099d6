"""What ``trailmark map`` prints on the map that it made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.cli import console

if TYPE_CHECKING:
    from trailmark.estimation.logs.records import Log
    from trailmark.estimation.maps.mapped_log import MappedLog

__all__ = ["plural", "print_summary"]


_FRAMES = {
    "start": "relative to the start: errors of where the map lies count",
    "map": "relative to the map itself: for a robot that localises on it",
}


def plural(n: int, noun: str) -> str:
    """Return a count with its noun."""
    return f"{n:,} {noun}{'' if n == 1 else 's'}"


def print_summary(mapped: MappedLog, log: Log, skip_bad: bool, written: list[Path]) -> None:
    """Print the map's figures as a table."""
    found = mapped.figures()
    obstacles, features, nis = found["obstacles"], found["features"], found["nis"]
    kinds = [f"{obstacles[name]:,} {name}" for name in ("discs", "walls", "heaps", "unknown") if obstacles[name]]
    console.say(f"{found['name']}: {plural(obstacles['all'], 'obstacle')}", fg="green", bold=True)
    records = [f"{n:,} {name}" for name, n in found["records"].items() if n and name != "all"]
    left_out = f"; {plural(log.dropped, 'bad record')} left out" if skip_bad else ""
    confirmed = f"{features['confirmed']:,} confirmed, {features['dropped']:,} dropped"
    confirmed += f", {features['tentative']:,} tentative" if features["tentative"] else ""
    rows = [
        ("records", f"{found['records']['all']:,} ({', '.join(records)}){left_out}"),
        ("poses", _poses_text(mapped, found)),
        ("features", confirmed),
    ]
    if nis is not None:
        where = "in" if nis["inside"] else "below" if nis["mean"] < nis["low"] else "above"
        band = f"expected {nis['expected']:.3f}, {where} its 95 % χ² band {nis['low']:.3f}..{nis['high']:.3f}"
        rows.append(("NIS", f"{nis['mean']:.3f} over {plural(nis['updates'], 'update')} ({band})"))
    if found["batch"] is not None:
        rows.append(("batch", _batch_text(found["batch"])))
    seconds = found["time"]
    each = "-" if seconds["per_update"] is None else f"{1e3 * seconds['per_update']:.3g} ms"
    rows += [
        ("time", f"{each} per {'update' if mapped.scans is None else 'scan'}, {seconds['total']:.2f} s in all"),
        ("obstacles", ", ".join(kinds)),
        ("bounds", " ".join(f"{value:g}" for value in found["bounds"])),
        ("queries", ", ".join(found["queries"]) or "none"),
        ("risk", _risk_text(found)),
        *((("covariances", _FRAMES[obstacles["frame"]]),) if "frame" in obstacles else ()),
        *([] if found["not_certified"] is None else [("not certified", found["not_certified"])]),
        *(("note", note) for note in found["notes"]),
        *(("written", str(file)) for file in written),
    ]
    console.print_table(rows, indent="  ")


def _poses_text(mapped: MappedLog, found: dict[str, Any]) -> str:
    way = found["trajectory"]
    matching = found["matching"] or {}
    source = {
        "match": "{nodes:,} scans matched, {closures:,} loop closures, {rejected:,} rejected".format_map(
            {"nodes": 0, "closures": 0, "rejected": 0, **matching}
        ),
        "slam": f"EKF-SLAM, association {mapped.association}",
        "log": "as the log states them",
        "odometry": "odometry alone",
    }[mapped.poses]
    counts = found["counts"] or {}
    named = ("outliers", "repeated", "ambiguous", "unidentified", "cut_short")
    ignored = [f"{counts[name]:,} {name.replace('_', ' ')}" for name in named if counts.get(name)]
    return f"{source}; {way['length']:,.1f} m driven" + (f"; {', '.join(ignored)}" if ignored else "")


def _batch_text(batch: dict[str, Any]) -> str:
    """Return what the batch after the filter made of the stated noise, and the systematic errors that it found."""
    text = f"all poses smoothed over {batch['readings']:,} readings"
    if not batch["fitted"]:
        return f"{text}; noise as stated"
    odometry, ranges = batch["odometry"], batch["range"]
    return (
        f"{text}; noise estimated: odometry's distances times {odometry['distance']:.3f}, turns times "
        f"{odometry['turn']:.3f}, {odometry['delay']:.2f} s late; ranges' error by the bearing's square "
        f"{ranges['projection']:+.2f}, their scale known to {100 * batch['scale']['sigma']:.1f} %"
    )


def _risk_text(found: dict[str, Any]) -> str:
    if found["risk"] is None:
        return "none stated: the obstacles stand as they were measured (--confidence grows them)"
    risk = found["risk"]
    return f"a valid path meets an obstacle with probability {risk['collision_at_most']:.4g} at most"
