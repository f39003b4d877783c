"""With friction the forces of fingers that stop lean as the contact estimate takes them to, so that
contacts are as far off as their covariances say."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from chain_closings import ALONE, QUIET, TABLE, close, poses_above
from reference_chain import ReferenceChain
from reference_posterior import affine_lever, sliding
from scipy.stats import chi2

from strategies.poses.chain_paths import chain_commands
from warpgrasp.chain.chain_hand import chain_of, hand_of_kind
from warpgrasp.chain_closing.chain_estimate import estimate_chain_contacts
from warpgrasp.finger.sliding import LEAN_MEAN, LEAN_SIGMA
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, ErrorTable, SensorTable

POSES = poses_above(40)
ROUGH = replace(ALONE, friction=0.5)


@pytest.mark.parametrize("path", ["curl40", "base_then_curl"])
@pytest.mark.parametrize("kind", ["allegro", "leap"])
def test_forces_lean_along_the_way_that_the_finger_slides(kind: str, path: str) -> None:
    """Solved for in NumPy, of all stops at which the true torques determine the force."""
    hand = chain_of(hand_of_kind(kind))
    commands = chain_commands(hand, path)
    contact = replace(ROUGH, weight=False)
    felt, truth = close(hand, "wine_bottle", POSES, commands, QUIET, contact)
    leans = []
    for i in map(tuple, np.argwhere((felt.status == 1) & (truth.link >= 0) & ~truth.on_table
                                    & (felt.step > 5))):
        finger, drives = i[3], len(hand.drives[i[3]])
        step = (commands[finger, felt.step[i]] - commands[finger, felt.step[i] - 1])[:drives]
        energy = ReferenceChain(body_from_name("block"), hand, TABLE, matrix_of(tuple(POSES[i[0]])),
                                finger, contact)
        capsule = list(hand.capsule_joint[finger]).index(truth.link[i])
        lever = affine_lever(partial(energy.lever, capsule, q=truth.q_rad[i][:drives]))(
            truth.point_m[i][None])
        torque = truth.torque_Nm[i][:drives]
        if np.linalg.svd(lever[0])[1][2] < 0.01:
            continue
        force = np.linalg.lstsq(lever[0], torque, rcond=None)[0]
        if np.linalg.norm(lever[0] @ force - torque) > 0.1 * np.linalg.norm(torque):
            continue
        out = -truth.normal[i]
        way = sliding(lever, out[None], step, np.full(drives, 0.5))[0]
        along = force - (force @ out) * out
        share = along / (0.5 * (force @ out))
        leans.append([share @ way, np.linalg.norm(share - (share @ way) * way)])
    along, across = np.transpose(leans)
    assert len(leans) >= 30
    assert abs(along.mean() - LEAN_MEAN) < 0.1
    assert along.std() < 1.2 * LEAN_SIGMA
    assert np.sqrt((across**2).mean() / 2.0) < 1.5 * LEAN_SIGMA


@pytest.mark.parametrize(("kind", "least"), [("allegro", 0.75), ("leap", 0.75), ("barrett", 0.6)])
def test_contacts_with_friction_are_as_far_off_as_their_covariances_say(kind: str, least: float
                                                                        ) -> None:
    """Eight of ten within the 90 % ellipsoid, as many as without friction; where forces lean any
    way, two thirds. Two torques, of a Barrett's finger, tell one link from another by their ratio
    alone, so that places lie on two links, and an ellipsoid is no good description."""
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
    assert np.concatenate(inside).mean() >= least
