"""Verdicts on contacts: each reason by itself, on a ball whose contacts are known."""

from dataclasses import replace

import numpy as np
import pytest
from beliefs import belief

from fit.superquadric.geometry import Superquadric
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.contact_verdict import accepted_contacts, accepted_rms, contact_verdicts

MIDDLE, RADIUS = np.array([0.45, 0.0, 0.1]), 0.04


def ball(shape: Shape = Shape.SUPERQUADRIC) -> Recovered:
    one = np.ones((2, 1))
    return Recovered(np.full(2, shape), Superquadric(
        size_m=np.full((2, 3), RADIUS), exponents=np.ones((2, 2)), position_m=one * MIDDLE,
        quaternion_xyzw=one * [0.0, 0.0, 0.0, 1.0], taper=np.zeros((2, 2)), bend=np.zeros((2, 2))))


def touched(off_m: float = 0.0):
    """Contacts all around the ball, `off_m` outside it, and their outward normals."""
    normal = np.random.default_rng(1).normal(size=(2, 30, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    evidence = belief(MIDDLE + (RADIUS + off_m) * normal).evidence
    return replace(evidence, normals=normal)


@pytest.mark.parametrize("off_m", [0.0, 0.004, -0.004])
def test_contacts_near_the_body_are_accepted_and_their_rms_is_their_distance(off_m: float) -> None:
    assert (contact_verdicts(ball(), touched(off_m)) == "accepted").all()
    assert accepted_rms(ball(), touched(off_m)) == pytest.approx(abs(off_m), abs=1e-6)


def test_each_reason_to_reject() -> None:
    evidence = touched()
    points, contradiction = evidence.points_m.copy(), evidence.contradiction.copy()
    points[0, 0] += 0.008 * evidence.normals[0, 0]
    contradiction[0, 1] = np.inf
    contradiction[0, 2] = 11.0
    mask = evidence.mask.copy()
    mask[0, 3] = False
    covariance = evidence.covariance_m2.copy()
    covariance[0, 4] = np.diag([0.0, 0.0, 0.004**2])
    found = contact_verdicts(ball(), replace(
        evidence, points_m=points, contradiction=contradiction, mask=mask,
        covariance_m2=covariance))
    assert found[0, :5].tolist() == ["far", "unsure_link", "contradicted", "", "unsure_place"]
    assert (found[0, 5:] == "accepted").all()
    assert (found[1] == "accepted").all()


def test_a_touch_of_a_pad_may_lie_as_far_as_one_that_counts() -> None:
    far = touched(0.008)
    assert not accepted_contacts(ball(), far).any()
    assert accepted_contacts(ball(), replace(far, by_pad=np.ones_like(far.mask))).all()


def test_the_prior_explains_nothing() -> None:
    assert not accepted_contacts(ball(Shape.PRIOR_CYLINDER), touched()).any()
    assert np.isnan(accepted_rms(ball(Shape.PRIOR_CYLINDER), touched())).all()
