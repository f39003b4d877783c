"""Free forms of episodes: their contacts lie nearer to where fingers truly touched, they stand
where a model does not explain what was felt, and do not depend on the batch."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from fit.implicit.record import ImplicitFit, TriangleMesh
from strategies.ready_made import STRATEGIES
from strategies.recovery.choose_model import Shape
from strategies.recovery.contact_verdict import mean_gap_to_mesh, unexplained
from strategies.recovery.free_contacts import believed_freely, fitted_freely
from strategies.recovery.misfit import FARTHEST_M
from sweeps.episode.episodes import EpisodeBlock, run_block, run_episodes
from sweeps.report.episode_files import shape_record
from sweeps.spec.cell import Cell
from warpgrasp.objects.families import family_table
from warpgrasp.parameters import FitTable

FIT = FitTable(reconstruct="chosen")


def cell(name: str) -> Cell:
    table = family_table(name)
    assert table is not None
    return Cell(replace(STRATEGIES["any-object"], touches=128), table, name, seed=4, fit=FIT)


@pytest.fixture(scope="module")
def bowls() -> EpisodeBlock:
    """Bowls, which no superquadric is."""
    return run_block(cell("bowl-2"), np.arange(3), "cpu")


@pytest.mark.slow
def test_contacts_move_towards_where_fingers_touched(bowls: EpisodeBlock) -> None:
    found = bowls.exploration
    true = np.concatenate([bowls.truth.closings[p.closing].point_m.reshape(len(found.status), -1, 3)
                           for p in found.procedures], axis=1)
    _, placed = fitted_freely(found.felt, found.belief.links, FIT)
    use = found.felt.mask & np.isfinite(true).all(-1)

    def error(points: np.ndarray) -> float:
        return float(np.median(np.linalg.norm(points - true, axis=-1)[use]))

    assert use.sum() > 100
    assert error(placed.points_m) < 0.0055
    assert error(placed.points_m) < 0.75 * error(found.felt.points_m)
    assert error(placed.points_m) < 0.75 * error(found.belief.evidence.points_m)


@pytest.mark.slow
def test_planners_may_ask_for_the_free_form_that_is_made() -> None:
    short = replace(cell("bowl-2"), strategy=replace(STRATEGIES["any-object"], touches=16),
                    fit=FitTable(reconstruct="implicit"))
    block = run_block(short, np.arange(1), "cpu")
    assert block.rebuilt is not None
    (world, form), = block.rebuilt.forms.items()
    assert form.about.name == "implicit"
    asked = believed_freely(block.exploration.belief, world)
    assert (asked.alpha_per_m == form.fit.alpha_per_m).all()
    assert (asked.points_m == form.fit.points_m).all()
    with pytest.raises(ValueError, match="does not say where contacts were felt"):
        believed_freely(replace(block.exploration.belief, unplaced=None), 0)


def test_the_record_of_a_free_form_has_its_interval_once() -> None:
    short = replace(cell("bowl-2"), strategy=replace(STRATEGIES["any-object"], touches=16),
                    fit=FitTable(reconstruct="implicit"))
    record = shape_record(short, run_block(short, np.arange(1), "cpu"))
    assert record["chosen"] == "implicit"
    parameters, interval = record["models"][0]["parameters"], record["interval"]
    assert interval["volume_low_m3"] < parameters["volume_m3"] < interval["volume_high_m3"]
    assert not {"volume_low_m3", "volume_high_m3"} & set(parameters)
    assert interval["interval_trusted"] is False


@pytest.mark.slow
def test_a_free_form_that_contacts_lie_off_does_not_stand(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    """A crumb among the contacts agrees with prior and table."""
    short = replace(cell("bowl-2"), strategy=replace(STRATEGIES["any-object"], touches=16),
                    fit=FitTable(reconstruct="implicit"))
    as_made = run_episodes(short, np.arange(1), "cpu")
    assert as_made["shape"][0] == "implicit"
    # The interval of the model is none of the mesh that stands in its place.
    assert np.isnan(as_made["volume_low_m3"][0])
    assert not as_made["interval_trusted"][0]

    def crumbs(fit: ImplicitFit, *args: Any, **words: Any) -> list[TriangleMesh]:
        crumb = trimesh.creation.box((0.01, 0.01, 0.01))
        middle = [*fit.points_m[0, :, :2].mean(0), 0.02]
        return [TriangleMesh(np.asarray(crumb.vertices) + middle, np.asarray(crumb.faces))]

    monkeypatch.setattr("fit.implicit.mesh.implicit_meshes", crumbs)
    crumbled = run_episodes(short, np.arange(1), "cpu")
    assert crumbled["shape"][0] != "implicit"
    assert np.isfinite(crumbled["volume_low_m3"][0]) or crumbled["shape"][0] == "prior"


def test_distances_of_contacts_from_a_sphere() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.04)
    mesh = TriangleMesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    way = np.random.default_rng(3).normal(size=(50, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    for off, counts_as in ((0.003, 0.003), (-0.003, 0.003), (0.2, FARTHEST_M)):
        assert mean_gap_to_mesh(mesh, (0.04 + off) * way) == pytest.approx(counts_as, abs=1e-4)


@pytest.mark.slow
def test_contacts_lose_what_calibration_did_to_them(bowls: EpisodeBlock) -> None:
    found = bowls.exploration
    part = [bowls.truth.closings[p.closing] for p in found.procedures]
    true, normal = (np.concatenate([getattr(c, name).reshape(len(found.status), -1, 3)
                                    for c in part], axis=1) for name in ("point_m", "normal"))
    known = (found.belief.errors, found.belief.arm)
    (_, before), (_, after) = (fitted_freely(found.felt, found.belief.links, FIT, given)
                               for given in (None, known))
    use = found.felt.mask & np.isfinite(true).all(-1)
    miss = [np.abs(((placed.points_m - true) * normal).sum(-1)) for placed in (before, after)]
    off = [np.mean([np.median(m[w][use[w]]) for w in range(len(use))]) for m in miss]
    assert off[1] < 0.9 * off[0]


@pytest.mark.slow
def test_a_bowl_is_a_free_form_and_nearer_than_the_model(bowls: EpisodeBlock) -> None:
    assert unexplained(bowls.recovered, bowls.evidence).all()
    assert bowls.rebuilt is not None
    assert bowls.rebuilt.made.all()
    assert (bowls.status == "ok").all()
    model = bowls.moments[-1].scores
    assert np.median(bowls.scores.chamfer_m) < np.median(model.chamfer_m)
    assert np.median(bowls.scores.iou) > np.median(model.iou)
    volume = bowls.rebuilt.volume(0)
    assert volume is not None
    low, high = volume.interval_m3()[0]
    assert 0.0 < low < volume.volume_m3[0] < high


def test_a_model_that_explains_its_touches_stands() -> None:
    block = Cell(STRATEGIES["ring18"], {"name": "block"}, "block", seed=5, fit=FIT)
    rows = run_episodes(block, np.arange(3), "cpu")
    plain = run_episodes(replace(block, fit=FitTable()), np.arange(3), "cpu")
    for name in ("shape", "status", "chamfer_mm"):
        assert (rows[name] == plain[name]).all(), name


@pytest.mark.slow
def test_no_body_is_unexplained(bowls: EpisodeBlock) -> None:
    none = replace(bowls.recovered, shape=np.full(3, Shape.PRIOR))
    assert unexplained(none, bowls.evidence).all()


@pytest.mark.slow
def test_a_free_form_does_not_depend_on_the_batch(bowls: EpisodeBlock) -> None:
    alone = run_block(cell("bowl-2"), np.arange(1, 2), "cpu")
    assert alone.rebuilt is not None
    assert bowls.rebuilt is not None
    assert (alone.rebuilt.meshes[0].vertices_m == bowls.rebuilt.meshes[1].vertices_m).all()
    assert alone.scores.chamfer_m[0] == bowls.scores.chamfer_m[1]
