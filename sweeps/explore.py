"""One episode with all that was felt: contacts.csv, shape.json and a figure."""

import csv
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fit.status import status_names
from strategies.strategy import Strategy
from sweeps.atomic import write_atomic
from sweeps.cell import Cell
from sweeps.episodes import EpisodeBlock, recovered_parameters, run_block
from sweeps.figure_contacts import draw_contacts
from warpgrasp.parameters import ObjectTable
from warpgrasp.status import ProbeStatus

HAND_COLUMNS = ("hand_x_m", "hand_y_m", "hand_z_m", "hand_qx", "hand_qy", "hand_qz", "hand_qw")
COLUMNS = (
    "procedure", "probe", "grasp", "finger", "link", "status", "x_m", "y_m", "z_m",
    "true_x_m", "true_y_m", "true_z_m", "true_nx", "true_ny", "true_nz",
    "q0_rad", "q1_rad", "q2_rad", "q3_rad", "tension_difference_N", "taxel_peak", *HAND_COLUMNS,
)


def explore(
    *, body_table: Mapping[str, Any], strategy: Strategy, seed: int, yaw_rad: float | None,
    x_m: float, y_m: float, out: Path, device: str,
) -> None:
    """Run one episode and write `contacts.csv`, `shape.json` and `contacts.png` into `out`.

    `body_table` names the object as in a spec; `yaw_rad` None turns it at random. Raises BodyError
    for an object that cannot be built, OSError where `out` cannot be written.
    """
    name = str(body_table.get("name") or Path(str(body_table.get("mesh", "object"))).stem)
    cell = Cell(strategy, body_table, name, seed=seed,
                placement=ObjectTable(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad))
    block = run_block(cell, np.arange(1), device)
    write_atomic(out / "contacts.csv", contacts_csv(block).encode())
    write_atomic(out / "shape.json", (json.dumps(shape_record(cell, block), indent=2) + "\n")
                 .encode())
    write_atomic(out / "contacts.png", draw_contacts(block, name))


def contacts_csv(block: EpisodeBlock, world: int = 0) -> str:
    """Every guarded closing of one world, a line each, tried or not; text of a CSV file.

    x, y, z are where the robot believes the contact to be (in the end: contacts used by the fit as
    they were placed for it). Truth is there for the reader; no strategy or fit sees it.
    """
    closing, truth = block.grasps.closing, block.truth.closings[0]
    estimate, moves = block.grasps.estimate, block.grasps.moves
    placed = block.evidence.points_m[world]
    used = block.evidence.mask[world]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    shape = closing.status.shape[1:]
    for slot, (p, g, f) in enumerate(np.ndindex(*shape)):
        at = (world, p, g, f)
        believed = placed[slot] if used[slot] else estimate.point_m[at]
        writer.writerow([
            "containment", p, g, f, int(truth.link[at]),
            ProbeStatus(int(closing.status[at])).name.lower(),
            *_cells(believed), *_cells(truth.point_m[at]), *_cells(truth.normal[at]),
            *_cells(closing.q_rad[at]), *_cells([closing.tension_difference_N[at]]),
            "", *_cells(moves.believed_pose[world, p])])
    return text.getvalue()


def _cells(values: Any) -> list[str]:
    return ["" if not np.isfinite(v) else f"{float(v):.6f}" for v in values]


def shape_record(cell: Cell, block: EpisodeBlock, world: int = 0) -> dict[str, Any]:
    """What `shape.json` holds: the recovered models, the chosen one, and its scores."""
    scores, fits = block.scores, block.fits
    parameters = {k: float(v[world]) for k, v in recovered_parameters(block.recovered).items()}
    ok = str(block.status[world]) == "ok"
    kind = ("tapered_superquadric" if cell.fit.taper else "superquadric") if ok else "told_cylinder"
    model = {"shape": kind, "parameters": parameters,
             "rms_mm": float(fits.rms_m[world] * 1e3) if ok else None,
             "status": status_names(fits.status)[world], "contacts": int(fits.n_points[world])}
    pose = block.truth.body_pose[world]
    return {
        "object": cell.object_name,
        "strategy": cell.strategy.name,
        "seed": cell.seed,
        "status": str(block.status[world]),
        "models": [model],
        "chosen": kind,
        "recognized_as": None,
        "true_pose": {"x_m": float(pose[0]), "y_m": float(pose[1]),
                      "yaw_rad": float(2 * np.arctan2(pose[5], pose[6]))},
        "metrics": {
            "chamfer_mm": float(scores.chamfer_m[world] * 1e3),
            "hausdorff95_mm": float(scores.hausdorff95_m[world] * 1e3),
            "iou": float(scores.iou[world]),
            "volume_ratio": float(scores.volume_ratio[world]),
            "coverage5mm": float(scores.coverage[world]),
            "robot_time_s": float(block.grasps.time_s[world].sum()),
            "arm_path_m": float(block.grasps.moves.path_m[world].sum()),
        },
        "grid_error_mm": block.body.grid_error_m * 1e3,
    }
