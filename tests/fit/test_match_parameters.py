"""Recognition by parameters, by profile, by faces; and of what is not in the catalogue."""

import numpy as np
import pytest
from quality_bodies import touches

from fit.interpretation_tree import block_model, interpret
from fit.match_parameters import (
    NONE,
    Entry,
    ProfileEntry,
    entry_of_fit,
    recognize_parameters,
    recognize_profile,
)
from fit.revolution.fit import fit_revolution
from fit.rotation import matrix_of_quaternion
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import superquadric
from fit.superquadric.uncertainty import superquadric_uncertainty

CATALOGUE = [
    Entry("block", (0.03, 0.04, 0.06), (0.1, 0.1)),
    Entry("large cylinder", (0.035, 0.035, 0.06), (0.1, 1.0)),
    Entry("small cylinder", (0.02, 0.02, 0.045), (0.1, 1.0)),
    Entry("ball", (0.03, 0.03, 0.03), (1.0, 1.0)),
]


def test_parameters_name_the_object_or_none() -> None:
    rng = np.random.default_rng(0)
    strange = Entry("", (0.015, 0.09, 0.02), (0.3, 1.6))
    bodies = [*CATALOGUE, strange]
    body = superquadric([e.size_m for e in bodies], [e.exponents for e in bodies],
                        [[0.45, 0, e.size_m[2]] for e in bodies])
    points = touches(body, 60, 1e-3, rng)
    fit = fit_superquadric(points, table_z=0.0)
    known = superquadric_uncertainty(fit, points, table_z=0.0)
    answers = recognize_parameters(fit, known.covariance, CATALOGUE)
    assert [a[0].name for a in answers] == [e.name for e in CATALOGUE] + [NONE]
    assert all(sum(c.probability for c in a) == pytest.approx(1) for a in answers)
    own = entry_of_fit("felt before", fit, 4)
    again = recognize_parameters(fit[4:5], known.covariance[4:5], [*CATALOGUE, own])
    assert again[0][0].name == "felt before"


def test_profiles_name_the_bottle_or_none() -> None:
    rng = np.random.default_rng(1)
    bottles = [ProfileEntry("wine", (0.0, 0.18, 0.22, 0.3), (0.037, 0.037, 0.014, 0.014)),
               ProfileEntry("coke", (0.0, 0.08, 0.15, 0.2), (0.03, 0.028, 0.018, 0.012)),
               ProfileEntry("can", (0.0, 0.1, 0.115), (0.033, 0.033, 0.03))]
    vase = ProfileEntry("", (0.0, 0.05, 0.2), (0.01, 0.06, 0.02))
    sets = []
    for entry in [*bottles, vase]:
        z = rng.uniform(0.05, 1, 80) * entry.height_m[-1]
        r, turn = np.interp(z, entry.height_m, entry.radius_m), rng.uniform(-np.pi, np.pi, 80)
        sets.append(np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1))
    points = np.array(sets) + 1e-3 * rng.normal(size=(4, 80, 3))
    answers = recognize_profile(fit_revolution(points, table_z=0.0), bottles)
    assert [a[0].name for a in answers] == ["wine", "coke", "can", NONE]


def test_faces_find_the_block_and_its_pose_and_not_another() -> None:
    rng = np.random.default_rng(2)
    model = block_model("block", (0.06, 0.08, 0.12))
    other = block_model("brick", (0.03, 0.05, 0.2))
    q = rng.normal(size=4)
    turn = matrix_of_quaternion(q / np.linalg.norm(q))
    place = np.array([0.4, -0.1, 0.2])
    faces = [0, 1, 2, 3, 4, 5, 0, 2]
    local = np.array([0.3 * c[0] + 0.2 * c[1] + 0.1 * c[2] + 0.4 * c[3]
                      for c in (model.faces[f] for f in faces)])
    points = local @ turn.T + place + 5e-4 * rng.normal(size=(8, 3))
    normals = model.normals[faces] @ turn.T + 0.03 * rng.normal(size=(8, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = interpret(points, normals, model)
    assert tuple(faces) in {f.assignment for f in found}
    # A block is its own half turn about each axis: four answers of equal worth.
    assert all(np.linalg.norm(f.position_m - place) < 2e-3 for f in found[:4])
    assert found[0].rms_m < 1.5e-3
    assert interpret(points, normals, other) == []


def test_normals_of_a_block_point_outwards() -> None:
    model = block_model("block", (0.06, 0.08, 0.12))
    for corners, normal in zip(model.faces, model.normals, strict=True):
        assert corners.mean(axis=0) @ normal > 0
