"""Intervals of recovered bodies hold the truth as often as they say, over simulated grasps."""

from math import pi

import numpy as np
import pytest

from fit.rotation import matrix_of_quaternion
from fit.superquadric.uncertainty import surface_distance, surface_std
from strategies.ready_made import STRATEGIES
from strategies.recovery.belief import recovered_uncertainty
from sweeps.episode.episodes import run_block
from sweeps.spec.cell import Cell
from warpgrasp.geometry.body_sampling import sample_body

VOLUMES_M3 = {"block": 0.06 * 0.08 * 0.12, "large_cylinder": pi * 0.035**2 * 0.12,
              "small_cylinder": pi * 0.02**2 * 0.09}


@pytest.mark.slow
def test_ninety_percent_intervals_over_simulated_grasps() -> None:
    volume_held, surface_held = [], []
    for name, volume in VOLUMES_M3.items():
        cell = Cell(STRATEGIES["rim12-ring12"], {"name": name}, name, seed=7)
        block = run_block(cell, np.arange(64), "cpu")
        fits = block.exploration.belief.fits
        fitted = block.status == "ok"
        known = recovered_uncertainty(fits, block.evidence, cell.fit)
        low, high = known.volume_interval_m3().T
        pose = block.truth.body_pose
        surface = sample_body(block.body, surface=256).surface_m
        surface = surface @ matrix_of_quaternion(pose[:, 3:]).swapaxes(1, 2) + pose[:, None, :3]
        away, _ = surface_distance(fits[fitted], surface[fitted])
        held = np.abs(away) < 1.645 * surface_std(fits, known, surface)[fitted]
        volume_held.append(((low < volume) & (volume < high))[fitted])
        surface_held.append(held.mean(axis=1))
        print(f"\n{name}: volume {volume_held[-1].mean():.3f}, "
              f"surface {surface_held[-1].mean():.3f} of {fitted.sum()} episodes")
    assert 0.85 <= np.concatenate(volume_held).mean() <= 0.95
    assert 0.85 <= np.concatenate(surface_held).mean() <= 0.95
