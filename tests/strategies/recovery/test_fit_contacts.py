"""Contacts placed anew against a body, and which bodies are begun anew between placements."""

from typing import Any

import numpy as np
import pytest

from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import Superquadric, superquadric
from fit.superquadric.record import SuperquadricFit, SuperquadricOptions
from strategies.recovery import fit_contacts as recovery
from strategies.recovery.body_distances import surface_distances
from strategies.recovery.evidence import Evidence, TouchedLinks
from strategies.recovery.fit_contacts import (
    FREE_BALLS,
    LAST_ITERATIONS,
    contacts_placed,
    recover_bodies,
)
from warpgrasp.parameters import FitTable

RADIUS_M, OFF_M = 0.008, 0.004
BALL = superquadric([0.04, 0.04, 0.04], [1.0, 1.0], [0.45, 0.0, 0.1])


def ball_links(worlds: int = 3, contacts: int = 20) -> tuple[Evidence, TouchedLinks, np.ndarray]:
    """Contacts felt `OFF_M` too far out on links whose axes pass a ball at a link's radius; also
    where they truly are. The second link is the true one, the third lies far off."""
    rng = np.random.default_rng(4)
    normal = rng.normal(size=(worlds, contacts, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    along = np.cross(normal, rng.normal(size=normal.shape))
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    true = BALL.position_m[0] + 0.04 * normal
    axis = true + RADIUS_M * normal
    centre = np.stack([axis + 0.03 * normal, axis + OFF_M * along, axis + 0.1 * normal], axis=2)
    mask = np.ones((worlds, contacts), bool)
    mask[:, -1] = False
    far = np.zeros((worlds, FREE_BALLS, 3))
    evidence = Evidence(
        true + OFF_M * normal, mask, np.tile(1e-6 * np.eye(3), (worlds, contacts, 1, 1)), normal,
        far, RADIUS_M, np.zeros(far.shape[:2], bool), np.zeros_like(mask), normal)
    links = TouchedLinks(
        centre, np.repeat(along[:, :, None], 3, axis=2), np.full(centre.shape[:3], 1 / 3),
        np.full(centre.shape[:3], 0.01**2), RADIUS_M, np.ones(contacts, bool))
    return evidence, links, true


def balls(worlds: int, size: float = 0.04) -> Superquadric:
    rows = Superquadric(*(np.repeat(field, worlds, axis=0) for field in BALL))
    return rows._replace(size_m=np.full((worlds, 3), size))


def test_contacts_are_put_on_the_body_by_their_likeliest_link() -> None:
    evidence, links, true = ball_links()
    placed = contacts_placed(evidence, links, balls(3))
    # Where along a link that lies flat on it the body cannot say: that error stays, seen from it.
    assert np.linalg.norm(placed.points_m - true, axis=-1)[placed.mask].max() < OFF_M
    away, _ = surface_distances(balls(3), placed.points_m, placed.mask)
    assert np.abs(away[placed.mask]).max() < 5e-4
    assert np.array_equal(placed.mask, evidence.mask)
    assert np.array_equal(placed.points_m[:, -1], evidence.points_m[:, -1])  # not felt


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
    monkeypatch.setattr(recovery, "touch_misfit", lambda fits, placed: np.array([0.0, 1.0, 0.0]))
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
