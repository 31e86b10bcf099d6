"""Planning among moving obstacles: paths that pass before or behind them, certified in space and time.

A robot of a stated speed is at cost c (:attr:`trailmark.Path.cost`) of its path at time c / speed. What stands is
avoided as ever; of each moving obstacle (:class:`trailmark.moving.Moving`) the path is clear at each time up to the
obstacle's horizon, or until the robot arrives. Nothing is claimed beyond either. Where the path meets an obstacle, the
robot gives way by short straight steps, sought in space and time, and goes on from there along the path among what
stands (:mod:`trailmark.planning.space_time.search`).
"""
