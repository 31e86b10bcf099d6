"""Chromium without a window, as a program: pages opened at any width, scripts run in them, pictures taken."""

from __future__ import annotations

import base64
import json
import os
import re
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from trailmark.world import World

__all__ = ["OPTIONS", "Browser", "browser", "program", "server"]

OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--mute-audio"),
    *("--disable-background-networking", "--disable-component-update", "--disable-default-apps", "--disable-sync"),
    *("--disable-extensions", "--disable-dev-shm-usage", "--no-default-browser-check", "--metrics-recording-only"),
)
LIMIT = 60.0  # seconds for any answer


@contextmanager
def server(world: World) -> Iterator[str]:
    """Serve a world with ``trailmark live``, and yield the page's address."""
    with tempfile.TemporaryDirectory() as folder:
        world.save(Path(folder) / "world.yaml")
        words = [sys.executable, "-m", "trailmark.cli", "live", f"{folder}/world.yaml", "--port", "0", "--no-browser"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
            try:
                found = re.search(r"http://\S+", process.stdout.readline())
                yield found[0]
            finally:
                process.terminate()


def program() -> str | None:
    """Return Debian's chromium; None where it is not installed."""
    return shutil.which("chromium")


@contextmanager
def browser() -> Iterator[Browser]:
    """Start chromium with a profile that nobody has used; it ends with the block.

    Raises:
        FileNotFoundError: it is not installed.
    """
    found = program()
    if found is None:
        raise FileNotFoundError("expected Debian's chromium, got no such program")
    # It reads from handle 3 and writes to handle 4 (its DevTools protocol, messages end with a zero byte).
    read, their_answers = os.pipe()
    their_orders, write = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = [found, *OPTIONS, f"--user-data-dir={profile}", "--remote-debugging-pipe", "about:blank"]
        shell = ["bash", "-c", f'exec "$0" "$@" 3<&{their_orders} 4>&{their_answers}', *words]
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(shell, pass_fds=(their_orders, their_answers), stdout=quiet, stderr=quiet)
        os.close(their_orders)
        os.close(their_answers)
        try:
            yield Browser(read, write)
        finally:
            os.close(write)
            os.close(read)
            process.terminate()
            process.wait(10.0)


class Browser:
    """A browser that is running.

    Args:
        read: handle of its answers.
        write: handle for orders.

    Attributes:
        complaints: what pages wrote to the console, errors that they did not catch, and what was refused them.
    """

    def __init__(self, read: int, write: int) -> None:
        self._read, self._write = read, write
        self._pending = b""
        self._number = 0
        self._events: list[str] = []
        self.complaints: list[str] = []
        target = next(t for t in self._ask("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self._ask("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        self._session: str | None = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._ask(f"{domain}.enable")
        self._ask("Emulation.setFocusEmulationEnabled", enabled=True)

    def open(self, page: Path | str, width: int, height: int = 900) -> None:
        """Open a file or address in a window (pixels), a phone's if it is narrow, and wait until it is loaded."""
        self._ask(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        self._events.clear()
        self._ask("Page.navigate", url=page if isinstance(page, str) else page.resolve().as_uri())
        while "Page.loadEventFired" not in self._events:
            self._take(time.monotonic() + LIMIT)

    def run(self, script: str) -> Any:
        """Return what an expression comes to in the page, or what it promises, as plain values.

        Raises:
            RuntimeError: the script failed.
        """
        done = self._ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in done:
            raise RuntimeError(json.dumps(done["exceptionDetails"]))
        return done["result"].get("value")

    def wait(self, script: str, seconds: float = LIMIT) -> Any:
        """Return what an expression comes to once it is true; one that fails is not true yet.

        Raises:
            TimeoutError: it is not.
        """
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if value := self.run(f"(() => {{ try {{ return {script}; }} catch {{ return null; }} }})()"):
                return value
            time.sleep(0.02)
        raise TimeoutError(f"expected {script} within {seconds:g} s; complaints: {self.complaints}")

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 10, pause: float = 0.016) -> None:
        """Drag the mouse from one place of the window to another, in so many steps, with seconds between them."""
        held = {"button": "left", "clickCount": 1}
        self._mouse("mouseMoved", start)
        self._mouse("mousePressed", start, buttons=1, **held)
        for i in range(1, steps + 1):
            at = (start[0] + (end[0] - start[0]) * i / steps, start[1] + (end[1] - start[1]) * i / steps)
            self._mouse("mouseMoved", at, buttons=1, **held)
            time.sleep(pause)
        self._mouse("mouseReleased", end, **held)

    def click(self, place: tuple[float, float], modifiers: int = 0) -> None:
        """Click at a place of the window; modifiers as for keys."""
        for kind in ("mousePressed", "mouseReleased"):
            self._mouse(kind, place, button="left", clickCount=1, modifiers=modifiers)

    def touch(self, *ways: tuple[tuple[float, float], tuple[float, float]], steps: int = 10) -> None:
        """Move a finger for each of some ways, from one place of the window to another, all at the same time."""
        for kind, shares in (("Start", [0.0]), ("Move", [(i + 1) / steps for i in range(steps)]), ("End", [None])):
            for share in shares:
                points = [
                    {"x": a[0] + (b[0] - a[0]) * share, "y": a[1] + (b[1] - a[1]) * share, "id": i}
                    for i, (a, b) in enumerate(ways)
                    if share is not None
                ]
                self._ask("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=points)
                time.sleep(0.016)

    def key(self, key: str, code: str = "", modifiers: int = 0) -> None:
        """Press a key and let it go; of the modifiers, 2 is Ctrl and 8 is Shift."""
        text = {"text": key} if len(key) == 1 and not modifiers & 2 else {}
        for kind, more in (("keyDown", text), ("keyUp", {})):
            self._ask("Input.dispatchKeyEvent", type=kind, key=key, code=code, modifiers=modifiers, **more)

    def _mouse(self, kind: str, place: tuple[float, float], **options: Any) -> None:
        self._ask("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], **options)

    def picture(self, file: Path) -> None:
        """Write what the window shows as PNG."""
        shot = self._ask("Page.captureScreenshot")
        file.write_bytes(base64.b64decode(shot["data"]))

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        order: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if getattr(self, "_session", None):
            order["sessionId"] = self._session
        os.write(self._write, json.dumps(order).encode() + b"\0")
        deadline = time.monotonic() + LIMIT
        while (answer := self._take(deadline)).get("id") != self._number:
            pass
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']['message']}")
        result: dict[str, Any] = answer["result"]
        return result

    def _take(self, deadline: float) -> dict[str, Any]:
        """Return the next message; events are noted."""
        while b"\0" not in self._pending:
            if not select.select([self._read], [], [], max(0.0, deadline - time.monotonic()))[0]:
                raise TimeoutError(f"expected an answer of chromium within {LIMIT:g} s, got none")
            chunk = os.read(self._read, 1 << 20)
            if not chunk:
                raise RuntimeError("chromium has ended")
            self._pending += chunk
        line, _, self._pending = self._pending.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        method = message.get("method", "")
        self._events.append(method)
        if method in ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled"):
            self.complaints.append(json.dumps(message["params"]))
        return message
