"""Errors of the body that a free form stands about, against bodies that are moved and resized."""

from dataclasses import replace

import numpy as np
import pytest

from fit.implicit.volume import VolumeEstimate
from fit.revolution.geometry import RevolutionBody
from fit.superquadric.geometry import superquadric
from strategies.contacts.body_uncertainty import UNFELT
from strategies.contacts.felt import Felt
from strategies.reconstruct.body_errors import (
    TILT_RAD,
    ErrorsOfContours,
    ErrorsOfSuperquadrics,
    with_unfelt,
)
from strategies.reconstruct.prior_distance import revolution_distance, superquadric_distance

CAN = RevolutionBody(np.array([[0.45, 0.1, 0.0]]), np.array([[0.0, 0.0, 1.0]]),
                     np.array([[0.0, 0.06, 0.12, np.nan]]),
                     np.array([[0.03, 0.04, 0.03, np.nan]]))
ONE = np.zeros(1, int)


def sides(count: int = 40) -> np.ndarray:
    """Places outside the can, off its rims, (1, count, 3)."""
    draw = np.random.default_rng(2)
    angle, away = draw.uniform(0, 2 * np.pi, count), draw.uniform(0.041, 0.05, count)
    return np.stack([0.45 + away * np.cos(angle), 0.1 + away * np.sin(angle),
                     draw.uniform(0.02, 0.05, count)], 1)[None]


def test_errors_of_a_contour_are_those_of_moved_contours() -> None:
    at, found = sides(), ErrorsOfContours(CAN)(sides(), ONE)[0]
    assert found.shape == (40, 5 + 4)
    assert np.isfinite(found).all()
    here, wide = revolution_distance(CAN, at)[0], 0.04
    for axis in (0, 1):  # the two shifts span those along x and y
        shift = 1e-5 * np.eye(3)[axis]
        moved = (revolution_distance(replace(CAN, foot_m=CAN.foot_m + shift), at)[0] - here) / 1e-5
        left = np.linalg.lstsq(found[:, :2] / wide, moved, rcond=None)[1]
        assert np.sqrt(left / 40) < 0.01
    top = replace(CAN, axis=np.array([[1e-4, 0.0, 1.0]]) / np.hypot(1.0, 1e-4))
    leaned = (revolution_distance(top, at)[0] - here) / 1e-4
    assert np.sqrt(np.linalg.lstsq(found[:, 2:4] / TILT_RAD, leaned, rcond=None)[1] / 40) < 1e-3
    radius = CAN.radius_m + [[0.0, 1e-5, 0.0, 0.0]]
    grown = (revolution_distance(replace(CAN, radius_m=radius), at)[0] - here) / 1e-5
    assert np.allclose(found[:, 6], wide * grown, atol=1e-3 * wide)
    assert not found[:, 8].any()  # a node that there is not


def test_a_superquadric_that_was_not_touched_may_be_as_large_as_any() -> None:
    """But it stands on the table. Points about its middle, by bodies a little larger."""
    body = superquadric((0.03, 0.03, 0.06), (0.3, 1.0), (0.45, 0.0, 0.06))
    at = np.array([[[0.49, 0.0, 0.05], [0.45, 0.04, 0.07], [0.45, 0.0, 0.13]]])
    loose, stands = (ErrorsOfSuperquadrics(body, on_table)(at, ONE)[0] for on_table in (0, 1))
    larger = body._replace(size_m=body.size_m * (1 + 1e-6 * np.eye(3)[:1]))
    change = 1e6 * (superquadric_distance(larger, at) - superquadric_distance(body, at))[0]
    assert np.abs(change - [-0.03, 0.0, 0.0]).max() < 2e-3
    assert (np.linalg.norm(loose, axis=1) > 0.9 * np.abs(change)).all()
    assert np.linalg.norm(loose[0]) > 0.03  # its logarithm is uncertain by one
    foot = np.array([[[0.45, 0.0, 0.0]]])
    free, on = (np.linalg.norm(ErrorsOfSuperquadrics(body, on_table)(foot, ONE))
                for on_table in (False, True))
    assert on < 0.005 < 0.03 < free
    assert np.isfinite(stands).all()


def test_places_far_from_contacts_are_less_sure() -> None:
    surface = np.random.default_rng(0).uniform(0.02, 0.06, (1, 200, 3))
    contact = surface[:, :1]
    felt = Felt(contact, np.ones((1, 1), bool), np.zeros((1, 1, 3, 3)), np.zeros((1, 1), bool),
                np.zeros((1, 1), bool))
    known = VolumeEstimate(np.array([1e-4]), np.array([1e-6]), surface, np.full((1, 200), 0.001))
    found = with_unfelt(known, felt, np.array([0.02]))
    away = np.linalg.norm(surface[0] - contact[0], axis=1)
    assert np.allclose(found.surface_std_m[0], np.hypot(0.001, UNFELT * away))
    # Between errors that have nothing to do with each other and those that are all the same.
    least = 0.02 * UNFELT * np.sqrt((away**2).sum()) / 200
    most = 0.02 * UNFELT * away.mean()
    assert least < np.sqrt(found.std_m3[0] ** 2 - 1e-12) < most
    nowhere = with_unfelt(known, replace(felt, points_m=surface, mask=np.ones((1, 200), bool),
                                         contradicted=np.zeros((1, 200), bool)), np.array([0.02]))
    assert nowhere.std_m3[0] == pytest.approx(known.std_m3[0])
