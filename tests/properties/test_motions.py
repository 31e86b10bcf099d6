"""Motions of every kind: what is certified meets nothing anywhere, what is clearly free is certified.

Those that plan, check one motion a call, check what leaves the planner, and audit, share no code; shapely judges all.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracles import Oracle
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, box
from tests.properties.cases import DRIVES, Case, cases, driven, longest_step, motions

from trailmark import Robot, World, se2
from trailmark.collision import StateChecker, kernels
from trailmark.motion import CurveMotion, motion_of
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.planning.verification import WITHIN, Verification
from trailmark.shapes import Disc, Shape
from trailmark.trajectories import Path, path_of
from trailmark.verify import RIM, Verifier, check_path

SAMPLES = 150
"""Places of a motion that the oracle looks at."""


@pytest.mark.slow
@given(cases((1e5, -1e5)))
@settings(max_examples=few(90))
def test_certified_motions_meet_nothing_and_clear_ones_are_certified(case: Case) -> None:
    checker, motion = case.checker, case.motion
    a, b = motions(case, 60)
    if len(a) == 0:
        return
    accepted = motion.motions_valid(a, b)
    states = driven(motion, a, b, SAMPLES)
    flat = states.reshape(-1, 3)
    assert not case.oracle.collides(states[accepted].reshape(-1, 3)).any()
    # One that keeps a millimetre away everywhere, by what it may do between two places, is certified.
    room = case.oracle.clearance(flat).reshape(len(a), -1).min(axis=1) - 0.5 * longest_step(checker.robot, states)
    assert not (~accepted & (room >= checker.robot.clearance + 1e-3 * max(1.0, case.size))).any()
    assert np.array_equal(motion.motions_between_valid(a, b), accepted)
    proven = motion.motions_by_field(a, b)
    assert not (accepted & (proven == kernels.BLOCKED)).any()
    assert not (~accepted & (proven == kernels.FREE)).any()
    if checker.robot.drive != "differential":
        single = PointwiseChecker(checker, motion.steering if isinstance(motion, CurveMotion) else None)
        pairs = zip(a.tolist(), b.tolist(), strict=True)
        assert [single.motion_valid(tuple(p), tuple(q)) for p, q in pairs] == accepted.tolist()


@pytest.mark.slow
@given(cases((1e5, -1e5)))
@settings(max_examples=few(60))
def test_final_check_and_audit_find_what_collides_and_let_pass_what_is_certified(case: Case) -> None:
    checker, motion, oracle = case.checker, case.motion, case.oracle
    a, b = motions(case, 8)
    if len(a) == 0:
        return
    accepted = motion.motions_valid(a, b)
    plain = Oracle(checker.world, checker.robot.keeping(0.0))
    verifier, verification = Verifier(checker.world, checker.robot, RIM), Verification(checker, motion, seed=0)
    hits = np.any(oracle.collides(driven(motion, a, b, SAMPLES).reshape(-1, 3)).reshape(len(a), -1), axis=1)
    for ends, certified, hit in zip(np.stack([a, b], axis=1), accepted, hits, strict=True):
        path = path_of(motion, ends)
        fault = verifier.fault(path, *ends)
        assert not (certified and fault)
        dense = path.resample(4e-3 * case.size).states
        if hit or oracle.collides(dense).any():
            assert fault is not None
        # Audits leave the clearance that the robot keeps aside.
        collides = plain.collides(dense)
        audit = check_path(checker.world, checker.robot, path)
        assert audit.free or not certified
        assert not (audit.free and collides.any())
        assert audit.length == pytest.approx(path.length)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense[:, :2], axis=0).T))])
        between = longest_step(checker.robot, dense[None])[0] if len(dense) > 1 else 0.0
        if audit.free:
            least = oracle.clearance(dense).min()
            assert least - between - 5e-7 <= audit.min_clearance <= least + 1e-6
            told = verification.least_clearance(path)
            assert audit.min_clearance - 1e-6 <= told <= audit.min_clearance + WITHIN + 1e-6
            assert (fault is None) == (audit.min_clearance >= checker.robot.clearance) or abs(
                audit.min_clearance - checker.robot.clearance
            ) < 1e-5 * max(1.0, case.size)
            continue
        covered, near = np.zeros(len(dense), bool), 1e-3 * case.size
        for c in audit.collisions:
            assert c.depth > 0.0
            covered |= (along >= c.begin - near) & (along <= c.end + near)
        assert covered[collides].all()
        assert audit.min_clearance == 0.0
        assert audit.min_clearance_at == audit.collisions[0].begin
        if not isinstance(motion, CurveMotion):
            driving = verifier.motions(path)
            shares = np.concatenate([np.linspace(*c.motions, 9) for c in audit.collisions])
            number = np.minimum(shares.astype(int), len(path) - 2)
            inside = driving.poses(driving.place(number, shares - number))
            assert plain.clearance(inside).max() <= 1e-3 * max(1.0, case.size)


poses = st.tuples(st.floats(6.0, 14.0), st.floats(6.0, 14.0), st.floats(-math.pi, math.pi))


@pytest.mark.slow
@given(
    st.sampled_from(sorted(ROBOTS)),
    st.sampled_from(sorted(DRIVES)),
    poses,
    poses,
    st.integers(0, SAMPLES // 3 * 3 - 1),
    st.tuples(st.floats(0.01, 0.99), st.floats(0.01, 0.99)),
    st.sampled_from([1e-5, 1e-3]),
)
@settings(max_examples=few(120))
def test_no_needle_is_small_enough_to_be_missed(
    name: str,
    drive: str,
    a: tuple[float, float, float],
    b: tuple[float, float, float],
    at: int,
    where: tuple[float, float],
    size: float,
) -> None:
    """A speck anywhere that the robot passes over, at any moment: no sampling at a resolution would find it."""
    robot = DRIVES[drive](ROBOTS[name], 1.5)
    world = World("w", (-20.0, -20.0, 40.0, 40.0))
    ends = np.array([a, b])
    q = driven(motion_of(StateChecker(world, robot, cell=0.5)), ends[:1], ends[1:], SAMPLES)[0, at]
    # A point of the footprint at least a speck's size away from its outline: around the largest inscribed disc.
    inscribed = robot.inscribed_disc
    r, angle = 0.99 * where[0] * inscribed.radius, 2.0 * math.pi * where[1]
    x, y = se2.transform(q, np.add(inscribed.center, (r * math.cos(angle), r * math.sin(angle)))[None])[0]
    speck: Shape = Disc((x, y), size) if where[0] < 0.5 else box(x - size, y - size, x + size, y + size)
    checker = StateChecker(World("w", world.bounds, (speck,)), robot, cell=0.25)
    motion = motion_of(checker)
    assert not motion.motion_valid(a, b)
    if drive == "any way":
        # Half a turn goes another way back.
        assert not motion.motion_valid(b, a) or abs(se2.difference(a, b)[2]) == math.pi
    path = path_of(motion, ends)
    assert Verifier(checker.world, robot, RIM).fault(path, *ends) is not None
    assert not check_path(checker.world, robot, path).free
    if checker.valid(a) and checker.valid(b) and drive != "differential" and robot.drive != "differential":
        steering = motion.steering if isinstance(motion, CurveMotion) else None
        assert not PointwiseChecker(checker, steering).motion_valid(a, b)


TURNING = {
    "in place": (Robot.rectangle(2.0, 0.002), (1.0 - 1e-4, 0.0)),
    "on an arc": (Robot.rectangle(0.002, 2.0).steered(1.5), (0.0, 1e-4 - 1.0)),
    "small, on an arc": (Robot.rectangle(0.02, 0.02).steered(1.5), (0.0, 0.0)),
    "about a far point": (Robot.polygon([[0.99, -0.01], [1.01, -0.01], [1.01, 0.01], [0.99, 0.01]]), (1.0, 0.0)),
}
"""Robots, and what moves farthest of them: at R a radian in place, at 1 + R / radius a metre on an arc to the left."""


@pytest.mark.parametrize("share", [0.06, 0.14, 0.3, 0.7, 0.82, 0.9, 0.98])
@pytest.mark.parametrize("turn", [0.1, 0.6, -0.6, 3.0])
@pytest.mark.parametrize("name", TURNING)
def test_a_speck_that_only_the_tip_meets_is_found(name: str, turn: float, share: float) -> None:
    robot, (forward, left) = TURNING[name]
    radius = math.copysign(robot.turning_radius or 0.0, turn)
    at = [[radius * math.sin(t), radius * (1.0 - math.cos(t)), t] for t in (0.0, share * turn, turn)]
    start, passing, end = np.array(at)
    x, y = se2.transform(passing, np.array([[forward, math.copysign(left, left * turn)]]))[0]
    world = World("w", (-3.0, -2.0, 3.0, 4.5), (Disc((x, y), 1e-5),))
    motion = motion_of(StateChecker(world, robot, cell=0.004))  # so fine that its slack hides nothing
    assert motion.checker.states_free(np.array([start, end])).all() or name not in ("in place", "on an arc")
    assert not motion.motion_valid(start, end)
    path = path_of(motion, np.array([start, end]))
    assert Verifier(world, robot, RIM).fault(path, start, end) is not None
    assert not check_path(world, robot, path).free


@pytest.mark.slow
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["disc", "rectangle", "L", "thin"]),
    st.sampled_from([3e-6, 1e-5, 1e-3, 0.1]),
)
@settings(max_examples=few(60))
def test_an_obstacle_pushed_into_a_path_is_found(seed: int, name: str, depth: float) -> None:
    """Grazing from all sides: a disc beside a swept path, pushed in by a little more than the final check allows."""
    robot, rng = ROBOTS[name], np.random.default_rng(seed)
    states = np.array([[10, 10, rng.uniform(-3, 3)], [*rng.uniform(11, 15, 2), rng.uniform(-3, 3)]])
    path, angle = Path(states), rng.uniform(-3, 3)
    x, y = path.at(0.5)[:2] + 8.0 * np.array([math.cos(angle), math.sin(angle)])
    world = World("graze", (-20, -20, 40, 40), (Disc((float(x), float(y)), 1e-9),))
    gap = float(Oracle(world, robot).clearance(path.resample(1e-3).states).min()) + 1e-9
    for radius, found in ((gap - depth, False), (gap + depth + 2 * RIM, True)):
        world = World("graze", world.bounds, (Disc((float(x), float(y)), radius),))
        assert (Verifier(world, robot, RIM).fault(path, *states) is not None) == found
        assert check_path(world, robot, path).free != found
