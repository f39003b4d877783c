"""What poses are expected to bring: beside the same, ball by ball, in plain Python."""

import numpy as np
import pytest

from fit.rotation import matrix_of_quaternion
from strategies.foresight.hand_samples import HandSamples, SweptFingers
from strategies.foresight.occupancy import CELLS, ON_TABLE_M, PLACES_APART, SURE, Occupancy
from strategies.foresight.prospect_kernel import MOST_FINGERS

RADIUS_M, LOWEST_M, CELL_M = 0.008, 0.02, 0.005
CORNER_M = np.array([[0.35, -0.10, 0.0], [0.30, -0.05, 0.0]])
WORLDS, POSES = 2, 23  # no multiple of the poses that are looked at side by side


def hand(draw: np.random.Generator) -> HandSamples:
    """Of three fingers, two of which meet; some balls feel nothing."""
    way = np.cumsum(draw.normal(0.0, 0.004, (3, 7, 4, 3)), axis=1)
    balls = way + draw.normal(0.0, 0.02, (3, 1, 4, 3)) + [0.0, 0.0, 0.08]
    swept = SweptFingers(balls, draw.random((3, 4)) < 0.8, np.zeros((3, 7, 1)),
                         np.array([4, 3, 7]), np.array([1, 0, -1]))
    balls = np.repeat(draw.normal([0.0, 0.0, 0.05], 0.03, (11, 3)), 9, axis=0)
    return HandSamples(balls, RADIUS_M, (swept,))


def scene() -> tuple[Occupancy, np.ndarray, np.ndarray, np.ndarray, HandSamples]:
    draw = np.random.default_rng(7)
    # Blocks of cells, so that fingers pass through some beliefs on their way to others.
    block = draw.random((WORLDS, 10, 10, 7)) ** 4
    block[:, 4, 4, :3] = 1.0
    hit = block.repeat(4, 1).repeat(4, 2).repeat(4, 3).reshape(WORLDS, -1)
    grid = Occupancy(CORNER_M, np.full(WORLDS, CELL_M), hit, RADIUS_M)
    grid.cap = draw.choice([0.2, 1.0], hit.shape, p=[0.1, 0.9]).astype(np.float32)
    worth = draw.random(hit.shape).astype(np.float32)
    turn = draw.normal(size=(WORLDS, POSES, 4))
    turn[:, ::2] = [1.0, 0.0, 0.0, 0.0] + 0.3 * turn[:, ::2]
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
    place = draw.normal([0.43, 0.0, 0.15], [0.05, 0.05, 0.03], (WORLDS, POSES, 3))
    wanted = draw.random((WORLDS, POSES)) < 0.8
    return grid, np.concatenate([place, turn], -1), wanted, worth, hand(draw)


def cell_of(grid: Occupancy, world: int, place: np.ndarray) -> int | None:
    """Number of the cell that holds a place; None outside."""
    at = np.floor((place - grid.corner_m[world]) / grid.cell_m[world]).astype(int)
    inside = (at >= 0).all() and (at < CELLS).all()
    return int(np.ravel_multi_index(at, CELLS)) if inside else None


def walked(grid: Occupancy, world: int, worth: np.ndarray, place_m: np.ndarray, feels: np.ndarray,
           most: float, share: float) -> tuple[float, float, list[tuple[float, np.ndarray]]]:
    """A finger followed along places (place, ball, 3): until where it was stopped, how surely, and
    the worth and place of every touch."""
    touches: list[tuple[float, np.ndarray]] = []
    for here in place_m:
        for ball, felt in zip(here, feels, strict=True):
            if ball[2] < RADIUS_M - ON_TABLE_M:
                return most, 1.0, touches
            at = cell_of(grid, world, ball)
            now = 0.0 if at is None else float(
                np.minimum(grid.hit[world, at], grid.cap[world, at])) ** 2
            if now > most:
                if felt and ball[2] > LOWEST_M:
                    touches.append((share * (now - most) * float(worth[world, at]), ball))
                most = now
        if most > SURE:
            return most, 1.0, touches
    return most, 0.0, touches


def expected(grid: Occupancy, samples: HandSamples, world: int, pose: np.ndarray,
             worth: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """How likely a pose is barred, and of each finger the gain and its likeliest place."""
    swept = samples.swept[0]
    turn = matrix_of_quaternion(pose[3:])
    gain, place = np.zeros(3), np.zeros((3, 3))
    likeliest, free = 0.0, 1.0
    for ball in samples.open_m @ turn.T + pose[:3]:
        if ball[2] < RADIUS_M:
            return 1.0, gain, place
        at = cell_of(grid, world, ball)
        if at is not None:
            now = float(np.minimum(grid.hit[world, at], grid.cap[world, at]))
            likeliest, free = max(likeliest, now), free * (1.0 - now)
    start = likeliest**2
    if start > SURE:
        return 1.0, gain, place
    ways = swept.balls_m @ turn.T + pose[:3]
    first = [walked(grid, world, worth, ways[f, :swept.met[f]], swept.feels[f], start, 1.0)
             for f in range(3)]
    for f, (most, done, touches) in enumerate(first):
        other = swept.meets[f]
        if other >= 0 and not done:
            touches = touches + walked(grid, world, worth, ways[f, swept.met[f]:], swept.feels[f],
                                       most, first[other][0])[2]
        gain[f] = sum(value for value, _ in touches)
        if gain[f] > 0.0:
            place[f] = max(touches, key=lambda touch: touch[0])[1]
    return max(likeliest, 1.0 - free ** (PLACES_APART / len(samples.open_m))), gain, place


def test_what_is_foreseen_is_what_the_balls_meet_one_by_one() -> None:
    grid, pose, wanted, worth, samples = scene()
    seen = grid.foresee(samples.open_m, samples.swept[0], pose, wanted, worth, LOWEST_M)
    open_poses = gainful = 0
    for world, number in np.ndindex(WORLDS, POSES):
        barred, gain, place = 1.0, np.zeros(3), np.zeros((3, 3))
        if wanted[world, number]:
            barred, gain, place = expected(grid, samples, world, pose[world, number], worth)
        open_poses += barred < 1.0
        gainful += int((gain > 0.0).sum())
        assert seen.barred[world, number] == pytest.approx(barred, abs=1e-6)
        np.testing.assert_allclose(seen.gain[world, number], gain, atol=1e-6)
        np.testing.assert_allclose(seen.place_m[world, number], place, atol=1e-9)
    assert open_poses > 15
    assert gainful > 20


def test_a_first_look_differs_in_leaving_out_places() -> None:
    grid, pose, wanted, worth, samples = scene()
    close, first = (grid.foresee(samples.open_m, samples.swept[0], pose, wanted, worth, LOWEST_M,
                                 closely=closely) for closely in (True, False))
    np.testing.assert_array_equal(first.gain, close.gain)
    np.testing.assert_array_equal(first.barred, close.barred)
    assert first.place_m.shape == (WORLDS, 0, 3, 3)


def test_a_hand_of_too_many_fingers_is_refused() -> None:
    grid, pose, wanted, worth, samples = scene()
    many = MOST_FINGERS + 1
    swept = SweptFingers(np.zeros((many, 2, 1, 3)), np.ones((many, 1), bool),
                         np.zeros((many, 2, 1)), np.full(many, 2), np.full(many, -1))
    with pytest.raises(ValueError, match=f"fingers {many}: wants 1 to {MOST_FINGERS}"):
        grid.foresee(samples.open_m, swept, pose, wanted, worth, LOWEST_M)
