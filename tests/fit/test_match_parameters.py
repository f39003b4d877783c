"""Populations of shapes, probabilities of what is known and of what is not; polyhedra by faces."""

from itertools import chain

import numpy as np
import pytest
from scipy import stats

from fit.interpretation_tree import NULL, FaceModel, interpret_sets, model_of_planes
from fit.interpretation_tree import interpret as interpretations
from fit.match_parameters import (
    BROAD_COUNT,
    TAIL,
    Population,
    kernels_of,
    log_density,
    population_of,
    posterior,
)
from fit.polyhedron import polyhedron_faces
from fit.rotation import matrix_of_quaternion

WIDTH = 3


def drawn(rng, count: int, mean, scatter, noise: float):
    """Shapes of a population, measured with noise of very different sizes."""
    size = noise * rng.uniform(0.2, 2.0, (count, 1, 1))
    covariance = size**2 * np.eye(WIDTH)
    shapes = rng.multivariate_normal(mean, scatter, count)
    return shapes + size[:, :, 0] * rng.normal(size=(count, WIDTH)), covariance


def test_a_population_is_found_beneath_the_noise_and_in_spite_of_bad_recoveries() -> None:
    rng = np.random.default_rng(0)
    mean, scatter = np.array([1.0, -2.0, 0.5]), np.diag([0.04, 0.01, 0.09])
    shapes, covariance = drawn(rng, 400, mean, scatter, 0.3)
    shapes[:12] += 5.0
    found = population_of(shapes, covariance)
    assert np.allclose(found.mean, mean, atol=0.06)
    assert (np.diag(found.scatter) < 2.5 * np.diag(scatter)).all()
    assert (np.diag(found.scatter) > 0.4 * np.diag(scatter)).all()
    assert found.count == 400


def test_few_shapes_lean_on_the_common_scatter() -> None:
    shapes = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    none = np.zeros((2, WIDTH, WIDTH))
    found = population_of(shapes, none, common=np.eye(WIDTH))
    assert (np.diag(found.scatter) > 0.3).all()
    with pytest.raises(ValueError, match="none"):
        population_of(shapes[:0], none[:0])


def test_densities_are_those_of_scipys_student_t() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(WIDTH, WIDTH))
    one = Population(rng.normal(size=WIDTH), root @ root.T + np.eye(WIDTH), 8)
    shapes = rng.normal(size=(5, WIDTH))
    covariance = np.tile(0.3 * np.eye(WIDTH), (5, 1, 1))
    expected = stats.multivariate_t(one.mean, one.scatter * 9 / 8 + covariance[0], df=TAIL)
    assert np.allclose(log_density(shapes, covariance, one), expected.logpdf(shapes))


def test_unlike_objects_are_a_sum_of_kernels_beside_a_broad_density() -> None:
    rng = np.random.default_rng(2)
    bodies = np.repeat([4, 1, 9], 5)
    shapes = 10.0 * bodies[:, None] + 0.1 * rng.normal(size=(15, WIDTH))
    broad = population_of(shapes, np.zeros((15, WIDTH, WIDTH)))
    kernels = kernels_of(shapes, bodies, broad, common=np.eye(WIDTH))
    assert np.allclose(sorted(kernels.middles.tolist()), 10.0 * np.array([[1], [4], [9]]), atol=0.3)
    mixed = Population(broad.mean, broad.scatter, broad.count, kernels)
    covariance = np.tile(0.3 * np.eye(WIDTH), (15, 1, 1))
    density = BROAD_COUNT * np.exp(log_density(shapes, covariance, broad))
    for middle in kernels.middles:
        one = stats.multivariate_t(middle, kernels.scatter + covariance[0], df=TAIL)
        density += one.pdf(shapes)
    assert np.allclose(np.exp(log_density(shapes, covariance, mixed)), density / (3 + BROAD_COUNT))


def test_probabilities_are_bayes_rule_and_temperature_flattens_them() -> None:
    log = np.log([[0.2, 0.6, 0.1]])
    share = posterior(log, none_prior=0.2)
    expected = np.array([0.4 * 0.2, 0.4 * 0.6, 0.2 * 0.1])
    assert np.allclose(share, expected / expected.sum())
    flat = posterior(log, none_prior=0.2, temperature=1e9)
    assert np.allclose(flat, [[0.4, 0.4, 0.2]])
    nowhere = posterior(np.array([[-np.inf, -np.inf, -4.0]]), none_prior=0.2)
    assert np.allclose(nowhere, [[0, 0, 1]])


def block_model(name: str, size_m: tuple[float, float, float]) -> FaceModel:
    """A block of full size x, y, z [m] centred on the origin."""
    sides = np.eye(3).repeat(2, axis=0) * np.tile([1.0, -1.0], 3)[:, None]
    return model_of_planes(name, sides, np.repeat(size_m, 2) / 2)


def interpret(points, normals, model: FaceModel, most_null: int = 0):
    return interpretations(points, normals, model, angle_rad=0.2, distance_m=4e-3,
                           most_null=most_null)


