"""The pictures of the README and the documentation that are kept as files: ``python docs/screens.py`` writes them.

The drive's animation is examples/changing_warehouse.py's, smaller, the picture of ROS 2's messages is
examples/ros2_planner.py's; the live page is photographed in headless Chromium.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

from matplotlib.colors import to_rgb
from PIL import Image, ImageSequence

from trailmark.shown import GOAL, LANDMARK, PATH

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
sys.path.insert(0, str(ROOT))
WIDTH, EVERY = 560, 2  # pixels, and of so many frames of the animation one is kept


def plans() -> None:
    """Write the pictures of paths, as ``plan --plot`` does."""
    office = ["office", "--drive", "differential", "--clearance", "0.05"]
    parking = ["parking", "--query", "bay", "--turning-radius", "4.5"]
    for name, words in (("office", office), ("parking", parking)):
        command = [sys.executable, "-m", "trailmark", "plan", *words, "--plot", str(PICTURES / f"{name}.png")]
        subprocess.run(command, check=True, cwd=ROOT)


def animations(folder: Path) -> None:
    """Write the drive in the warehouse and an exploration as GIFs of a README's width."""
    drive, explored = folder / "drive.gif", folder / "office"
    subprocess.run([sys.executable, ROOT / "examples" / "changing_warehouse.py", "8", drive], check=True, cwd=ROOT)
    smaller(drive, PICTURES / "warehouse.gif")
    words = ["explore", "office", "--sensor-range", "5", "--output", str(explored)]
    subprocess.run([sys.executable, "-m", "trailmark", *words], check=True, cwd=ROOT)
    smaller(explored / "exploration.gif", PICTURES / "exploration.gif")


def smaller(large: Path, file: Path) -> None:
    """Write an animation with fewer pixels and frames, in the pictures' colours."""
    with Image.open(large) as picture:
        size = (WIDTH, round(picture.height * WIDTH / picture.width))
        frames = [
            frame.convert("RGB").resize(size, Image.Resampling.LANCZOS)
            for number, frame in enumerate(ImageSequence.Iterator(picture))
            if number % EVERY == 0
        ]
    palette = frames[len(frames) // 2].quantize(250, dither=Image.Dither.NONE)
    # Of what is small, or not in that frame, the colours would be some others.
    own = [round(255.0 * part) for colour in (GOAL, PATH, LANDMARK) for part in to_rgb(colour)]
    palette.putpalette([*(palette.getpalette() or [])[:750], *own])
    flat = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    flat[0].save(file, save_all=True, append_images=flat[1:], duration=250, loop=0, optimize=True)


def messages(folder: Path) -> None:
    """Write the picture of what the ROS 2 node publishes, where there is a ROS 2."""
    if find_spec("rclpy") is None:
        print("ros2.png: not made anew, as there is no rclpy")
        return
    large = folder / "ros2.png"
    subprocess.run([sys.executable, ROOT / "examples" / "ros2_planner.py", large], check=True, cwd=ROOT)
    with Image.open(large) as picture:
        picture.convert("RGB").save(PICTURES / "ros2.png", optimize=True)


def live_page(folder: Path) -> None:
    """Write the live page as it is on a desk and on a phone, with the office."""
    from tests.helpers.chromium import browser, server

    from trailmark import World

    office = World.load("office")
    with server(office) as address, browser() as tab:
        for width, height in ((1400, 900), (390, 844)):
            tab.open("about:blank", width, height)
            tab.open(address, width, height)
            tab.wait("trailmark.scene.path")
            time.sleep(4.0)
            tab.picture(folder / "live.png")
            Image.open(folder / "live.png").save(PICTURES / f"live-{width}.webp", quality=82, method=6)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        plans()
        live_page(Path(scratch))
        animations(Path(scratch))
        messages(Path(scratch))
    for written in sorted(PICTURES.iterdir()):
        print(f"{written.name}: {written.stat().st_size / 1e3:.0f} kB")
