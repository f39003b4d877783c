"""What each episode's intervals are made of, beside the truth, for fitting their factors."""

from dataclasses import fields
from pathlib import Path

import numpy as np

from fit.rotation import matrix_of_quaternion
from fit.superquadric.geometry import Superquadric
from fit.superquadric.uncertainty import surface_distance, surface_std
from strategies.contacts.felt import unfelt_distance
from strategies.contacts.volume_spread import VolumeSigns
from strategies.recovery.choose_model import Shape
from strategies.recovery.contact_verdict import accepted_rms
from sweeps.episode.episodes import run_block
from sweeps.spec.cell import Cell
from warpgrasp.geometry.body_sampling import sample_body

PLACES = 128
"""Of the true surface, of each episode."""


def episode_columns(cell: Cell, episodes: int) -> dict[str, np.ndarray]:
    """A row for each episode that recovered a body: the signs of its volume, `rms_m`, how far its
    contacts lie off it, `log_ratio`, the logarithm of the true volume over the recovered one, and
    of places of the true surface how far they are off the superquadric, `off_m`, and what the robot
    knows there."""
    block = run_block(cell, np.arange(episodes), "cpu")
    belief, recovered = block.exploration.belief, block.recovered
    known = (block.status == "ok") & (recovered.shape != Shape.PRIOR)
    uncertainty = belief.uncertainty
    true = sample_body(block.body, surface=PLACES)
    pose = block.truth.body_pose
    surface = true.surface_m @ matrix_of_quaternion(pose[:, 3:]).swapaxes(1, 2) + pose[:, None, :3]
    body = Superquadric(*recovered.superquadric)
    columns = {f.name: getattr(uncertainty.signs, f.name) for f in fields(VolumeSigns)} | {
        "log_ratio": np.log(true.volume_m3 / uncertainty.volume_m3),
        "rms_m": accepted_rms(recovered, belief.evidence),
        "off_m": surface_distance(body, surface)[0].astype(np.float32),
        "place_std_m": surface_std(body, uncertainty, surface).astype(np.float32),
        "place_unfelt_m": unfelt_distance(surface, belief.felt).astype(np.float32)}
    names = {"strategy": cell.strategy.name, "object": cell.object_name, "seed": cell.seed,
             "errors": cell.errors.scale}
    return {name: np.asarray(values)[known] for name, values in columns.items()} | {
        name: np.full(known.sum(), value) for name, value in names.items()}


def read_columns(files: list[Path]) -> dict[str, np.ndarray]:
    """The rows of files of `episode_columns`, one after another."""
    tables = [np.load(file) for file in files]
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0].files}
