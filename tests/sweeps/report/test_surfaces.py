"""How sure the robot is of a recovered surface, as figures and the report colour it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from fit.implicit.record import TriangleMesh
from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.figures.meshes import coarse_mesh, recovered_faces
from sweeps.report.surfaces import surface_sigma, surfaces_figure, surfaces_shown
from sweeps.report.views import surface_data
from sweeps.spec.cell import Cell
from warpgrasp.parameters import FitTable

pytestmark = pytest.mark.slow  # a free form is compiled


@pytest.fixture(scope="module")
def block() -> EpisodeBlock:
    fit = FitTable(taper=False, rivals=False, rounds=0, reconstruct="implicit")
    return run_block(Cell(STRATEGIES["rim12-ring12"], {"name": "block"}, "block", seed=3, fit=fit),
                     np.arange(1), "cpu")


def without_free_form(block: EpisodeBlock) -> EpisodeBlock:
    return replace(block, exploration=replace(block.exploration, rebuilt=None))


@pytest.mark.parametrize("free", [True, False])
def test_the_surface_is_less_sure_far_from_contacts(block: EpisodeBlock, free: bool) -> None:
    shown = block if free else without_free_form(block)
    assert (shown.rebuilt is not None) == free
    middle = recovered_faces(shown).mean(1)
    middle = middle[middle[:, 2] > 0.01]  # of the foot the table tells
    sigma = surface_sigma(shown, middle)
    assert sigma is not None
    assert (sigma > 0.0).all()
    contacts = block.evidence.points_m[0][block.evidence.mask[0]]
    away = np.linalg.norm(middle[:, None] - contacts, axis=-1).min(1)
    order = np.argsort(away)
    few = len(order) // 5
    assert sigma[order[:few]].mean() < 0.7 * sigma[order[-few:]].mean()


def test_a_figure_and_the_report_have_a_tint_for_every_face(block: EpisodeBlock) -> None:
    drawn = surfaces_figure(surfaces_shown(block, "block"))
    assert len(drawn.axes) == 5  # four bodies and the scale
    found = surface_data(block)
    faces = len(found["faces"]) * 3 // 4 // 8
    assert len(found["unsure"]) * 3 // 4 == pytest.approx(faces, abs=2)
    assert "faces" not in surface_data(without_free_form(block))


def test_a_coarse_mesh_keeps_its_shape() -> None:
    ball = trimesh.creation.icosphere(5, 0.03)
    few = coarse_mesh(TriangleMesh(np.asarray(ball.vertices), np.asarray(ball.faces)), 20)
    assert len(few.faces) < 0.4 * len(ball.faces)
    assert few.volume_m3 == pytest.approx(ball.volume, rel=0.03)
    assert np.linalg.norm(few.vertices_m, axis=1).max() <= 0.03 + 1e-12
