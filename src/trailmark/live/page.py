"""The live page: one HTML file with everything in it, that asks for nothing but its WebSocket."""

from __future__ import annotations

import base64
import hashlib
from html import escape
from pathlib import Path
from string import Template

from trailmark import colours

__all__ = ["page_of"]

SCRIPTS = (
    *("geometry.js", "view.js", "scene.js", "files.js", "page.js", "link.js", "plans.js", "driving.js"),
    *("drawing.js", "pointer.js", "selection.js", "controls.js"),
)
"""In the order in which they build on each other."""


def page_of(name: str) -> tuple[str, str]:
    """Return the page and its Content-Security-Policy.

    Args:
        name: of the world that it begins with.
    """
    folder = Path(__file__).parent / "assets"
    script = "\n".join((folder / file).read_text(encoding="utf-8") for file in SCRIPTS)
    parts = {"title": escape(f"{name} · trailmark live"), "script": script}
    parts |= {color: getattr(colours, color) for color in ("MARGIN", "OBSTACLE", "PATH", "GOAL", "START")}
    page = Template((folder / "page.html").read_text(encoding="utf-8")).substitute(parts)
    digest = base64.b64encode(hashlib.sha256(f"\n{script}\n".encode()).digest()).decode()
    policy = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data: blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return page, policy
