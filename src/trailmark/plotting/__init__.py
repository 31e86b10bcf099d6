"""Pictures of worlds and plans, by matplotlib; import this module only when a picture is asked for.

The ``draw_*`` functions draw on any matplotlib axes; the ``save_*`` functions lay out a figure of their own and
write it whole or not at all. No pyplot, hence no global state and no display. Colours are Okabe & Ito's
("Color Universal Design", 2008), which colour-blind readers tell apart; shape and line width repeat what colour says.
"""

from trailmark.plotting.animation import Frame, save_animation, save_trajectory_animation
from trailmark.plotting.canvas import PICTURE_SUFFIXES
from trailmark.plotting.exploration import (
    draw_exploration,
    save_exploration_animation,
    save_exploration_figure,
)
from trailmark.plotting.landmarks import save_landmarks_figure
from trailmark.plotting.plan import draw_audit, draw_plan, draw_progress, save_audit_figure, save_plan_figure
from trailmark.plotting.world import draw_world, save_world_figure
from trailmark.shown import EDGE, GOAL, LANDMARK, MARGIN, OBSTACLE, PATH, START

__all__ = [
    "EDGE",
    "GOAL",
    "LANDMARK",
    "MARGIN",
    "OBSTACLE",
    "PATH",
    "PICTURE_SUFFIXES",
    "START",
    "Frame",
    "draw_audit",
    "draw_exploration",
    "draw_plan",
    "draw_progress",
    "draw_world",
    "save_animation",
    "save_audit_figure",
    "save_exploration_animation",
    "save_exploration_figure",
    "save_landmarks_figure",
    "save_plan_figure",
    "save_trajectory_animation",
    "save_world_figure",
]
