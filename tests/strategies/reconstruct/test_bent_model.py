"""Bodies chosen among all kinds bend where contacts ask for it."""

from dataclasses import replace

import numpy as np
import pytest

from strategies.ready_made import STRATEGIES
from strategies.reconstruct.bent_model import with_bends
from strategies.recovery.choose_model import Shape
from strategies.recovery.misfit import touch_misfit
from sweeps.episode.episodes import EpisodeBlock, run_block, run_episodes
from sweeps.spec.cell import Cell
from warpgrasp.parameters import FitTable

ARCH = {"name": "arch", "superquadric": {
    "size_mm": [22, 28, 80], "exponents": [0.6, 0.9], "bend_per_m": 8.0}}
CELL = Cell(STRATEGIES["rim12-ring12"], ARCH, "arch", seed=5)
EPISODES = np.arange(4)


@pytest.fixture(scope="module")
def arches() -> EpisodeBlock:
    """Episodes about an arch whose models are straight."""
    return run_block(CELL, EPISODES, "cpu", curve=False)


def test_an_arch_bends_and_its_contacts_lie_nearer(arches: EpisodeBlock) -> None:
    before, recovered = arches.exploration.belief, arches.recovered
    every = np.ones(len(EPISODES), bool)
    after, bodies = with_bends(before, recovered, every)
    bent = bodies.superquadric.bend[:, 0] > 0.0
    assert bent.sum() >= 3
    assert np.allclose(bodies.superquadric.bend[bent, 0], 8.0, atol=4.0)
    near, far = touch_misfit(after.fits, after.evidence), touch_misfit(before.fits, before.evidence)
    assert (near[bent] < 0.8 * far[bent]).all()
    assert (near[~bent] == far[~bent]).all()
    low, high = after.uncertainty.volume_interval_m3()[bent].T
    assert (low > 0.0).all()
    assert (low < high).all()
    assert (recovered.superquadric.bend == 0.0).all()


def test_only_superquadrics_that_are_asked_for_bend(arches: EpisodeBlock) -> None:
    before, recovered = arches.exploration.belief, arches.recovered
    none = np.zeros(len(EPISODES), bool)
    assert with_bends(before, recovered, none) == (before, recovered)
    turned = replace(recovered, shape=np.full(len(EPISODES), Shape.REVOLUTION))
    assert with_bends(before, turned, ~none)[1] is turned
    given = replace(before, fit=FitTable(bend=True))
    assert with_bends(given, recovered, ~none)[1] is recovered


@pytest.mark.slow
def test_rows_name_the_bent_body_with_its_numbers(arches: EpisodeBlock) -> None:
    rows = run_episodes(replace(CELL, fit=FitTable(reconstruct="chosen")), EPISODES, "cpu")
    named = rows["shape"] == "tapered_bent_superquadric"
    assert named.any()
    assert (rows["bend_per_m"][named] > 0.0).all()
    assert (rows["chamfer_mm"] < 700.0 * arches.scores.chamfer_m)[named].all()
    straight = Cell(STRATEGIES["ring18"], {"name": "block"}, "block", seed=5,
                    fit=FitTable(reconstruct="chosen"))
    shapes = run_episodes(straight, EPISODES[:2], "cpu")["shape"]
    assert "tapered_superquadric" in shapes
    assert "tapered_bent_superquadric" not in shapes
