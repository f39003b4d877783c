"""Grasps as evidence: which contacts count, which links are free, and how the robot stood."""

from types import SimpleNamespace

import numpy as np
import pytest

from strategies.contacts.finger_touch import touched_links
from strategies.recovery.evidence import FREE_SLACK_M, evidence_from_grasps
from warpgrasp.closing.contact_estimate import ContactEstimate
from warpgrasp.parameters import ContactTable, HandTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps

SHAPE = (1, 2, 1, 4)
"""World, probe, grasp, finger."""


def grasps(status: list[ProbeStatus], z_m: float = 0.1) -> Grasps:
    """Two probes; whatever belongs to finger f of probe p has the number 10 p + f in it."""
    number = 10.0 * np.arange(2)[None, :, None, None] + np.arange(4)
    point = np.stack([number, 0 * number, 0 * number + z_m], -1)
    weight = np.tile([1.0, 0.0, 0.0], (*SHAPE, 1))
    along = np.arange(4.0)  # joints one metre apart, along x
    links = np.stack([number[..., None] + along, np.zeros((*SHAPE, 4)), np.ones((*SHAPE, 4))], -1)
    estimate = ContactEstimate(
        point, np.tile(1e-6 * np.eye(3), (*SHAPE, 1, 1)), np.tile([0.0, 1.0, 0.0], (*SHAPE, 1)),
        np.where(number == 3, -1, 2), weight, np.repeat(number[..., None], 4, -1),
        np.ones((*SHAPE, 4)), np.zeros((*SHAPE, 4)), links)
    closing = SimpleNamespace(status=np.array(status).reshape(SHAPE),
                              q_rad=np.repeat(-number[..., None], 4, -1))
    pose = np.zeros((1, 2, 7))
    pose[0, :, 0] = 0.0, np.nan
    pose[0, 0] += 0.5
    return Grasps(SimpleNamespace(believed_pose=pose), closing, estimate,  # pyright: ignore
                  np.zeros((1, 2)), np.zeros((1, 4, 1, 4)))


FELT = [ProbeStatus.CONTACT] * 8


def test_contacts_count_that_were_felt_above_the_table() -> None:
    status = [ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT, ProbeStatus.SELF_CONTACT,
              ProbeStatus.CONTACT, ProbeStatus.NOT_TRIED, ProbeStatus.UNREACHABLE,
              ProbeStatus.COLLISION, ProbeStatus.CONTACT]
    felt = grasps(status)
    felt.estimate.point_m[0, 0, 0, 3] = np.nan
    found = evidence_from_grasps(felt, 0.008)
    assert np.flatnonzero(found.mask[0]).tolist() == [0, 7]
    assert found.points_m[0, [0, 7], 0].tolist() == [0.0, 13.0]
    assert (found.covariance_m2[0, 7] == 1e-6 * np.eye(3)).all()
    assert (found.covariance_m2[0, 1] == np.eye(3)).all()  # of a slot without a contact
    assert np.isnan(found.normals[0, 1]).all()
    assert not found.by_pad.any()
    for height_m, counts in ((0.0059, False), (0.0061, True)):  # 6 mm are taken for the table
        assert evidence_from_grasps(grasps(FELT, height_m), 0.008).mask.all() == counts


def test_a_contact_is_sure_where_best_place_and_most_places_are_on_one_link() -> None:
    felt = grasps(FELT)
    felt.estimate.link[:] = 0
    felt.estimate.link[0, 0, 0, 2] = 2
    felt.estimate.link_weight[0, 0, 0, 1] = 0.89, 0.11, 0.0
    found = evidence_from_grasps(felt, 0.008)
    assert np.flatnonzero(np.isinf(found.contradiction[0])).tolist() == [1, 2]


def test_links_of_fingers_that_closed_to_the_end_are_free() -> None:
    status = [ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT, ProbeStatus.SELF_CONTACT,
              ProbeStatus.BLOCKED, *[ProbeStatus.COLLISION] * 3, ProbeStatus.CONTACT]
    felt = grasps(status)
    felt.estimate.link_points_m[0, 1, 0, 3, 1] = np.nan  # two links end there
    found = evidence_from_grasps(felt, 0.008)
    assert found.free_radius_m == pytest.approx(0.008 - FREE_SLACK_M)
    free = found.free_mask[0].reshape(8, -1)
    places = found.free_m[0].reshape(8, -1, 3)
    assert free.any(1).tolist() == [True, True, True, False, False, False, False, True]
    for finger in (0, 1, 2):  # joints are one metre apart: their middles, and all but the first
        assert sorted(places[finger][free[finger], 0] - finger) == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    assert sorted(places[7][free[7], 0] - 13) == [2.0, 2.5, 3.0]


def test_a_contact_of_a_link_in_doubt_may_contradict_any_body() -> None:
    felt = grasps(FELT)
    felt.estimate.link_weight[0, 0, 0, 1] = 0.5, 0.4, 0.1
    felt.estimate.link_weight[0, 0, 0, 2] = 0.05, 0.0, 0.95
    felt.estimate.link[:] = felt.estimate.link_weight.argmax(-1)
    assert evidence_from_grasps(felt, 0.008).contradiction[0].tolist() == [0.0, np.inf, *[0.0] * 6]


def test_links_stand_in_the_order_of_the_points() -> None:
    felt, hand = grasps(FELT), HandTable()
    links = touched_links(felt, hand, ContactTable(friction=0.7))
    number = evidence_from_grasps(felt, 0.008).points_m[0, :, 0]
    assert number.tolist() == [0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0]
    assert links.linked.all()
    assert (links.finger[0] == number % 10).all()
    for values, wanted in ((links.torque_Nm, number), (links.q_rad, -number)):
        assert (values[0] == wanted[:, None]).all()
    assert links.torque_sigma_Nm.shape == (1, 8, 4)
    assert (links.hand_pose[0, :4] == 0.5).all()
    assert links.hand_pose[0, 4:, 0].tolist() == [0.0] * 4  # a pose that was not taken
    assert links.link[0].tolist() == [2, 2, 2, 0, 2, 2, 2, 2]  # none: 0
    assert (links.weight[0] == [1.0, 0.0, 0.0]).all()
    assert (links.friction == 0.7).all()
    assert links.hand is hand
