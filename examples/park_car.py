"""Park a car
==========

A robot with a turning radius drives forwards and backwards on Reeds-Shepp curves, each certified as a whole.
"""

import matplotlib.pyplot as plt

from trailmark import CurvePath, LandmarkPlanner, Robot, World

# %%
# 4.4 by 1.8 m, with a turning radius of 4.5 m; ``reverse=False`` makes a car that only drives forwards.
car = Robot.rectangle(4.4, 1.8).steered(4.5)
parking = World.load("parking").with_robot(car)
planner = LandmarkPlanner(parking, seed=0)

# %%
# A change of direction costs as much as 3 m by default, and a metre in reverse half a metre more.
figure, all_axes = plt.subplots(2, 1, figsize=(8, 8), layout="constrained")
for name, axes in zip(("bay", "parallel"), all_axes, strict=True):
    query = parking.query(name)
    result = planner.plan(query.start, query.pose(), time_limit=3.0)
    assert isinstance(result.path, CurvePath)
    print(f"{name}: {result.path.length:.2f} m, {result.path.cusps} changes of direction")
    print("  ", *result.path.curves.names())  # from knot to knot: left, straight or right, + forwards, - backwards
    result.plot(ax=axes)
    axes.set_title(name)
plt.show()
