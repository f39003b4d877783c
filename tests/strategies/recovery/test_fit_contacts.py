"""Contacts placed anew against a body, and which bodies are begun anew between placements."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from reference_posterior import leaning
from scipy.spatial.transform import Rotation

from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import Superquadric, superquadric
from fit.superquadric.record import SuperquadricFit, SuperquadricOptions
from strategies.contacts.finger_touch import TouchedLinks, no_links
from strategies.recovery import fit_contacts as recovery
from strategies.recovery.body_distances import surface_distances
from strategies.recovery.evidence import Evidence
from strategies.recovery.fit_contacts import (
    FREE_BALLS,
    LAST_ITERATIONS,
    contacts_placed,
    recover_bodies,
)
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import FitTable, HandTable

RADIUS_M, OFF_M = 0.008, 0.004
BALL = superquadric([0.04, 0.04, 0.04], [1.0, 1.0], [0.45, 0.0, 0.1])


def ball_links(
    worlds: int = 3, contacts: int = 20, lean: float = 0.0, went: np.ndarray | None = None
) -> tuple[Evidence, TouchedLinks, np.ndarray]:
    """Contacts of last links with a ball, felt `OFF_M` too far out, the torques of a push of 1 N
    through each; also where they truly are. Torques by differences of the forward kinematics.

    The push leans by `lean`, along the surface any way, or along the way that the link slides after
    the step `went` (4,) of its command."""
    rng, hand, q = np.random.default_rng(4), HandTable(), np.array([0.1, 0.5, 0.6, 0.4])
    shape, n = (worlds, contacts), worlds * contacts

    turn = rng.uniform(-0.8, 0.8, n)[:, None]

    def frames(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A place on the last link's axis, its direction, and outward of it to each contact, hand
        frame, (row, 1 or contact, 3) for rows of joints."""
        every = np.repeat(joints[:, None], 4, axis=1)
        still = np.tile([0, 0, 0, 0, 0, 0, 1.0], (len(joints), 1))
        points, palmar = hand_links(hand, still, every)
        way, bend = (points[:, 1, 4] - points[:, 1, 3])[:, None], palmar[:, 1, 2][:, None]
        along = way / hand.link_length_m[2]
        return (points[:, 1, 3][:, None] + 0.4 * way, along,
                np.cos(turn) * bend + np.sin(turn) * np.cross(along, bend))

    def skin(joints: np.ndarray) -> np.ndarray:
        place, _, outward = frames(joints)
        return place + RADIUS_M * outward

    step = 1e-6
    slopes = (skin(q + step * np.eye(4)) - skin(q - step * np.eye(4))) / (2 * step)
    here, along, outward = (part[0] for part in frames(q[None]))
    aside = rng.uniform(-np.pi, np.pi, n)[:, None]
    way = np.cos(aside) * along + np.sin(aside) * np.cross(along, outward)
    if went is not None:
        # Beside `lean` servos, and so places, are soft: they slide.
        way = leaning(slopes.swapaxes(0, 1), outward, went, np.full(4, 0.5), lean)[0] / lean
    push = outward + lean * way
    hands = Rotation.random(n, rng=rng)
    normal = -hands.apply(outward)
    true = BALL.position_m[0] + 0.04 * normal
    place = true + RADIUS_M * normal - hands.apply(here)
    torque = -np.einsum("ni,jni->nj", push, slopes)  # the ball pushes the link back
    mask = np.ones(shape, bool)
    mask[:, -1] = False
    far = np.zeros((worlds, FREE_BALLS, 3))
    normal, true = normal.reshape(*shape, 3), true.reshape(*shape, 3)
    evidence = Evidence(
        true + OFF_M * normal, mask, np.tile(1e-6 * np.eye(3), (*shape, 1, 1)), normal,
        far, RADIUS_M, np.zeros(far.shape[:2], bool), np.zeros_like(mask), np.zeros(shape))
    links = replace(
        no_links(*shape, hand), linked=np.ones(shape, bool), finger=np.ones(shape, int),
        hand_pose=np.concatenate([place, hands.as_quat()], axis=1).reshape(*shape, 7),
        q_rad=np.tile(q, (*shape, 1)), link=np.full(shape, 2),
        torque_Nm=-torque.reshape(*shape, 4), torque_sigma_Nm=np.full((*shape, 4), 5e-4),
        step_rad=np.tile(np.zeros(4) if went is None else went, (*shape, 1)),
        weight=np.tile([0.1, 0.2, 0.7], (*shape, 1)))
    return evidence, links, true


def balls(worlds: int, size: float = 0.04) -> Superquadric:
    rows = Superquadric(*(np.repeat(field, worlds, axis=0) for field in BALL))
    return rows._replace(size_m=np.full((worlds, 3), size))


