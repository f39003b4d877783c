"""Polyhedra of crossed faces: where they stand for a body, and what calibration they undo."""

from dataclasses import replace

import numpy as np
import pytest

from fit.arrays import rows_of
from fit.rotation import matrix_of_quaternion
from strategies.contacts.shared_errors import shared_shifts
from strategies.procedures.lean import face_axes
from strategies.ready_made import STRATEGIES
from strategies.reconstruct.calibrated_planes import Planes, calibrated_planes
from strategies.reconstruct.felt_polyhedron import crossed_planes, felt_polyhedron
from strategies.recovery.free_contacts import LATER_SIGMA_M, PAD_SIGMA_M
from sweeps.episode.episodes import EpisodeBlock, run_block, run_episodes
from sweeps.report.episode_files import shape_record
from sweeps.report.trust import choice_sentence
from sweeps.spec.cell import Cell
from warpgrasp.parameters import FitTable

FIT = FitTable(reconstruct="chosen")
HALF_M = np.array([0.03, 0.04, 0.06])  # of the catalogue's block


def cell(name: str) -> Cell:
    return Cell(STRATEGIES["planar"], {"name": name}, name, seed=11, fit=FIT)


@pytest.fixture(scope="module")
def blocks() -> EpisodeBlock:
    return run_block(cell("block"), np.arange(4), "cpu")


def true_planes(block: EpisodeBlock, world: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the block as it stands: four sides and the top."""
    pose = block.truth.body_pose[world]
    turn = matrix_of_quaternion(pose[None, 3:])[0]
    ways = np.concatenate([np.eye(3), -np.eye(3)[:2]])
    size = np.array([*HALF_M[:2], 2 * HALF_M[2], *HALF_M[:2]])
    normals = ways @ turn.T
    return normals, size + normals @ pose[:3]


def test_a_block_is_a_polyhedron_named_and_nearer_than_the_model(blocks: EpisodeBlock) -> None:
    assert blocks.rebuilt is not None
    assert set(blocks.rebuilt.polyhedra) == {0, 1, 2, 3}
    model = blocks.moments[-1].scores
    assert blocks.scores.chamfer_m.mean() < 0.9 * model.chamfer_m.mean()
    assert blocks.scores.iou.mean() > model.iou.mean()
    record = shape_record(cell("block"), blocks, 1)
    assert record["chosen"] == "polyhedron"
    first = record["models"][0]
    assert first["shape"] == "polyhedron"
    assert [plane["felt"] for plane in first["planes"]] == [True] * 5 + [False]
    assert "polyhedron of 5 faces" in choice_sentence(blocks, 1)


@pytest.mark.slow
def test_rows_name_it_and_do_not_depend_on_the_batch(blocks: EpisodeBlock) -> None:
    rows = run_episodes(cell("block"), np.arange(2, 3), "cpu")
    assert list(rows["shape"]) == ["polyhedron"]
    assert rows["chamfer_mm"][0] == 1e3 * blocks.scores.chamfer_m[2]
    plain = replace(cell("block"), fit=FitTable())
    assert list(run_episodes(plain, np.arange(2, 3), "cpu")["shape"]) == ["tapered_superquadric"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["small_cylinder", "lightbulb"])
def test_no_round_body_is_a_polyhedron(name: str) -> None:
    block = run_block(cell(name), np.arange(4), "cpu")
    assert block.rebuilt is not None
    assert not block.rebuilt.polyhedra


def test_a_face_that_was_not_felt_leaves_it_open(blocks: EpisodeBlock) -> None:
    own = np.array([0])
    belief = blocks.exploration.belief
    faces = [rows_of(face, own) for face in belief.faces]
    evidence, prior = rows_of(belief.evidence, own), rows_of(blocks.prior, own)
    felt, model = rows_of(blocks.exploration.felt, own), rows_of(blocks.recovered, own)
    planes = felt_polyhedron(faces, model, evidence, felt, prior, FIT)
    assert planes is not None
    assert planes.felt == 5
    assert felt_polyhedron(faces[:3], model, evidence, felt, prior, FIT) is None
    assert felt_polyhedron(faces, model, evidence, felt, replace(
        prior, radius_m=np.array([0.005]), height_m=np.array([0.01])), FIT) is None
    assert crossed_planes([], table_plane=True) is None


def test_errors_that_touches_share_are_taken_out_as_their_covariance_says(
    blocks: EpisodeBlock
) -> None:
    """The oracle is generalised least squares with the covariance of all touches together."""
    belief, rng = blocks.exploration.belief, np.random.default_rng(0)
    raw_error, error, away = [], [], []
    table = np.array([[0.0, 0.0, -1.0]])
    for world in 6 * [0, 1, 2, 3]:
        own = np.array([world])
        evidence, links = rows_of(belief.evidence, own), rows_of(belief.links, own)
        normals, offset = true_planes(blocks, world)
        beyond = (evidence.points_m[0] @ normals.T) - offset
        face = np.abs(beyond).argmin(1)
        off = np.take_along_axis(beyond, face[:, None], 1)
        # Those within a face, put on it, then moved by errors drawn anew and by noise.
        mask = evidence.mask[0] & ((beyond - off < -0.004).sum(1) == 4)
        outward = normals[face]
        exact = (evidence.points_m[0] - off * outward)[None]
        shift = shared_shifts(links, exact, outward[None], belief.errors, belief.arm)[0]
        pads = evidence.by_pad[0]
        sigma = np.where(pads, PAD_SIGMA_M, LATER_SIGMA_M)
        moved = shift @ rng.normal(size=shift.shape[1]) + sigma * rng.normal(size=len(face))
        there = replace(evidence, points_m=exact + (moved[:, None] * outward)[None],
                        mask=mask[None], contradiction=np.zeros_like(evidence.contradiction))
        raw = offset + [moved[mask & pads & (face == k)].mean() for k in range(5)]
        found = calibrated_planes(
            Planes(np.append(normals, table, axis=0), np.append(raw, 0.0), 5), there, links,
            belief.errors, belief.arm)
        assert found.offset_m[5] == 0.0
        at = np.array([exact[0][mask & (face == k)].mean(0) for k in range(5)])
        one = ((found.offset_m[:5] - offset)
               - ((found.normals[:5] - normals) * at).sum(1))
        use = np.flatnonzero(mask)
        arm = exact[0][use] - at[face[use]]
        level = face_axes(normals)[:, :2]
        along = (arm[:, None] * level[face[use]]).sum(-1)
        each = (face[use][:, None] == np.arange(5)).astype(float)
        design = np.concatenate([each, each * along[:, :1], each * along[:, 1:]], 1)
        whole = shift[use] @ shift[use].T + np.diag(sigma[use] ** 2)
        solved = np.linalg.solve(whole, np.column_stack([design, moved[use]]))
        best = np.linalg.lstsq(design.T @ solved[:, :-1], design.T @ solved[:, -1])[0][:5]
        raw_error.append(raw - offset)
        error.append(one)
        away.append(one - best)
    raw_rms, rms, apart = (float(np.sqrt(np.mean(np.square(v)))) for v in (raw_error, error, away))
    assert rms < 0.8 * raw_rms
    assert apart < 0.25 * rms
