"""Friction of a finger's skin: held until the force leaves the cone, then slid along."""

from dataclasses import replace

import numpy as np
import pytest
from closings import ALONE, HAND, body_of, close, poses_about

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from sweeps.validate.reference_finger import FingerEnergy
from warpgrasp.closing.closing import close_fingers
from warpgrasp.finger.friction import SHEAR
from warpgrasp.geometry.body import scene_of
from warpgrasp.parameters import ContactTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

BARE = ContactTable.none()
SHEAR_N_M = SHEAR * HAND.skin_stiffness_N_m
UNHELD_NM = 1e-5
"""What stops a finger is 0.06."""
CLOSE_N = 3e-3
"""Limits of friction are found within a millinewton."""


def followed(name: str, path: str, pose: np.ndarray, friction: float, steps: int) -> np.ndarray:
    """Joints of the four fingers where they rest on every command (step, finger, 4), none of which
    stops: each step is a closing of its own that ends there."""
    commands = np.repeat(closing_commands(CLOSING_PATHS[path])[None, :, :steps], steps, 0)
    _, truth = close_fingers(
        scene_of([body_of(name)], "cpu"), np.zeros(1, int), np.array([[0, 0, 0, 0, 0, 0, 1.0]]),
        HAND, SensorTable(tendon_threshold_N=1000.0, tension_noise_N=0.0), np.zeros(1, np.uint64),
        np.full((1, 1, steps), int(ProbeStatus.CONTACT)), pose[None, None], commands,
        np.arange(1, steps + 1), contact=replace(BARE, friction=friction))
    return truth.q_rad[0, 0]


def single_contacts(name: str, path: str, friction: float, count: int = 2, steps: int = 100):
    """Of fingers that touch at one place in two steps running: force of the skin along the surface
    before and now [N] (3,), normal force [N] now, and how far the skin went along it [m] (3,).

    From the joints alone: torques of the servos are those of the three parts of one force.
    """
    body = body_of(name)
    commands = closing_commands(CLOSING_PATHS[path])
    for pose in poses_about(body, count, 3):
        history = followed(name, path, pose, friction, steps)
        for finger in range(4):
            energy = FingerEnergy(body, HAND, pose, finger, BARE)
            before = None
            for s in range(steps):
                q = history[s, finger]
                state = energy.links(q)
                pressed = np.argwhere(state.depth_m > 0.0)
                if len(pressed) != 1:
                    before = None
                    continue
                link, what = pressed[0]
                n, depth = state.normal[link, what], state.depth_m[link, what]
                skin = state.point_m[link, what] - n * (HAND.link_radius_m - depth)
                lever = energy.lever(link, skin, q)
                torque = HAND.joint_stiffness_Nm_rad * (commands[finger, s] - q)
                force, *_ = np.linalg.lstsq(lever, -torque, rcond=None)
                np.testing.assert_allclose(lever @ force, -torque,
                                           atol=2e-4 + 1e-3 * np.abs(torque).max())
                along = force - n * (force @ n)
                normal = HAND.skin_stiffness_N_m * depth
                if link > 0:  # a proximal link has two joints: they do not tell three parts
                    if before is not None and before[0] == (link, what):
                        slid = (q - before[2]) @ lever
                        yield before[1], along, normal, slid - n * (slid @ n)
                    before = (link, what), along, q
                else:
                    before = None


@pytest.mark.parametrize(("name", "path"), [
    ("block", "base_then_curl"), pytest.param("capsule", "curl40", marks=pytest.mark.slow),
    pytest.param("small_cylinder", "base_then_curl", marks=pytest.mark.slow)])
def test_skin_holds_inside_the_cone_and_slides_on_its_edge(name: str, path: str) -> None:
    friction, held, slid = 0.5, 0, 0
    for before, along, normal, moved in single_contacts(name, path, friction):
        size, far = np.linalg.norm(along), np.linalg.norm(moved)
        assert size <= friction * normal + CLOSE_N
        if size < friction * normal - 2 * CLOSE_N:  # a spring: force is what it was stretched by
            assert np.linalg.norm(along - before + SHEAR_N_M * moved) < 0.05 * max(
                friction * normal, 0.1)
            held += 1
        elif far > 10 * friction * normal / SHEAR_N_M:
            assert along @ moved < -0.97 * size * far  # against its motion
            slid += 1
    assert held > 20
    assert slid > 20


@pytest.mark.parametrize("friction", [0.2, 1.0])
def test_a_rest_needs_no_force_outside_the_cone(friction: float) -> None:
    rested = 0
    contact = replace(ContactTable(self_contact=False), friction=friction)
    for name in ("block", "capsule", "large_cylinder"):
        body = body_of(name)
        poses = poses_about(body, 4, 8)
        for path in ("curl40", "base_then_curl"):
            felt, truth, commands = close(body, poses, path, 6.0, contact=contact)
            for i, f in np.argwhere(truth.link[:, 0, 0] >= 0):
                energy = FingerEnergy(body, HAND, poses[i], f, contact)
                q, command = truth.q_rad[i, 0, 0, f], commands[f, felt.step[i, 0, 0, f]]
                assert np.abs(energy.unheld(q, command)).max() < UNHELD_NM
                rested += 1
    assert rested > 40


def test_hardly_any_friction_is_none() -> None:
    """The step-by-step closing with friction ends where the one that skips steps does."""
    body = body_of("capsule")
    poses = poses_about(body, 40, 4)
    for path in ("curl40", "base_then_curl"):
        felt, truth, _ = close(body, poses, path, 6.0, noise=0.3, contact=ALONE)
        rubbed, there, _ = close(body, poses, path, 6.0, noise=0.3,
                                 contact=replace(ALONE, friction=1e-9))
        same = felt.step == rubbed.step
        # Where a finger slips off an edge, the one that skips steps may miss a stop.
        assert same.mean() > 0.98
        np.testing.assert_allclose(truth.q_rad[same], there.q_rad[same], atol=2e-6)


def test_friction_does_not_depend_on_the_batch() -> None:
    body = body_of("block")
    poses = poses_about(body, 12, 2)
    contact = replace(ContactTable(), friction=0.5)
    _, together, _ = close(body, poses, "base_then_curl", 6.0, contact=contact)
    _, alone, _ = close(body, poses[:5], "base_then_curl", 6.0, contact=contact)
    np.testing.assert_array_equal(together.q_rad[:5], alone.q_rad)