def test_contacts_are_put_where_torques_and_body_agree() -> None:
    evidence, links, true = ball_links()
    placed = contacts_placed(evidence, links, balls(3))
    assert np.linalg.norm(placed.points_m - true, axis=-1)[placed.mask].max() < 1.5e-3
    assert placed.contradiction[placed.mask].max() < 3.0
    away, _ = surface_distances(balls(3), placed.points_m, placed.mask)
    assert np.abs(away[placed.mask]).max() < 5e-4
    assert np.array_equal(placed.mask, evidence.mask)
    assert np.array_equal(placed.points_m[:, -1], evidence.points_m[:, -1])  # not felt


def test_forces_within_the_friction_cone_agree_with_the_body() -> None:
    evidence, links, true = ball_links(lean=0.5)  # it slides
    links = replace(links, torque_sigma_Nm=0.03 * np.abs(links.torque_Nm).max(-1, keepdims=True)
                    * np.ones(4))
    known = replace(links, friction=np.full(evidence.mask.shape, 0.5))
    placed = contacts_placed(evidence, known, balls(3))
    off = np.linalg.norm(placed.points_m - true, axis=-1)[placed.mask]
    assert off.max() < 4e-3
    assert np.median(placed.contradiction[placed.mask]) < 5.0
    # To a robot that expects a force along the normal the same torques contradict the body.
    slippery = contacts_placed(evidence, links, balls(3))
    assert np.median(slippery.contradiction[placed.mask]) > 10.0
    away = np.linalg.norm(slippery.points_m - true, axis=-1)[placed.mask]
    assert np.median(away) > 2.0 * np.median(off)


def test_forces_lean_along_the_way_that_links_slide_and_not_against_it() -> None:
    went = np.array([0.0, 0.02, 0.015, 0.01])
    found = {}
    for lean in (0.45, -0.45):
        evidence, links, true = ball_links(lean=lean, went=went)
        links = replace(links, friction=np.full(evidence.mask.shape, 0.5),
                        torque_sigma_Nm=0.03 * np.abs(links.torque_Nm).max(-1, keepdims=True)
                        * np.ones(4))
        placed = contacts_placed(evidence, links, balls(3))
        found[lean] = (np.median(placed.contradiction[placed.mask]),
                       np.median(np.linalg.norm(placed.points_m - true, axis=-1)[placed.mask]))
    assert found[0.45][0] < 2.0
    assert found[0.45][1] < 1e-3
    assert found[-0.45][0] > 4.0 * found[0.45][0]


def test_torques_that_contradict_the_body_are_told() -> None:
    """Of a finger that touched elsewhere: its joints are pushed the other way."""
    evidence, links, _ = ball_links()
    torque = links.torque_Nm.copy()
    torque[:, 0] *= -1.0
    placed = contacts_placed(evidence, replace(links, torque_Nm=torque), balls(3))
    assert (placed.contradiction[:, 0] > 100.0).all()
    assert placed.contradiction[:, 1:-1].max() < 3.0


def test_where_a_body_is_none_contacts_stay_where_they_are_felt() -> None:
    evidence, links, _ = ball_links()
    bodies = balls(3)
    bodies.size_m[1] = 0.0
    placed = contacts_placed(evidence, links, bodies)
    assert np.array_equal(placed.points_m[1], evidence.points_m[1])
    assert np.array_equal(placed.mask, evidence.mask)
    alone = contacts_placed(evidence, links, balls(3))
    assert np.array_equal(placed.points_m[[0, 2]], alone.points_m[[0, 2]])


@pytest.mark.slow
def test_early_bodies_are_begun_anew_only_where_they_are_doubted(
        monkeypatch: pytest.MonkeyPatch) -> None:
    evidence, links, _ = ball_links()
    asked: list[tuple[list[float], bool, int]] = []
    fit = recovery.fit_evidence

    def watched(some: Evidence, table: FitTable, *, start: SuperquadricFit | None = None,
                iterations: int = LAST_ITERATIONS) -> SuperquadricFit:
        asked.append((some.normals[:, -1, 0].tolist(), start is not None, iterations))
        return fit(some, table, start=start, iterations=iterations)

    monkeypatch.setattr(recovery, "fit_evidence", watched)
    monkeypatch.setattr(recovery, "doubt", lambda fits, placed: np.array([0.0, 1.0, 0.0]))
    recover_bodies(evidence, links, FitTable(rounds=4, rivals=False))
    one, two, three = evidence.normals[:, -1, 0].tolist()  # of an empty slot: it names its world
    assert asked == [([one, two, three], False, 0),
                     *[([two], False, 0), ([one, three], True, 0)] * 2,
                     ([one, two, three], True, 0), ([one, two, three], True, LAST_ITERATIONS)]


def test_a_rough_fit_is_near_and_says_that_it_has_not_converged() -> None:
    _, _, true = ball_links(contacts=60)
    options: dict[str, Any] = {"loss": "cauchy"}
    rough = fit_superquadric(true, options=SuperquadricOptions(iterations=0, **options))
    whole = fit_superquadric(true, options=SuperquadricOptions(**options))
    assert (rough.status == 1).all()
    assert (rough.iterations == 0).all()
    assert np.isfinite(rough.cost).all()
    assert np.allclose(rough.position_m, whole.position_m, atol=1e-3)
