"""Bodies of several superquadrics: found where contacts ask for them, and as many."""

from dataclasses import replace

import numpy as np
import pytest
from felt_bodies import HANDLE, HEAD, box_points, felt_at, hammer
from scipy.spatial.transform import Rotation
from scipy.special import beta

from fit.superquadric.geometry import superquadric
from strategies.poses.waypoints import BoundingCylinder
from strategies.ready_made import STRATEGIES
from strategies.reconstruct.parts import divisions, fitted_parts, parts_mesh
from strategies.recovery.choose_model import OF_A_SUPERQUADRIC
from strategies.recovery.fit_contacts import recover_bodies
from strategies.recovery.misfit import schwarz
from sweeps.episode.episodes import run_block
from sweeps.spec.cell import Cell
from warpgrasp.objects.families import family_table
from warpgrasp.parameters import FitTable

TABLE = FitTable()
PRIOR = BoundingCylinder(*(np.array([v]) for v in (0.45, 0.0, 0.12, 0.17)))


def test_a_hammer_is_two_parts_of_its_sizes() -> None:
    parts = fitted_parts(felt_at(hammer()), PRIOR, TABLE)
    assert parts is not None
    assert len(parts) == 2
    found = sorted(np.sort(size).tolist() for size in parts.size_m)
    wanted = sorted(sorted(size) for size in (HANDLE, HEAD))
    assert np.abs(np.array(found) - np.array(wanted)).max() < 0.006
    mesh = parts_mesh(parts)
    volume = 8.0 * (np.prod(HANDLE) + np.prod(HEAD))  # they meet in a face
    assert mesh.volume_m3 == pytest.approx(volume, rel=0.2)
    assert mesh.vertices_m[:, 2].min() > -1e-4


def test_a_mesh_of_parts_has_the_volume_of_their_union() -> None:
    """A rod 16 mm thick, turned to lie askew, and a ball beyond its end: by formulas."""
    turned = Rotation.from_euler("z", 0.7)
    parts = superquadric(
        [[0.008, 0.008, 0.12], [0.02, 0.02, 0.02]], [[0.1, 1.0], [1.0, 1.0]],
        [[0.45, 0.0, 0.05], turned.apply([0.15, 0.0, 0.05]) + [0.45, 0.0, 0.0]],
        [(turned * Rotation.from_euler("y", np.pi / 2)).as_quat(), [0.0, 0.0, 0.0, 1.0]])
    fits = replace(recover_bodies(felt_at(hammer()), None, TABLE)[0][np.zeros(2, int)],
                   **parts._asdict())
    mesh = parts_mesh(fits)
    e = 0.1  # of a round superquadric: pi a^2 h times 2 / e times the beta function
    rod = 2 * np.pi * 0.008**2 * 0.12 * 0.5 * e * beta(e / 2, e + 1)
    assert mesh.volume_m3 == pytest.approx(rod + 4 / 3 * np.pi * 0.02**3, rel=0.03)


@pytest.mark.slow
def test_a_robot_that_does_not_know_the_table_takes_parts_above_and_below_it() -> None:
    """The same contacts farther up and farther down: the same parts there."""
    unknown, on_it = replace(TABLE, table_plane=False), hammer()
    here = fitted_parts(felt_at(on_it), PRIOR, unknown)
    assert here is not None
    volume = parts_mesh(here, table_plane=False).volume_m3
    for up in (0.05, -0.05):
        felt = felt_at(on_it + [0.0, 0.0, up])
        prior = replace(PRIOR, height_m=PRIOR.height_m + max(up, 0.0))
        parts = fitted_parts(felt, prior, unknown)
        assert parts is not None
        assert len(parts) == len(here)
        mesh = parts_mesh(parts, table_plane=False)
        assert mesh.volume_m3 == pytest.approx(volume, rel=0.03)
        assert mesh.vertices_m[:, 2].min() == pytest.approx(
            on_it[:, 2].min() + up, abs=0.006)


def test_a_block_is_one() -> None:
    points = box_points((0.03, 0.04, 0.05), (0.45, 0.0, 0.05), 80, 3)
    assert fitted_parts(felt_at(points), PRIOR, TABLE) is None


def test_few_or_no_contacts_are_no_parts() -> None:
    felt = felt_at(hammer())
    for count in (0, 1, 3):
        few = replace(felt, mask=felt.mask & (np.arange(felt.mask.shape[1]) < count))
        assert fitted_parts(few, PRIOR, TABLE) is None


def test_parts_that_the_prior_contradicts_are_none() -> None:
    small = replace(PRIOR, radius_m=np.array([0.01]), height_m=np.array([0.02]))
    assert fitted_parts(felt_at(hammer()), small, TABLE) is None


def test_divisions_are_whole_and_a_part_must_pay_for_its_parameters() -> None:
    points = hammer()
    for count in (2, 3):
        ways = divisions(points, count)
        assert ways.shape == (6, len(points))
        assert all(set(way.tolist()) <= set(range(count)) for way in ways)
        slabs = [np.bincount(way, minlength=count) for way in ways[:3]]
        assert all(sizes.max() - sizes.min() <= 1 for sizes in slabs)
    one = schwarz(0.006, 50, OF_A_SUPERQUADRIC, 0.0008)
    assert schwarz(0.003, 50, 2 * OF_A_SUPERQUADRIC, 0.0008) < one
    assert schwarz(0.0055, 50, 2 * OF_A_SUPERQUADRIC, 0.0008) > one


@pytest.mark.slow
def test_a_hammer_that_was_touched_is_two_parts_nearer_than_one() -> None:
    table = family_table("hammer-1")
    assert table is not None
    strategy = replace(STRATEGIES["any-object"], touches=96)
    cell = Cell(strategy, table, "hammer-1", seed=4, fit=FitTable(reconstruct="parts"))
    block = run_block(cell, np.arange(3), "cpu")
    assert block.rebuilt is not None
    assert block.rebuilt.name == "parts"
    made = np.flatnonzero(block.rebuilt.made)
    assert len(made) >= 2
    assert {len(parts) for parts in block.rebuilt.parts.values()} <= {2, 3, 4}
    model = block.moments[-1].scores.chamfer_m
    assert (block.scores.chamfer_m[made] < 0.6 * model[made]).all()
    alone = run_block(cell, made[:1], "cpu")
    assert alone.scores.chamfer_m[0] == block.scores.chamfer_m[made[0]]
