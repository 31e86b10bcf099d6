"""Debian's chromium without a window: what a page looks like there, and what it complains about."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tempfile
from functools import cache
from html import escape, unescape
from pathlib import Path
from typing import Any

import pytest

__all__ = ["browse", "probe", "require_chromium"]

QUIET = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--mute-audio"),
    *("--disable-background-networking", "--disable-component-update", "--disable-default-apps", "--disable-sync"),
    *("--disable-extensions", "--disable-dev-shm-usage", "--no-default-browser-check", "--metrics-recording-only"),
)
SCRIPT = """
document.querySelectorAll('details').forEach(d => { d.open = true; });
const charts = [...document.querySelectorAll('svg.chart')].map(svg => {
  const box = svg.getBoundingClientRect();
  const marks = [...svg.querySelectorAll('.mark')].filter(m => {
    const b = m.getBBox(), style = getComputedStyle(m);
    return b.width + b.height > 1 && (style.stroke !== 'none' || style.fill !== 'none');
  });
  const texts = [...svg.querySelectorAll('text')].map(t => t.getBoundingClientRect());
  const scale = box.width / svg.viewBox.baseVal.width;
  return {kind: svg.getAttribute('class'), label: svg.getAttribute('aria-label'), marks: marks.length,
    letters: Math.min(...texts.map(t => t.height)), scale: scale,
    outside: texts.filter(t => t.left < box.left - 2 || t.right > box.right + 2).length,
    x: box.left + scrollX, y: box.top + scrollY, width: box.width, height: box.height};
});
const tables = [...document.querySelectorAll('.scroll')].map(s => ({
  box: s.clientWidth, table: s.querySelector('table').scrollWidth, overflow: getComputedStyle(s).overflowX}));
window.probed = {width: innerWidth, page: document.documentElement.scrollWidth,
  height: document.documentElement.scrollHeight, charts: charts, tables: tables};
"""


def require_chromium() -> str:
    """Return the program, or skip the test."""
    found = shutil.which("chromium")
    if found is None:
        pytest.skip("Debian's chromium is not installed")
    return found


def browse(page: Path, *options: str, width: int = 1280, height: int = 900) -> subprocess.CompletedProcess[str]:
    """Open a page with a profile that nobody has used, and wait until the browser is done with it."""
    program = require_chromium()
    # Chromium's helpers may write into the profile while it goes.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = [
            program,
            *QUIET,
            f"--user-data-dir={profile}",
            f"--window-size={width},{height}",
            *options,
            page.as_uri(),
        ]
        return subprocess.run(words, capture_output=True, text=True, check=True, timeout=120)


@cache
def probe(page: Path, width: int) -> dict[str, Any]:
    """Return the sizes of what the page draws at a width (pixels), all of it unfolded.

    The page is looked at in a frame, since no window can be as narrow as a phone; a script that it does not have
    itself is put into a copy.
    """
    text = page.read_text()
    text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
    text = text.replace("</body>", f"<script>{SCRIPT}</script></body>")
    frame = f'<iframe style="border:0;width:{width}px;height:900px" srcdoc="{escape(text)}"></iframe>'
    inside = "document.querySelector('iframe').contentWindow.probed"
    tell = f"document.querySelector('pre').textContent = JSON.stringify({inside})"
    copy = page.with_name(f"{page.stem}-{width}.html")
    copy.write_text(f'<!DOCTYPE html><meta charset="utf-8"><body onload="{tell}"><pre></pre>{frame}')
    dumped = browse(copy, "--dump-dom").stdout
    found = re.search(r"<pre>(.*?)</pre>", dumped, re.DOTALL)
    assert found is not None
    probed: dict[str, Any] = json.loads(unescape(found[1]))
    return probed
