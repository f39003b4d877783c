"""Verdicts on contacts: each reason by itself, on a ball whose contacts are known."""

from dataclasses import replace

import numpy as np
import pytest
from beliefs import belief

from fit.arrays import rows_of
from fit.revolution.geometry import RevolutionBody
from fit.superquadric.geometry import Superquadric, superquadric_points
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.contact_verdict import (
    accepted_contacts,
    accepted_rms,
    contact_verdicts,
    doubted,
    mean_contradiction,
    refuted,
    unexplained,
)
from strategies.recovery.evidence import Evidence, no_evidence

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


def test_fingertips_taken_for_contacts_are_accepted_where_they_are_near() -> None:
    """They are as unsure in all directions: no torques say where along a link they are."""
    tips = touched()
    tips = replace(tips, covariance_m2=np.tile(0.006**2 * np.eye(3), (*tips.mask.shape, 1, 1)))
    assert (contact_verdicts(ball(), tips) == "accepted").all()
    off = replace(tips, points_m=touched(0.008).points_m)
    assert (contact_verdicts(ball(), off) == "far").all()


def test_a_touch_of_a_pad_may_lie_as_far_as_one_that_counts() -> None:
    far = touched(0.008)
    assert not accepted_contacts(ball(), far).any()
    assert accepted_contacts(ball(), replace(far, by_pad=np.ones_like(far.mask))).all()


def test_the_prior_explains_nothing() -> None:
    assert not accepted_contacts(ball(Shape.PRIOR), touched()).any()
    assert np.isnan(accepted_rms(ball(Shape.PRIOR), touched())).all()


@pytest.mark.parametrize(("away_mm", "section", "tried", "replaced"), [
    (1.0, 1.0, False, False), (1.8, 1.0, True, False), (1.8, 0.1, False, False),
    (3.0, 1.0, True, True), (3.0, 0.1, False, True)])
def test_a_round_body_is_doubted_before_one_with_faces(
        away_mm: float, section: float, tried: bool, replaced: bool) -> None:
    """Contacts on a body that is larger all around by so much."""
    def body(more_m: float) -> Superquadric:
        return Superquadric(
            np.array([[0.04, 0.04, 0.06]]) + more_m, np.array([[0.2, section]]),
            np.array([[0.45, 0.0, 0.06]]), np.array([[0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 2)),
            np.zeros((1, 2)))

    points = superquadric_points(body(away_mm / 1e3), 150)
    count = points.shape[1]
    felt = Evidence(points, np.ones((1, count), bool), np.zeros((1, count, 3, 3)),
                    np.zeros((1, count, 3)), np.zeros((1, 0, 3)), 0.0, np.zeros((1, 0), bool),
                    np.zeros((1, count), bool), np.zeros((1, count)))
    recovered = Recovered(np.array([Shape.SUPERQUADRIC]), body(0.0))
    assert doubted(recovered, felt)[0] == tried
    assert unexplained(recovered, felt)[0] == replaced


@pytest.mark.parametrize(("pads_off_m", "fingers_off_m", "replaced"), [
    (0.0005, 0.004, False), (0.004, 0.0005, True), (None, 0.004, True)])
def test_a_contour_is_judged_by_what_pads_felt(
        pads_off_m: float | None, fingers_off_m: float, replaced: bool) -> None:
    """A cylinder of revolution, touched on its wall."""
    wall = RevolutionBody(np.array([[0.45, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]),
                          np.array([[0.0, 0.1]]), np.array([[0.03, 0.03]]))
    none = rows_of(ball().superquadric, np.array([0]))
    recovered = Recovered(np.array([Shape.REVOLUTION]), none, wall)
    angle = np.linspace(0.0, 6.0, 40)
    by_pad = np.arange(40) < (0 if pads_off_m is None else 12)
    radius = 0.03 + np.where(by_pad, pads_off_m or 0.0, fingers_off_m)
    points = np.stack([0.45 + radius * np.cos(angle), radius * np.sin(angle),
                       np.linspace(0.02, 0.08, 40)], -1)[None]
    evidence = rows_of(belief(np.repeat(points, 2, 0)).evidence, np.array([0]))
    evidence = replace(evidence, by_pad=by_pad[None])
    assert unexplained(recovered, evidence)[0] == replaced


def test_torques_of_a_link_in_doubt_contradict_as_much_as_any() -> None:
    none = no_evidence(1, 0.0)
    felt = replace(none, points_m=np.zeros((1, 4, 3)), mask=np.array([[True, True, True, False]]),
                   contradiction=np.array([[1.0, np.inf, 100.0, 5.0]]))
    assert mean_contradiction(felt)[0] == pytest.approx((1.0 + 9.0 + 9.0) / 3.0)


@pytest.mark.parametrize(("contradicted", "off_m", "vague", "wrong"), [
    (30, 0.0, False, True), (30, 0.02, False, True), (28, 0.0, False, True),
    (24, 0.0, False, False),  # six agree
    (0, 0.0, True, False), (10, 0.0, True, False),  # hardly any place is known
    (16, 0.0, True, True), (0, 0.02, False, False),
])
def test_contacts_refute_a_body_that_most_contradict_and_hardly_any_confirms(
        contradicted: int, off_m: float, vague: bool, wrong: bool) -> None:
    felt = touched(off_m)
    contradiction = np.where(np.arange(30) < contradicted, [[50.0], [np.inf]], 1.0)
    sigma = 0.01 if vague else 0.001
    felt = replace(felt, contradiction=contradiction,
                   covariance_m2=np.tile(np.diag([0.001, 0.001, sigma])**2, (2, 30, 1, 1)))
    assert refuted(ball(), felt).tolist() == [wrong, wrong]
    alone = rows_of(felt, np.array([1]))
    assert refuted(rows_of(ball(), np.array([1])), alone).tolist() == [wrong]


def test_neither_pads_nor_the_lack_of_contacts_refute_a_body() -> None:
    felt = touched(0.02)
    pads = replace(felt, by_pad=np.ones_like(felt.mask), contradiction=np.zeros(felt.mask.shape))
    assert not refuted(ball(), pads).any()
    assert not refuted(ball(), replace(felt, mask=np.zeros_like(felt.mask))).any()
