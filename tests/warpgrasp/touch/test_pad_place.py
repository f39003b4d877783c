"""The place that a pad tells: on the surface that is pressed into it, not on the pad's own."""

from dataclasses import replace

import numpy as np

from strategies.poses.postures import extended_finger, poking_pose
from warpgrasp.geometry.body import Body, Part
from warpgrasp.geometry.scene import Shape
from warpgrasp.mechanism.calibration import draw_calibration
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    ErrorTable,
    HandTable,
    PadTable,
    SensorTable,
)
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth
from warpgrasp.touch.line_touch import LineTouch
from warpgrasp.touch.tactile_image import moments

RADIUS_M, WORLDS = 0.03, 40
INWARD = np.array([1.0, 0.0, 0.0])
BALL = Body("ball", (Part(Shape.SPHERE, size_m=(RADIUS_M, 0.0, 0.0)),),
            (-RADIUS_M, -RADIUS_M, 0.0), (RADIUS_M, RADIUS_M, 2 * RADIUS_M))


KEY = np.arange(WORLDS).astype(np.uint64)
PADS = PadTable(noise_counts=0.0, gain_spread=0.0, repeatability=0.0, dead_fraction=0.0)


def poked(errors: ErrorTable, aside_m: float) -> LineTouch:
    """The ball touched by a robot that is exact but for these errors, up to `aside_m` from where
    it is nearest."""
    arm = ArmTable(encoder_step_rad=0.0, repeatability_m=0.0)
    truth = Truth(np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (WORLDS, 1)))
    robot = Robot([BALL], np.zeros(1, int), truth, KEY, arm, HandTable(),
                  SensorTable(joint_noise_rad=0.0), pads=PADS, errors=errors,
                  contact=ContactTable.none())
    rng = np.random.default_rng(0)
    place = np.stack([np.full(WORLDS, 0.45 - RADIUS_M - 0.008),
                      rng.uniform(-aside_m, aside_m, WORLDS),
                      RADIUS_M + rng.uniform(-aside_m, aside_m, WORLDS)], 1)
    one = extended_finger(robot.hand, PADS)
    poses = np.array([poking_pose(one, p, INWARD, np.array([0.0, 0.0, -1.0]))
                      for p in place])
    touch = robot.guarded_line(np.arange(WORLDS), poses, np.tile(INWARD, (WORLDS, 1)),
                               interval_m=0.001, steps=30, finger=0,
                               commands_rad=one.commands_rad)
    assert (touch.status == ProbeStatus.CONTACT).all()
    return touch


def test_a_ball_is_as_large_as_pads_tell() -> None:
    """A pad yields by some 0.1 mm; places on its own surface would lie that far in the ball."""
    touch = poked(ErrorTable.none(), 0.012)
    off = np.linalg.norm(touch.point_m - [0.45, 0.0, RADIUS_M], axis=1) - RADIUS_M
    assert abs(off.mean()) < 2.5e-5  # 1.2e-4 on the pad's own surface
    assert np.abs(off).max() < 6e-5


def test_a_pad_that_lies_elsewhere_feels_the_ball_elsewhere_on_it() -> None:
    """By as much the other way, along the link and across it."""
    errors = replace(ErrorTable.none(), pad_m=1e-3)
    shift = draw_calibration(errors, KEY).pad_shift_m[:, 0, 2]
    pitch = np.array([PADS.length_m, PADS.width_m]) / 16
    centres = [moments(poked(given, 0.0).image, level=3.0).centroid
               for given in (ErrorTable.none(), errors)]
    went = (centres[1] - centres[0]) * pitch
    assert np.abs(shift).max(0).min() > 1.5e-3
    np.testing.assert_allclose(went, -shift, atol=pitch.max() / 2)
