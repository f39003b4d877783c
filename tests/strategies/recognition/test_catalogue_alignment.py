"""Known objects are told from one another, and from what nobody listed."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from places import SHARED

from fit.superquadric.geometry import superquadric
from strategies.recognition.answers import NONE
from strategies.recognition.catalogue_alignment import Recognizer, recognizer
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.evidence import Evidence
from sweeps.validate.bodies.scan_meshes import scan_meshes
from warpgrasp.geometry.body import Body
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.catalogue_names import BODY_NAMES

BANANA = SHARED / "objects" / "ycb"
WORLDS, POINTS = 6, 60


@pytest.fixture(scope="module")
def known() -> Recognizer:
    return recognizer()


def felt(body: Body, seed: int = 1, sigma: float = 0.001) -> tuple[SimpleNamespace, Recovered]:
    """Touches all over a body but its foot, anywhere on the table, at any turn."""
    rng = np.random.default_rng(seed)
    surface = sample_body(body).surface_m
    surface = surface[surface[:, 2] > 0.1 * body.high_m[2]]
    yaw, place = rng.uniform(-np.pi, np.pi, WORLDS), rng.normal(0, 0.05, (WORLDS, 2))
    points = surface[rng.integers(len(surface), size=(WORLDS, POINTS))]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y, z = np.moveaxis(points, -1, 0)
    points = np.stack([c * x - s * y + 0.45 + place[:, :1], s * x + c * y + place[:, 1:], z], -1)
    points = points + rng.normal(0, sigma, points.shape)
    covariance = np.tile(np.eye(3) * sigma**2, (WORLDS, POINTS, 1, 1))
    evidence = Evidence(points, np.ones((WORLDS, POINTS), bool), covariance,
                        np.full(points.shape, np.nan), np.zeros((WORLDS, 0, 3)), 0.006,
                        np.zeros((WORLDS, 0), bool), np.zeros((WORLDS, POINTS), bool),
                        np.zeros((WORLDS, POINTS)))
    # The believed body: the right height, some millimetres off, round whatever the truth.
    at = np.column_stack([[0.45, 0.0] + place + rng.normal(0, 0.004, place.shape),
                          np.full(WORLDS, body.high_m[2] / 2)])
    fit = superquadric((0.03, 0.03, body.high_m[2] / 2), (0.1, 1.0), at)
    return (SimpleNamespace(evidence=evidence, worlds=WORLDS),
            Recovered(np.full(WORLDS, Shape.SUPERQUADRIC), fit))


@pytest.mark.parametrize("name", BODY_NAMES)
def test_each_object_of_the_catalogue_is_known(known: Recognizer, name: str) -> None:
    belief, recovered = felt(body_from_name(name))
    assert list(known.recognize(belief, recovered).name) == [name] * WORLDS
    ranking = known.ranking(belief, recovered)
    assert np.allclose(ranking.probability.sum(1), 1.0)
    assert (ranking.square[:, ranking.names.index(name)] < 2.0).all()


@pytest.mark.parametrize("table", [
    {"name": "egg", "superquadric": {"size_mm": [35, 35, 50], "exponents": [1.0, 1.0]}},
    {"name": "brick", "compound": [{"shape": "block", "size_mm": [40, 100, 60]}]},
    {"name": "can", "compound": [{"shape": "cylinder", "radius_mm": 45, "height_mm": 70}]},
])
def test_what_nobody_listed_is_none_of_these(known: Recognizer, table: dict) -> None:
    belief, recovered = felt(body_from_table(table, Path()))
    assert list(known.recognize(belief, recovered).name) == [NONE] * WORLDS


def test_a_banana_is_none_of_these(known: Recognizer, tmp_path: Path) -> None:
    scan_meshes()["banana"].export(tmp_path / "banana.ply")
    body = body_from_table({"mesh": "banana.ply", "units": "m"}, tmp_path)
    belief, recovered = felt(body)
    assert list(known.recognize(belief, recovered).name) == [NONE] * WORLDS


def test_a_scanned_banana_is_none_of_these(known: Recognizer) -> None:
    files = sorted(BANANA.rglob("*banana*.*"))
    meshes = [f for f in files if f.suffix in (".ply", ".stl", ".obj")]
    if not meshes:
        pytest.skip("no scanned banana beside the checkout")
    body = body_from_table({"mesh": str(meshes[0]), "units": "m"}, Path())
    belief, recovered = felt(body)
    assert list(known.recognize(belief, recovered).name) == [NONE] * WORLDS


def test_the_catalogue_can_be_extended_and_a_taller_one_is_another(known: Recognizer) -> None:
    tall = {"name": "tall", "compound": [{"shape": "cylinder", "radius_mm": 35, "height_mm": 200}]}
    mine = Recognizer({"large_cylinder": body_from_name("large_cylinder"),
                       "tall": body_from_table(tall, Path())})
    belief, recovered = felt(body_from_name("large_cylinder"))
    assert list(mine.recognize(belief, recovered).name) == ["large_cylinder"] * WORLDS
    with pytest.raises(ValueError, match="empty"):
        Recognizer({})


def test_nothing_recovered_is_no_answer(known: Recognizer) -> None:
    belief, recovered = felt(body_from_name("block"))
    prior = replace(recovered, shape=np.zeros(WORLDS, int))
    assert list(known.recognize(belief, prior).name) == [""] * WORLDS
