"""Models learned from recovered bodies name them again, and say when it is none of them."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fit.fit_status import FitStatus
from fit.superquadric.geometry import Superquadric, superquadric
from strategies.procedures.planar_faces import Face
from strategies.recognition.answers import NONE, Recognition, recognize
from strategies.recognition.descriptions import FACES, PARAMETERS, PROFILE, WAYS
from strategies.recognition.known_models import (
    KnownModels,
    ModelsError,
    models_from_file,
    models_text,
)
from strategies.recognition.lessons import UNLISTED, add_objects, learn_models, lesson_of
from strategies.recovery.choose_model import Recovered, Shape
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.objects.catalogue_names import BODY_NAMES

SIZES = {"block": ((0.03, 0.04, 0.06), (0.1, 0.1)), "can": ((0.035, 0.035, 0.06), (0.1, 1.0)),
         "ball": ((0.03, 0.03, 0.03), (1.0, 1.0)), "pole": ((0.02, 0.02, 0.1), (0.1, 1.0))}
STD = 0.05
Batch = tuple[SimpleNamespace, Recovered, np.ndarray]


def batch(names: list[str], seed: int, *, faces: bool = False, contour: bool = False) -> Batch:
    """Recovered bodies with errors of 5 %; "" is of any size; of blocks faces, of others contours.
    """
    rng = np.random.default_rng(seed)
    n = len(names)
    size, exponents = np.empty((n, 3)), np.empty((n, 2))
    for k, name in enumerate(names):
        size[k], exponents[k] = SIZES.get(name, (
            np.exp(rng.uniform(np.log(0.015), np.log(0.1), 3)), rng.uniform(0.1, 1.6, 2)))
    size *= np.exp(STD * rng.normal(size=(n, 3)))
    exponents = np.clip(exponents + STD * rng.normal(size=(n, 2)), 0.1, 2.0)
    body = superquadric(size, exponents, np.column_stack([rng.normal(0.4, 0.1, (n, 2)),
                                                          size[:, 2]]))
    yaw = rng.uniform(-np.pi, np.pi, n)
    turned = np.column_stack([np.zeros((n, 2)), np.sin(yaw / 2), np.cos(yaw / 2)])
    body = body._replace(quaternion_xyzw=turned)
    covariance = np.zeros((n, 15, 15))
    covariance[:, range(5), range(5)] = STD**2
    belief = SimpleNamespace(
        worlds=n, fitted=np.ones(n, bool), body=body, profile=None, faces=(),
        uncertainty=SimpleNamespace(covariance=covariance))
    shape = np.full(n, Shape.SUPERQUADRIC)
    square = np.array([name in ("block", "brick") for name in names])
    if faces:
        belief.faces = crossed(body, square, yaw, rng)
    if contour:
        share = np.linspace(0, 1, 9)
        round_ = np.sqrt(1 - (2 * share - 1) ** 2) * (exponents[:, :1] > 0.5) + 1.0 * (
            exponents[:, :1] <= 0.5)
        belief.profile = SimpleNamespace(
            volume_m3=8 * size.prod(1), height_m=2 * size[:, 2:] * share,
            radius_m=size[:, :1] * round_)
        shape = np.where(square, shape, Shape.REVOLUTION)
    return belief, Recovered(shape, body), np.array(names, object)


def crossed(body: Superquadric, square: np.ndarray, yaw: np.ndarray, rng: Any) -> tuple[Face, ...]:
    """The top and four sides of each block as planes, errors of half a millimetre; others bulge."""
    n = len(yaw)
    faces = []
    for axis, sign in ((2, 1), (0, 1), (0, -1), (1, 1), (1, -1)):
        local = np.zeros((n, 3))
        local[:, axis] = sign
        c, s = np.cos(yaw), np.sin(yaw)
        normal = np.stack([c * local[:, 0] - s * local[:, 1], s * local[:, 0] + c * local[:, 1],
                           local[:, 2]], 1)
        half = np.array([SIZES["block"][0][axis]] * n) + 5e-4 * rng.normal(size=n)
        middle = body.position_m.copy()
        middle[:, 2] = 0.06
        centre = middle + normal * half[:, None]
        fit = SimpleNamespace(n_points=np.full(n, 20), centre_m=centre,
                              status=np.full(n, FitStatus.converged))
        faces.append(Face(normal, (normal * centre).sum(1), np.zeros((n, 2)),
                          square, fit, normal))  # pyright: ignore
    return tuple(faces)


def answers(known: KnownModels, made: Batch, **options: Any) -> Recognition:
    return recognize(made[0], made[1], known, **options)  # pyright: ignore


@pytest.fixture(scope="module")
def known() -> KnownModels:
    lessons = []
    for seed, options in enumerate(({}, {"faces": True}, {"contour": True})):
        names = [name for name in SIZES for _ in range(12)] + [UNLISTED] * 60
        lessons.append(lesson_of(*batch(names, seed, **options)))  # pyright: ignore
    return learn_models(lessons, {name: f"hash of {name}" for name in SIZES}, "test")


@pytest.mark.parametrize(("options", "ways"), [
    ({}, {PARAMETERS}), ({"faces": True}, {FACES, PARAMETERS}),
    ({"contour": True}, {PROFILE, PARAMETERS})])
def test_what_was_learned_is_named_by_what_was_felt(
        known: KnownModels, options: dict, ways: set[str]) -> None:
    names = [name for name in SIZES for _ in range(10)]
    found = answers(known, batch(names, 50, **options))
    assert set(found.way) == ways
    assert (found.name == np.array(names)).mean() >= 0.9
    assert ((found.probability > 0) & (found.probability <= 1)).all()
    if "faces" in options:
        assert (found.way[:10] == FACES).all()
        assert (found.name[:10] == "block").all()


@pytest.mark.slow
def test_an_object_recovered_in_every_other_pair_of_episodes_is_learned() -> None:
    """By the first half nothing is known of it: the second says nothing of temperatures then."""
    lessons = []
    for seed, options in enumerate(({}, {"faces": True}, {"contour": True})):
        names = [name for name in SIZES for _ in range(12)] + [UNLISTED] * 60
        lesson = lesson_of(*batch(names, seed, **options))  # pyright: ignore
        first = np.arange(len(names)) // 2 % 2 == 0
        lessons.append(lesson.part(~((lesson.names == "block") & first)))
    models = learn_models(lessons, {name: f"hash of {name}" for name in SIZES}, "test")
    assert models.names == tuple(SIZES)


def test_a_way_not_tried_on_every_object_gives_no_answer(known: KnownModels) -> None:
    untried = replace(known.objects[1], name="new", tried={**known.objects[1].tried, FACES: 0})
    found = answers(replace(known, objects=(*known.objects, untried)),
                    batch(["block", "brick"], 50, faces=True), way=FACES)
    assert found.name.tolist() == found.way.tolist() == ["", ""]


def test_what_is_not_listed_is_none_of_these(known: KnownModels) -> None:
    found = answers(known, batch([UNLISTED] * 60, 51))
    assert (found.name == NONE).mean() > 0.75
    sure = answers(known, batch([UNLISTED] * 60, 51), none_prior=0.9)
    assert (sure.name == NONE).sum() >= (found.name == NONE).sum()


def test_the_mean_probability_is_the_share_that_is_right(known: KnownModels) -> None:
    listed = [name for name in SIZES for _ in range(50)]
    made = batch(listed + [UNLISTED] * 50, 52)
    found = answers(known, made)
    right = found.name == np.where(made[2] == UNLISTED, NONE, made[2])
    assert abs(found.probability.mean() - right.mean()) < 0.06


def test_a_way_without_evidence_gives_no_answer(known: KnownModels) -> None:
    made = batch(["block", "can"], 53)
    for way in (FACES, PROFILE):
        found = answers(known, made, way=way)
        assert list(found.name) == list(found.way) == ["", ""]
        assert np.isnan(found.probability).all()
    prior = replace(made[1], shape=np.zeros(2, int))
    assert list(answers(known, (made[0], prior, made[2])).name) == ["", ""]


def test_a_world_answers_the_same_in_any_batch(known: KnownModels) -> None:
    names = [name for name in SIZES for _ in range(5)]
    belief, recovered, _ = batch(names, 54)
    whole = recognize(belief, recovered, known)  # pyright: ignore
    for k in (0, 7, 19):
        one = slice(k, k + 1)
        alone = SimpleNamespace(
            worlds=1, fitted=belief.fitted[one], profile=None, faces=(),
            body=Superquadric(*(f[one] for f in belief.body)),
            uncertainty=SimpleNamespace(covariance=belief.uncertainty.covariance[one]))
        found = recognize(alone, Recovered(recovered.shape[one], alone.body), known)  # pyright: ignore
        assert found.name[0] == whole.name[k]
        assert found.probability[0] == whole.probability[k]


def test_the_polyhedron_learned_is_the_block(known: KnownModels) -> None:
    block = next(one for one in known.objects if one.name == "block")
    assert block.faces is not None
    normals, offset = block.faces.normals, block.faces.offset_m
    widths = [offset[i] + offset[j] for i in range(len(offset)) for j in range(i)
              if normals[i] @ normals[j] < -0.99]
    assert np.allclose(sorted(widths), [0.06, 0.08, 0.12], atol=1e-3)
    assert block.faces.std_m < 0.002
    assert all(one.faces is None for one in known.objects if one.name != "block")


def test_a_file_gives_the_same_models_again(known: KnownModels, tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_text(models_text(known))
    again = models_from_file(str(file))
    assert again.names == known.names
    assert models_text(again) == models_text(known)
    made = batch([*SIZES] * 3, 55, faces=True)
    one, other = answers(known, made), answers(again, made)
    assert list(one.name) == list(other.name)
    assert np.allclose(one.probability, other.probability, atol=1e-3)


def test_objects_are_added_and_replaced(known: KnownModels) -> None:
    lessons = [lesson_of(*batch(["egg"] * 8, 56))]  # pyright: ignore
    more = add_objects(known, lessons, {"egg": "new"}, "test")
    assert more.names == (*known.names, "egg")
    twice = add_objects(more, lessons, {"egg": "newer"}, "test")
    assert twice.names == more.names
    assert twice.objects[-1].content == "newer"
    # No faces of the egg were looked for, so that faces cannot tell.
    assert FACES not in set(answers(more, batch(["block"] * 3, 57, faces=True)).way)
    nothing = lesson_of(*batch(["egg"] * 8, 58))  # pyright: ignore
    with pytest.raises(ValueError, match="no body was recovered"):
        add_objects(known, [nothing.part(np.zeros(8, bool))], {"egg": ""}, "test")


@pytest.mark.parametrize(("change", "message"), [
    ({"format": "other"}, "format"), ({"objects": {}}, "none"), ({"temperature": {}}, "faces"),
    ({"unlisted": {"tried": 3}}, "TypeError")])
def test_another_file_is_refused_with_the_reason(
        known: KnownModels, tmp_path: Path, change: dict, message: str) -> None:
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(json.loads(models_text(known)) | change))
    with pytest.raises(ModelsError, match=message):
        models_from_file(str(file))


def test_a_scatter_that_is_no_number_is_refused(known: KnownModels, tmp_path: Path) -> None:
    text = json.loads(models_text(known))
    next(iter(text["objects"].values()))[PARAMETERS]["scatter"][0][0] = float("nan")
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(text))
    with pytest.raises(ModelsError, match="rows of their scatter"):
        models_from_file(str(file))


@pytest.mark.parametrize(("change", "message"), [
    (lambda file: file["objects"]["can"]["found"].update(parameters=-1), "can: found should be"),
    (lambda file: file["objects"].update({NONE: file["objects"]["can"]}), "is no name of one"),
    (lambda file: file["unlisted"].pop(PROFILE), "unlisted: wants profile and parameters"),
    (lambda file: file["unlisted"][PARAMETERS]["kernels"]["middles"][0].pop(), "inhomogeneous"),
    (lambda file: file["unlisted"][PARAMETERS]["kernels"]["middles"].clear(), "of every kernel"),
    (lambda file: file["numbers"][PARAMETERS].reverse(), "numbers: are others")])
def test_models_that_would_fail_or_mislead_later_are_refused(
        known: KnownModels, tmp_path: Path, change: Any, message: str) -> None:
    text = json.loads(models_text(known))
    change(text)
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(text))
    with pytest.raises(ModelsError, match=message):
        models_from_file(str(file))


@pytest.mark.parametrize("text", ["", "[1]", "{", '{"format": "warpgrasp models 1"}', "\0"])
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "mine.json"
    file.write_text(text)
    with pytest.raises(ModelsError, match="no file of models"):
        models_from_file(str(file))
    with pytest.raises(ModelsError, match="cannot be read"):
        models_from_file(str(tmp_path / "absent.json"))


def test_the_models_that_ship_are_of_the_catalogue() -> None:
    shipped = models_from_file("")
    assert {one.name: one.content for one in shipped.objects} == {
        name: body_from_name(name).content for name in BODY_NAMES}
    assert shipped.made_by
    assert all(one.tried[way] > 0 for one in shipped.objects for way in WAYS)
    assert {one.name for one in shipped.objects if one.faces} == {"block", "wedge"}
    of_unlisted = shipped.unlisted.populations[PARAMETERS].kernels
    assert of_unlisted is not None
    assert len(of_unlisted.middles) == 64  # an object each
