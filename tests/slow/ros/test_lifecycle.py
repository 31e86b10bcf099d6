"""The node's life: transitions in every order, signals, a sudden death."""

from __future__ import annotations

import signal
import time
from itertools import product

import pytest
from tests.slow.ros.support import (
    CORNERS,
    FROM,
    LONG,
    SQUARE,
    TO,
    Client,
    collides,
    filled,
    grid,
    name_space,
    room,
    running,
    slit,
    states,
)

from bond.msg import Status  # isort: skip
from lifecycle_msgs.msg import Transition  # isort: skip

HERE, THERE = (2.0, 2.0, 0.3), (17.0, 10.0, -1.2)
CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE = 1, 2, 3, 4
ALLOWED = {
    ("unconfigured", CONFIGURE): "inactive",
    ("inactive", CLEANUP): "unconfigured",
    ("inactive", ACTIVATE): "active",
    ("active", DEACTIVATE): "inactive",
}


def test_transitions_in_every_order_do_what_the_standard_says() -> None:
    """And while it is not active, goals are refused."""
    space = name_space()
    with running(space, autostart=False, footprint=f"'{SQUARE}'") as node:
        client = Client(space)
        client.publish("map", grid(room()))
        beats = client.hear(Status, "bond")
        state = client.state()
        assert state == "unconfigured"
        pairs = product([CLEANUP, CONFIGURE, ACTIVATE, DEACTIVATE], repeat=2)
        orders = [CONFIGURE, ACTIVATE, *(one for pair in pairs for one in pair)]
        for transition in orders:
            after = ALLOWED.get((state, transition))
            assert client.change(transition) == (after is not None), (state, transition)
            state = after or state
            assert client.state() == state
            assert client.goal(THERE, HERE).accepted == (state == "active")
        while state != "active":
            state = {"unconfigured": "inactive", "inactive": "active"}[state]
            assert client.change(CONFIGURE if state == "inactive" else ACTIVATE)
        result = client.plan(HERE, THERE)
        assert result.error_code == 0, result.error_msg
        assert client.plan(HERE, THERE).error_code == 0
        beats.clear()
        client.until(lambda: len(beats) > 3)
        assert {(beat.id, beat.active, beat.instance_id) for beat in beats} == {
            ("planner_server", True, beats[0].instance_id)
        }
        assert client.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
        assert client.state() == "finalized"
        client.until(lambda: not beats[-1].active)
        assert node.end() in (0, 130)
        assert "Traceback" not in node.said()


def test_parameters_are_checked_before_it_is_configured_too() -> None:
    space = name_space()
    with running(space, autostart=False) as node:
        client = Client(space)
        assert len(client.set(footprint="a square", time_limit=-1.0, robot_radius=0.3)) == 2
        assert client.set(robot_radius=0.0) == []
        assert not client.change(CONFIGURE), "there is no footprint yet"
        assert client.set(robot_radius=0.3) == []
        assert client.change(CONFIGURE)
        assert len(client.set(footprint="a square", robot_radius=0.0)) == 2
        assert client.change(ACTIVATE)
        assert client.plan(HERE, THERE).error_msg == "expected a map first, got none yet"
        client.show(room())
        result = client.plan(None, THERE)
        assert result.error_code == result.TF_ERROR
        assert "amcl_pose" in result.error_msg
        assert client.plan(HERE, THERE).error_code == 0
        assert "Traceback" not in node.said()


def test_a_node_that_was_killed_gets_the_map_again_and_plans() -> None:
    space = name_space()
    client = Client(space)
    for again in (False, True):
        with running(space, footprint=f"'{SQUARE}'") as node:
            if not again:
                client.publish("map", grid(room()))
            result = None
            while result is None or result.error_code:  # goals to the dead one are lost
                result = client.plan(HERE, THERE, seconds=2.0)
            assert not collides(filled(states(result.path), 0.05), room(), CORNERS)
            assert node.end(signal.SIGKILL) == -signal.SIGKILL


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_without_a_traceback_while_it_plans(sign: int) -> None:
    space = name_space()
    with running(space, footprint=f"'{LONG}'", time_limit=600.0) as node:
        client = Client(space)
        client.show(slit())
        assert client.goal(TO, FROM).accepted
        client.spin(0.5)
        assert node.end(sign) in (0, 130)
        assert "Traceback" not in node.said(), node.said()


def test_a_signal_ends_it_without_a_traceback_while_it_starts() -> None:
    for delay in (1.2, 1.9, 2.6):
        with running(name_space(), footprint=f"'{SQUARE}'") as node:
            time.sleep(delay)
            sign = signal.SIGTERM if delay == 1.9 else signal.SIGINT
            status = node.end(sign)
            assert status in (0, 1, 130, -sign)
            assert status in (1, -sign) or "Traceback" not in node.said(), (delay, node.said())  # Python imported still


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({}, "footprint"),
        ({"footprint": "round"}, "round"),
        ({"robot_radius": -1.0}, "robot_radius"),
        ({"robot_radius": 1, "zones_file": "none.yaml"}, "none.yaml"),
    ],
)
def test_a_node_that_cannot_start_says_why_in_one_line(parameters: dict[str, object], reason: str) -> None:
    with running(name_space(), **parameters) as node:
        assert node.process.wait(60.0) == 2
        assert node.said().count("\n") == 1
        assert reason in node.said()
