"""With friction the forces of fingers that stop lean as the contact estimate takes them to, so that
contacts are as far off as their covariances say."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from chain_closings import ALONE, QUIET, TABLE, close, poses_above
from reference_chain import ReferenceChain
from reference_posterior import affine_lever, leaning
from scipy.stats import chi2

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain.chain_hand import chain_of, hand_of_kind
from warpgrasp.chain_closing.chain_estimate import estimate_chain_contacts
from warpgrasp.finger.sliding import LEAN_ASIDE
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, ErrorTable, SensorTable

POSES = poses_above(40)
ROUGH = replace(ALONE, friction=0.5)


@pytest.mark.parametrize("path", ["curl40", "base_then_curl"])
@pytest.mark.parametrize("kind", ["allegro", "leap"])
def test_forces_lean_as_the_place_sticks_or_slides(kind: str, path: str) -> None:
    """Solved for in NumPy, of all stops at which the true torques determine the force."""
    hand = chain_of(hand_of_kind(kind))
    commands = chain_commands(hand, path)
    contact = replace(ROUGH, weight=False)
    felt, truth = close(hand, "wine_bottle", POSES, commands, QUIET, contact)
    off, size = [], []
    for i in map(tuple, np.argwhere((felt.status == 1) & (truth.link >= 0) & ~truth.on_table
                                    & (felt.step > 5))):
        finger, drives = i[3], len(hand.drives[i[3]])
        q = truth.q_rad[i][:drives]
        joints = [hand.model.fingers[finger].joints[d] for d in hand.drives[finger]]
        free = np.array([joint.low_rad + 1e-3 < angle < joint.high_rad - 1e-3
                         for joint, angle in zip(joints, q, strict=True)])
        step = (commands[finger, felt.step[i]] - commands[finger, felt.step[i] - 1])[:drives]
        energy = ReferenceChain(body_from_name("block"), hand, TABLE, matrix_of(tuple(POSES[i[0]])),
                                finger, contact)
        capsule = list(hand.capsule_joint[finger]).index(truth.link[i])
        lever = affine_lever(partial(energy.lever, capsule, q=q))(truth.point_m[i][None])
        torque = truth.torque_Nm[i][:drives]
        if np.linalg.svd(lever[0])[1][2] < 0.01:
            continue
        force = np.linalg.lstsq(lever[0], torque, rcond=None)[0]
        if np.linalg.norm(lever[0] @ force - torque) > 0.1 * np.linalg.norm(torque):
            continue
        out = -truth.normal[i]
        ease = np.array([1.0 / joint.stiffness_Nm_rad for joint in joints])
        mean, _, _ = leaning(lever, out[None], step * free, ease * free, 0.5)
        share = force / (force @ out) - out
        off.append(np.linalg.norm(share - mean[0]) / 0.5)
        size.append(np.linalg.norm(share) / 0.5)
    assert len(off) >= 30
    assert max(size) < 1.01  # of the coefficient
    assert np.median(off) < LEAN_ASIDE
    assert np.quantile(off, 0.9) < 3.0 * LEAN_ASIDE


@pytest.mark.parametrize("kind", ["allegro", "leap", "barrett"])
def test_contacts_with_friction_are_as_far_off_as_their_covariances_say(kind: str) -> None:
    """Eight of ten within the 90 % ellipsoid, as many as without friction; where forces lean any
    way, two thirds."""
    hand, sensors = chain_of(hand_of_kind(kind)), SensorTable()
    commands = chain_commands(hand, "curl40")
    inside = []
    for name in ("block", "wedge", "wine_bottle"):
        felt, truth = close(hand, name, POSES, commands, sensors, ROUGH)
        found = estimate_chain_contacts(felt, POSES[:, None], commands[None], ArmTable(), hand,
                                        TABLE, sensors, errors=ErrorTable.none(), contact=ROUGH)
        at = (felt.status == 1) & (truth.link >= 0) & ~truth.on_table
        off = (found.point_m - truth.point_m)[at]
        solved = np.linalg.solve(found.covariance_m2[at], off[..., None])[..., 0]
        inside.append((off * solved).sum(-1) < chi2.ppf(0.9, 3))
    assert np.concatenate(inside).mean() >= 0.75
