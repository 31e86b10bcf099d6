"""How a report writes numbers: three significant digits, thousands separated, a dash for what is not known."""

# Tested by tests/benchmark/report/test_summary.py.
from __future__ import annotations

import math

__all__ = ["NOTHING", "count", "factor", "milliseconds", "number", "percent", "probability", "seconds"]

NOTHING = "–"


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with ``digits`` significant digits, never in powers of ten."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞"
    if value == 0.0:
        return "0"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    # Rounding may carry into another digit: 0.09996 has one place less than 0.0999.
    places = max(0, digits - 1 - math.floor(math.log10(abs(round(value, places)) or abs(value))))
    return f"{value:,.{places}f}"


def count(value: float | None) -> str:
    """Return a whole number, rounded to three significant digits above 1,000."""
    return number(value) if value is None or not math.isfinite(value) or abs(value) >= 1000 else f"{value:.0f}"


def milliseconds(value: float | None) -> str:
    """Return seconds as a number of milliseconds, without the unit."""
    return number(None if value is None else 1e3 * value)


def seconds(value: float) -> str:
    """Return a duration with its unit."""
    if value < 1e-3:
        return f"{number(1e6 * value)} µs"
    return f"{number(1e3 * value)} ms" if value < 0.9995 else f"{number(value)} s"


def percent(share: float) -> str:
    """Return a share as per cent with its unit; only all is 100 %, and only none is 0 %."""
    if math.isnan(share):
        return NOTHING
    shown = 100.0 * share
    if 0.0 < shown < 0.1:
        return "< 0.1 %"
    if 99.9 < shown < 100.0:
        return "> 99.9 %"
    return f"{shown:.0f} %" if shown in (0.0, 100.0) else f"{shown:.1f} %"


def factor(value: float) -> str:
    """Return a ratio such as ``4.31×``."""
    return NOTHING if math.isnan(value) else f"{number(value)}×"


def probability(p: float) -> str:
    """Return a probability of a test, with the comparison: ``= 0.031``, ``< 0.001``."""
    return "< 0.001" if p < 0.001 else f"= {p:.3f}" if p < 0.1 else f"= {p:.2f}"
