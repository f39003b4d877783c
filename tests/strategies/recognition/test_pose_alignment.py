"""Bodies laid on touches by the kernel, against the same steps in NumPy."""

from pathlib import Path

import numpy as np
import pytest

from strategies.recognition.catalogue_alignment import Recognizer
from strategies.recognition.pose_alignment import placed_squares
from strategies.recognition.pose_alignment_kernel import CAP, ITERATIONS
from warpgrasp.core.kernel_launch import ShapeError
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.objects.catalogue import body_from_name, body_from_table

SIGMA_M = 0.002


def touches(body: Body, worlds: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    points = rng.uniform([-0.05, -0.05, 0.0], [0.05, 0.05, body.high_m[2]], (worlds, count, 3))
    for _ in range(3):
        distance, normal = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), points)
        points = points - distance[..., None] * normal
    points += rng.normal(0.0, SIGMA_M, points.shape)
    return points, rng.uniform(size=(worlds, count)) < 0.8


def laid(body: Body, start: float, turns: bool, points: np.ndarray, centre: np.ndarray) -> float:
    """The mean capped square of one world and one start."""
    def deviations(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, s = np.cos(pose[2]), np.sin(pose[2])
        x, y = points[:, 0] - pose[0], points[:, 1] - pose[1]
        local = np.stack([c * x + s * y, c * y - s * x, points[:, 2]], 1)
        distance, g = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), local[None])
        g = g[0]
        slope = np.stack([-(c * g[:, 0] - s * g[:, 1]), -(s * g[:, 0] + c * g[:, 1]),
                          g[:, 0] * local[:, 1] - g[:, 1] * local[:, 0]], 1)
        return distance[0], slope

    pose = np.array([*centre, start])
    for _ in range(ITERATIONS):
        distance, slope = deviations(pose)
        weight = 1 / (1 + (distance / SIGMA_M / CAP) ** 2) ** 2 / SIGMA_M**2
        jtj = (slope * weight[:, None]).T @ slope + np.diag([10.0, 10.0, 1e-3])
        step = np.linalg.solve(jtj, slope.T @ (weight * distance))
        pose = pose - np.clip(step, -0.3, 0.3) * [1, 1, turns]
    return float(np.minimum((deviations(pose)[0] / SIGMA_M) ** 2, CAP**2).mean())


def test_the_kernel_takes_the_steps_of_gauss_and_newton() -> None:
    bodies = [body_from_name("block"), body_from_name("wine_bottle")]
    turns = [np.array([0.1, 1.0]), np.zeros(1)]
    points, mask = touches(bodies[0], 3, 40)
    centre = np.array([[0.0, 0.0], [0.004, -0.003], [0.02, 0.01]])
    square = placed_squares(scene_of(bodies, "cpu"), turns, points, mask,
                            np.full(mask.shape, SIGMA_M), centre, device="cpu")
    wanted = [[min(laid(body, start, len(starts) > 1, points[w, mask[w]], centre[w])
                   for start in starts) for body, starts in zip(bodies, turns, strict=True)]
              for w in range(3)]
    assert np.allclose(square, wanted, rtol=1e-9)


def test_a_world_hangs_on_nothing_beside_it() -> None:
    bodies = [body_from_name("wedge")]
    points, mask = touches(bodies[0], 4, 60)
    arguments = points, mask, np.full(mask.shape, SIGMA_M), np.zeros((4, 2))
    whole, alone = (placed_squares(scene_of(bodies, "cpu"), [np.arange(6.0)],
                                   *(a[rows] for a in arguments), device="cpu")
                    for rows in (slice(None), slice(2, 3)))
    assert np.array_equal(whole[2:3], alone)


def test_only_turns_that_change_a_body_are_tried() -> None:
    square = {"name": "square", "compound": [{"shape": "block", "size_mm": [60, 60, 90]}]}
    known = Recognizer({"block": body_from_name("block"), "bottle": body_from_name("wine_bottle"),
                        "square": body_from_table(square, Path())})
    assert [len(starts) for starts in known.turns] == [6, 1, 3]


@pytest.mark.parametrize(("name", "points", "mask", "sigma"), [
    ("mask", 12, 10, 12), ("mask", 10, 12, 10), ("sigma_m", 12, 12, 10)])
def test_touches_and_what_belongs_to_them_are_as_many(
    name: str, points: int, mask: int, sigma: int
) -> None:
    scene = scene_of([body_from_name("block")], "cpu")
    with pytest.raises(ShapeError, match=f"'{name}'"):
        placed_squares(scene, [np.zeros(1)], np.zeros((2, points, 3)), np.ones((2, mask), bool),
                       np.ones((2, sigma)), np.zeros((2, 2)), device="cpu")


@pytest.mark.parametrize("count", [0, 2])
def test_turns_are_of_bodies_that_the_scene_has(count: int) -> None:
    scene = scene_of([body_from_name("block")], "cpu")
    with pytest.raises(ValueError, match=f"number of turns {count}: wants 1 to 1"):
        placed_squares(scene, [np.zeros(1)] * count, np.zeros((2, 4, 3)), np.ones((2, 4), bool),
                       np.ones((2, 4)), np.zeros((2, 2)), device="cpu")
