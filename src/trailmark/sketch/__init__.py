"""Sketches: small pictures of worlds, robots, roadmaps and plans as SVG, drawn without matplotlib, for notebooks."""

from trailmark.sketch.picture import html_of, svg_of
from trailmark.sketch.scene import Scene, scene_of

__all__ = ["Scene", "html_of", "scene_of", "svg_of"]
