"""Poses drawn in a kernel: beside the same draws made with NumPy's own functions."""

from dataclasses import replace

import numpy as np
import pytest

from fit.rotation import matrix_of_quaternion
from strategies.foresight.aimed_poses import (
    ABOUT_FELT,
    BESIDE_M,
    CLEARANCE_M,
    PALM_AWAY,
    STEEPEST_COS,
    draw_aimed_poses,
)
from strategies.foresight.hand_samples import samples_of_hand
from strategies.poses.waypoints import BoundingCylinder
from warpgrasp.core.random import counter_key, counter_uniform
from warpgrasp.parameters import HandTable

SAMPLES = samples_of_hand(HandTable(), ("curl40",))
REACH_M = 0.14
WORLDS, STEP, COUNT = 3, 5, 600
SEED = np.array([1, 2**63 + 5, 77], np.uint64)
DRAW = np.random.default_rng(2)
PRIOR = BoundingCylinder(0.45 + DRAW.normal(0, 0.01, WORLDS), DRAW.normal(0, 0.01, WORLDS),
                         DRAW.uniform(0.03, 0.07, WORLDS), DRAW.uniform(0.05, 0.20, WORLDS))
FELT = DRAW.random((WORLDS, 12)) < 0.4
FELT[1] = False
CONTACT_M = np.where(FELT[..., None], DRAW.normal([0.45, 0.0, 0.05], 0.03, (WORLDS, 12, 3)), np.nan)


def poses(worlds: slice = slice(None), count: int = COUNT) -> np.ndarray:
    prior = BoundingCylinder(PRIOR.x_m[worlds], PRIOR.y_m[worlds], PRIOR.radius_m[worlds],
                             PRIOR.height_m[worlds])
    return draw_aimed_poses(SEED[worlds], STEP, count, prior, CONTACT_M[worlds], FELT[worlds],
                            SAMPLES, REACH_M)


def lowest(pose: np.ndarray) -> np.ndarray:
    """Height of the lowest of all balls of the open hand at poses (..., 7), (...)."""
    down = matrix_of_quaternion(pose[..., 3:])[..., 2, :]
    return (down @ SAMPLES.open_m.T).min(-1) + pose[..., 2] - SAMPLES.radius_m


def expected(world: int) -> np.ndarray:
    """The poses of a world, by angles and their sines."""
    draw = counter_uniform(counter_key(
        int(SEED[world]), STEP, np.arange(COUNT)[:, None], np.arange(12)))
    angle, out = 2 * np.pi * draw[:, 0], np.sqrt(draw[:, 1])
    aim = np.stack([PRIOR.x_m[world] + PRIOR.radius_m[world] * out * np.cos(angle),
                    PRIOR.y_m[world] + PRIOR.radius_m[world] * out * np.sin(angle),
                    PRIOR.height_m[world] * draw[:, 2]], -1)
    felt = CONTACT_M[world, FELT[world]]
    if len(felt):
        beside = (felt[(draw[:, 1] * len(felt)).astype(int)]
                  + BESIDE_M * (2 * draw[:, 8:11] - 1))
        aim = np.where(draw[:, 11:] < ABOUT_FELT, beside, aim)
    around, roll = 2 * np.pi * draw[:, 4], 2 * np.pi * draw[:, 5]
    tilt = np.pi - np.arccos(1.0 - draw[:, 3] * (1.0 - STEEPEST_COS))
    sin, cos = np.sin(tilt / 2), np.cos(tilt / 2)
    turn = np.stack([sin * np.sin((roll - around) / 2), sin * np.cos((roll - around) / 2),
                     cos * np.sin((roll + around) / 2), cos * np.cos((roll + around) / 2)], -1)
    approach = np.stack([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around),
                         np.cos(tilt)], -1)
    place = aim - approach * REACH_M * (PALM_AWAY[0] + PALM_AWAY[1] * draw[:, 6:7])
    pose = np.concatenate([place, turn], -1)
    clear = CLEARANCE_M[0] + CLEARANCE_M[1] * draw[:, 7]
    pose[:, 2] += np.maximum(clear - lowest(pose), 0.0)
    return pose


def test_they_are_those_of_the_same_draws_by_angles() -> None:
    drawn = poses()
    for world in range(WORLDS):
        np.testing.assert_allclose(drawn[world], expected(world), rtol=0, atol=1e-12)
    assert (lowest(drawn) > CLEARANCE_M[0] - 1e-12).all()
    np.testing.assert_allclose(np.linalg.norm(drawn[..., 3:], axis=-1), 1.0, atol=1e-12)


def test_a_pose_depends_neither_on_other_worlds_nor_on_how_many_are_drawn() -> None:
    np.testing.assert_array_equal(poses(slice(2, 3), 50)[0], poses()[2, :50])


def test_before_anything_is_felt_they_aim_at_the_prior() -> None:
    none = draw_aimed_poses(SEED, STEP, COUNT, PRIOR, np.zeros((WORLDS, 0, 3)),
                            np.zeros((WORLDS, 0), bool), SAMPLES, REACH_M)
    np.testing.assert_allclose(none[1], expected(1), rtol=0, atol=1e-12)


def test_what_was_felt_is_told_by_flags() -> None:
    """Of numbers the sum was more contacts than there are: others were read from beyond."""
    with pytest.raises(TypeError, match="felt: is of int64; should be of bool"):
        draw_aimed_poses(SEED, STEP, 4, PRIOR, CONTACT_M, FELT * 5, SAMPLES, REACH_M)
    with pytest.raises(ValueError, match=r"contact_m: .* should be \(world 3, contact 12, 3\)"):
        draw_aimed_poses(SEED, STEP, 4, PRIOR, CONTACT_M[:, :5], FELT, SAMPLES, REACH_M)


@pytest.mark.parametrize("wrong", [SAMPLES.open_m[None], SAMPLES.open_m[:, :2],
                                   np.full_like(SAMPLES.open_m, np.nan)])
def test_the_open_hand_is_places(wrong: np.ndarray) -> None:
    """Of one dimension more, SciPy's hull ended the process."""
    with pytest.raises(ValueError, match="open_m: "):
        replace(SAMPLES, open_m=wrong)