def felt_block(seed: int, model):
    """Touches on eight places of a block, turned and moved."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=4)
    turn = matrix_of_quaternion(q / np.linalg.norm(q))
    place = np.array([0.4, -0.1, 0.2])
    faces = [0, 1, 2, 3, 4, 5, 0, 2]
    local = np.array([0.3 * c[0] + 0.2 * c[1] + 0.1 * c[2] + 0.4 * c[3]
                      for c in (model.faces[f] for f in faces)])
    points = local @ turn.T + place + 5e-4 * rng.normal(size=(8, 3))
    normals = model.normals[faces] @ turn.T + 0.03 * rng.normal(size=(8, 3))
    return faces, place, points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_faces_find_the_block_and_its_pose_and_not_another() -> None:
    model = block_model("block", (0.06, 0.08, 0.12))
    other = block_model("brick", (0.03, 0.05, 0.2))
    faces, place, points, normals = felt_block(2, model)
    found = interpret(points, normals, model)
    assert tuple(faces) in {f.assignment for f in found}
    # A block is its own half turn about each axis: four answers of equal worth.
    assert all(np.linalg.norm(f.position_m - place) < 2e-3 for f in found[:4])
    assert found[0].rms_m < 1.5e-3
    assert interpret(points, normals, other) == []
    local, offset = found[0].planes(points, normals)
    assert np.allclose(local, model.normals[list(found[0].assignment)], atol=0.15)
    half = np.repeat([0.03, 0.04, 0.06], 2)[list(found[0].assignment)]
    assert np.allclose(offset, half, atol=4e-3)


@pytest.mark.parametrize("seed", range(4))
def test_exact_touches_of_a_body_without_symmetry_are_told_by_their_faces(seed: int) -> None:
    """A box with four more cuts, whose opposite faces are not parallel."""
    rng = np.random.default_rng(seed)
    cuts = rng.normal(size=(4, 3))
    cuts /= np.linalg.norm(cuts, axis=1, keepdims=True)
    model = model_of_planes("cut", np.concatenate([np.eye(3), -np.eye(3), cuts]), np.append(
        np.tile([0.03, 0.04, 0.06], 2), rng.uniform(0.015, 0.03, 4)))
    faces = rng.permutation(len(model.faces))[:7]
    points = np.array([rng.dirichlet(np.ones(len(c))) @ c for c in (model.faces[f] for f in faces)])
    found = interpretations(points, model.normals[faces], model, angle_rad=0.05, distance_m=5e-4)
    assert tuple(faces) in {f.assignment for f in found}


@pytest.mark.parametrize(("points", "ways"), [
    ([[0.03, 0, 0], [0, 0.04, 0], [0, 0, 0.06]], [0, 1, 2]),
    ([[0.03, 0.035, 0], [0.03, -0.035, 0], [0, 0.04, 0], [0, 0, 0.06]], [0, 0, 1, 2])])
def test_each_normal_may_err_by_the_bound(points: list[list[float]], ways: list[int]) -> None:
    """Of two faces, or at two places of one, in opposite senses, so that they turn no pose."""
    model, bound = block_model("block", (0.06, 0.08, 0.12)), 0.2
    true, sense = np.eye(3)[ways], np.pad([1.0, -1.0], (0, len(ways) - 2))[:, None]
    for share, possible in ((0.95, True), (1.2, False)):
        turn = share * bound * sense
        normals = np.cos(turn) * true + np.sin(turn) * np.cross([0.0, 0.0, 1.0], true)
        found = interpretations(np.array(points), normals, model, angle_rad=bound, distance_m=1e-3)
        assert any(np.allclose(model.normals[list(f.assignment)], true) for f in found) == possible


def test_a_touch_of_something_else_is_left_over() -> None:
    model = block_model("block", (0.06, 0.08, 0.12))
    _, place, points, normals = felt_block(3, model)
    points[6], normals[6] = place + 0.3, np.ones(3) / np.sqrt(3)
    assert interpret(points, normals, model) == []
    found = interpret(points, normals, model, most_null=1)
    assert found[0].assignment[6] == NULL
    assert found[0].assigned == 7
    assert np.linalg.norm(found[0].position_m - place) < 2e-3


def test_sets_are_interpreted_as_each_alone() -> None:
    """Touches come in another order in each; one set has a touch of something else, and one is not
    of the body at all."""
    model, other = block_model("block", (0.06, 0.08, 0.12)), block_model("other", (0.03, 0.05, 0.2))
    sets = [(place, np.roll(points, k, 0), np.roll(normals, k, 0)) for k, of in enumerate(
        (model, other, model, model)) for _, place, points, normals in [felt_block(k, of)]]
    place, points, normals = sets[2]
    points[6], normals[6] = place + 0.3, np.ones(3) / np.sqrt(3)
    points, normals = (np.array([one[part] for one in sets]) for part in (1, 2))
    together = interpret_sets(points, normals, model, angle_rad=0.2, distance_m=4e-3, most_null=1)
    alone = [interpret(*one[1:], model, most_null=1) for one in sets]
    assert [len(found) > 0 for found in together] == [True, False, True, True]
    for one, same in zip(chain(*together), chain(*alone), strict=True):
        assert one.assignment == same.assignment
        for name in ("quaternion_xyzw", "position_m", "away_m"):
            np.testing.assert_array_equal(getattr(one, name), getattr(same, name))


def test_normals_of_a_block_point_outwards() -> None:
    model = block_model("block", (0.06, 0.08, 0.12))
    for corners, normal in zip(model.faces, model.normals, strict=True):
        assert corners.mean(axis=0) @ normal > 0


def test_planes_close_the_body_that_they_bound() -> None:
    block = block_model("block", (0.06, 0.08, 0.12))
    offset = np.array([face[0] @ n for face, n in zip(block.faces, block.normals, strict=True)])
    # A plane far outside bounds nothing.
    normals = np.concatenate([block.normals, [[0.6, 0.8, 0.0]]])
    again = model_of_planes("again", normals, np.append(offset, 1.0))
    assert len(again.faces) == 6
    assert np.allclose(again.normals, block.normals, atol=1e-9)
    for face in polyhedron_faces(block.normals, offset):
        assert np.allclose(sorted(np.abs(face[0])), [0.03, 0.04, 0.06])
    with pytest.raises(ValueError, match="close no body"):
        polyhedron_faces(normals[:4], offset[:4])
