"""How far accepted contacts are off, and how often intervals hold the truth: rows of tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fit.rotation import matrix_of_quaternion
from fit.superquadric.geometry import Superquadric
from fit.superquadric.uncertainty import surface_distance
from strategies.contacts.body_uncertainty import surface_spread
from strategies.contacts.volume_spread import interval_trusted
from strategies.ready_made import STRATEGIES
from strategies.recovery.choose_model import Shape
from strategies.recovery.contact_verdict import TABLE, UNSURE_BODY, accepted_rms
from sweeps.episode.contact_rows import contact_columns
from sweeps.episode.episodes import run_block
from sweeps.spec.cell import Cell
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue_names import BODY_NAMES
from warpgrasp.objects.families import family_table
from warpgrasp.parameters import ErrorTable, HandTable

FAR_MM, Z = 10.0, 1.645


def objects(scans: Path | None = None, names: Sequence[str] | None = None
            ) -> dict[str, dict[str, Any]]:
    """Tables of the catalogue's ten objects, or of others and members of families by name, and of
    the meshes [m] of a folder."""
    named = BODY_NAMES if names is None else names
    found: dict[str, dict[str, Any]] = {
        name: family_table(name) or {"name": name} for name in named}
    meshes = sorted(scans.glob("*.ply")) if scans else []
    return found | {m.stem: {"name": m.stem, "mesh": str(m.resolve()), "units": "m"}
                    for m in meshes}


def errors_times(factor: float) -> ErrorTable:
    """The default deviations, each times `factor`."""
    return ErrorTable(scale=factor)


def cell_of(table: dict[str, Any], strategy: str, seed: int, errors: ErrorTable,
            hand: str = "utah_mit") -> Cell:
    """Episodes of a ready-made strategy."""
    return Cell(STRATEGIES[strategy], table, table["name"], seed=seed, errors=errors,
                hand=HandTable(kind=hand))


def contact_row(cell: Cell, episodes: int) -> np.ndarray:
    """Contacts felt on the object or near it; those accepted, and of these those off by more than
    `FAR_MM`; and both counts if places that only the model tells were accepted, too."""
    block = run_block(cell, np.arange(episodes), "cpu")
    columns = contact_columns(block.exploration, block.truth)
    verdict = columns["verdict"]
    off = np.stack([columns[f"{a}_m"] - columns[f"true_{a}_m"] for a in "xyz"])
    far = ~(np.linalg.norm(off, axis=0) * 1e3 <= FAR_MM)
    accepted = columns["accepted"] == 1
    either = accepted | (verdict == UNSURE_BODY)
    return np.array([((verdict != "") & (verdict != TABLE)).sum(), accepted.sum(),
                     (accepted & far).sum(), either.sum(), (either & far).sum()])


def interval_row(cell: Cell, episodes: int) -> dict[str, float]:
    """Shares of episodes whose 90 % intervals hold the true volume, of the true surface within
    those of the recovered one (of superquadrics; NaN where there are none), and of episodes whose
    interval is trusted, and of these the share that hold the true volume; half the median width
    of the interval of the volume's logarithm."""
    block = run_block(cell, np.arange(episodes), "cpu")
    belief, recovered = block.exploration.belief, block.recovered
    known = (block.status == "ok") & (recovered.shape != Shape.PRIOR)
    low, high = belief.uncertainty.volume_interval_m3().T
    true = sample_body(block.body, surface=256)
    held = (low < true.volume_m3) & (true.volume_m3 < high)
    turned = known & (recovered.shape == Shape.SUPERQUADRIC)
    pose = block.truth.body_pose
    surface = (true.surface_m @ matrix_of_quaternion(pose[:, 3:]).swapaxes(1, 2)
               + pose[:, None, :3])
    body = Superquadric(*recovered.superquadric)
    away, _ = surface_distance(body, surface)
    within = np.abs(away) < Z * surface_spread(body, belief.uncertainty, belief.felt, surface)
    trusted = known & interval_trusted(belief.uncertainty.signs,
                                       accepted_rms(recovered, belief.evidence))
    return {
        "episodes": float(known.sum()), "volume": float(held[known].mean()),
        "surface": float(within[turned].mean()) if turned.any() else float("nan"),
        "half_width": float(np.median(np.log(high / low)[known]) / 2),
        "trusted": float(trusted.sum() / max(known.sum(), 1)),
        "trusted_volume": float(held[trusted].mean()) if trusted.any() else float("nan")}
