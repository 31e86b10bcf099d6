from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.ros.support import *

pytestmark = pytest.mark.slow

HERE, THERE = (2.0, 2.0, 0.3), (17.0, 10.0, -1.2)
CORNERS = np.array([[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]])


def test_a_path_is_free_from_its_start_to_its_goal(client: Any) -> None:
    result = client.plan(HERE, THERE)
    assert result.error_code == 0, result.error_msg
    path = states(result.path)
    assert np.allclose(path[[0, -1]], [HERE, THERE])
    assert not collides(filled(path, 0.02), room(), CORNERS)
    assert result.planning_time.sec + result.planning_time.nanosec > 0
    assert result.path.header.frame_id == "map"
