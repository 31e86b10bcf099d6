"""The field of moving discs: its scenes, its judge of contact, and a drive that nobody but the judge approves."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.arena import CASES, drive, followed, foreseen
from benchmarks.arena_report import summary
from benchmarks.arena_scene import DISC_RADIUS, DISCS, SIZE, SPEED, Leg, Scene, first_contact
from numpy.typing import NDArray


def test_discs_stay_inside_the_walls_at_their_speed() -> None:
    scene, interval = Scene(3, (1.0, 1.0), 20.0), 0.01
    places = np.array([scene.at(t) for t in np.arange(0.0, 20.0, interval)])
    assert places.shape == (2000, DISCS, 2)
    assert places.min() >= DISC_RADIUS - 1e-9
    assert places.max() <= SIZE - DISC_RADIUS + 1e-9
    steps = np.hypot(*np.diff(places, axis=0).T)
    assert steps.max() <= SPEED * interval + 1e-9
    # Where a disc turns or bounces the chord is shorter.
    assert (np.abs(steps - SPEED * interval) < 1e-9).mean() > 0.95


def sampled(scene: Scene, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the discs are at some moments, shape (n, k, 2), all moments at once."""
    places = np.empty((len(times), DISCS, 2))
    for k, pieces in enumerate(scene.pieces):
        begin, end, x, y, vx, vy = np.array(pieces).T
        of = np.clip(np.searchsorted(begin, times, side="right") - 1, 0, None)
        assert (times <= end[of] + 1e-9).all()
        places[:, k] = np.column_stack([x, y])[of] + (times - begin[of])[:, None] * np.column_stack([vx, vy])[of]
    assert places[::400] == pytest.approx(np.array([scene.at(t) for t in times[::400]]))
    return places


@pytest.mark.slow
@pytest.mark.parametrize(("half", "radius"), [((0.0, 0.0), 0.3), ((0.6, 0.4), 0.0)])
def test_the_judge_agrees_with_a_fine_sample(half: tuple[float, float], radius: float) -> None:
    rng, met = np.random.default_rng(1), 0
    times = np.linspace(0.0, 5.0, 2001)
    for seed in range(16):
        scene = Scene(seed, (1.0, 1.0), 6.0)
        a, b = np.column_stack([rng.uniform(1.0, 31.0, (2, 2)), rng.uniform(-1.5, 1.5, 2)])
        x, y, theta = (a + times[:, None] / 5.0 * (b - a)).T[:, :, None]
        places = sampled(scene, times)
        dx, dy = places[..., 0] - x, places[..., 1] - y
        c, s = np.cos(theta), np.sin(theta)
        away = np.hypot(
            np.maximum(np.abs(c * dx + s * dy) - half[0], 0.0), np.maximum(np.abs(c * dy - s * dx) - half[1], 0.0)
        )
        met_at = (away < DISC_RADIUS + radius).any(axis=1)
        first = times[met_at.argmax()] if met_at.any() else np.inf
        found = first_contact(scene, [Leg(0.0, 5.0, a, b)], half, radius)
        met += found < np.inf
        assert found <= first + 1e-6
        if first < np.inf:
            assert found == pytest.approx(first, abs=0.03)
    assert 3 < met < 16


def test_a_disc_is_foreseen_off_the_wall() -> None:
    before, now = np.array([[30.0, 10.0]]), np.array([[30.2, 10.1]])
    found = foreseen(before, now, 0.1, 2.0, 0.2)
    moving, image = found["disc-0"], found["image-0"]
    assert moving.until == pytest.approx((SIZE - DISC_RADIUS - 30.2) / 2.0)
    assert moving.shape.bounding_box() == pytest.approx((30.2 - 0.9, 9.2, 30.2 + 0.9, 11.0))
    # At the bounce both are in one place; from there the image comes back.
    assert image.at(moving.until).bounding_box() == pytest.approx(moving.at(moving.until).bounding_box())
    assert image.velocity == pytest.approx((-2.0, 1.0))


def test_the_robot_follows_its_path_at_its_speed() -> None:
    states = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 3.0, 0.0]])
    legs = followed(states, 5.0, 1.0, 2.0)
    assert [leg.end for leg in legs] == pytest.approx([5.5, 6.0])
    assert legs[-1].b == pytest.approx([1.0, 1.0, 0.0])
    assert followed(states, 0.0, 3.0, 2.0)[-1].b == pytest.approx(states[-1])


@pytest.mark.slow
def test_a_drive_and_its_summary() -> None:
    drives = [drive(0, CASES["disc, 20 looks a second"])] * 2
    found = summary(drives)
    assert (found["scenes"], found["reached"], found["late"]) == (2, 2, 0)
    assert 10.6 <= found["seconds"] < 20.0
    assert sum(found["margins"]) == sum(len(d.looks) for d in drives)
