"""A block of episodes of one cell, from placing the objects to the rows of results.

    cell + episode numbers → placed objects → procedures → evidence → fits → scores → rows

An episode's object, pose, told cylinder and noise come from (study seed, object, episode number)
alone: the same for every strategy and setting, whatever block it runs in.
"""

from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np

from fit.status import FitStatus, status_names
from fit.superquadric import SuperquadricFit
from fit.superquadric_shape import Superquadric
from strategies.containment import explore_by_containment
from strategies.evidence import Evidence, evidence_from_grasps, touched_links
from strategies.recovery import recover_bodies
from strategies.waypoint_poses import waypoint_poses
from strategies.waypoints import BoundingCylinder
from sweeps.cell import Cell
from sweeps.metrics import Scores, score_superquadrics
from warpgrasp.body import Body
from warpgrasp.body_sample import sample_body
from warpgrasp.catalogue import body_from_name, body_from_table
from warpgrasp.counter_random import (
    Purpose,
    counter_key_host,
    counter_normal_host,
    counter_uniform_host,
)
from warpgrasp.parameters import ObjectTable
from warpgrasp.robot import Grasps, Robot, Truth
from warpgrasp.status import ProbeStatus

FEWEST_CONTACTS = 8
"""With fewer contacts no body is fitted: the told cylinder is scored, the status says why."""


TOLD_MARGIN_M = 0.03
"""Three standard deviations of what is told, for telling a body that has run away."""


@dataclass(frozen=True)
class EpisodeBlock:
    """Everything about a block of episodes, for rows, files and figures."""

    body: Body
    truth: Truth
    told: BoundingCylinder
    grasps: Grasps
    evidence: Evidence
    fits: SuperquadricFit
    recovered: Superquadric
    """What is scored: the fit, or the told cylinder where there is none."""
    status: np.ndarray
    scores: Scores


def run_episodes(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
    """Rows of episodes `episodes` (numbers within the study) of a cell, a column each.

    Columns after the file contract of the README; text columns hold str.
    """
    block = run_block(cell, episodes, device)
    closing = block.grasps.closing
    tried = np.isin(closing.status, (ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT))
    probes = block.grasps.moves.status[:, :, 0]
    fits, scores, recovered = block.fits, block.scores, block.recovered
    worlds = len(episodes)
    fitted = block.status == "ok"

    def count(rows: np.ndarray) -> np.ndarray:
        return rows.reshape(worlds, -1).sum(1)

    columns: dict[str, np.ndarray] = {
        "episode": np.asarray(episodes, np.int64),
        "strategy": np.full(worlds, cell.strategy.name),
        "object": np.full(worlds, cell.object_name),
        "seed": np.full(worlds, cell.seed, np.int64),
        "status": block.status,
        "contacts": block.evidence.mask.sum(1),
        "touches": count(tried),
        "probes": count(probes == ProbeStatus.CONTACT),
        "unreachable": count(probes == ProbeStatus.UNREACHABLE),
        "collisions": count(probes == ProbeStatus.COLLISION),
        "robot_time_s": block.grasps.time_s.sum(1),
        "arm_path_m": block.grasps.moves.path_m.sum(1),
        "chamfer_mm": scores.chamfer_m * 1e3,
        "hausdorff95_mm": scores.hausdorff95_m * 1e3,
        "iou": scores.iou,
        "volume_ratio": scores.volume_ratio,
        "coverage5mm": scores.coverage,
        "recognized_as": np.full(worlds, ""),
        "shape": np.where(fitted, "tapered_superquadric" if cell.fit.taper else "superquadric",
                          "told_cylinder"),
    }
    for name, values in recovered_parameters(recovered).items():
        columns[name] = values
    columns["fit_rms_mm"] = np.where(fitted, fits.rms_m * 1e3, np.nan)
    columns["fit_iterations"] = fits.iterations.astype(np.int64)
    columns["fit_status"] = np.array(status_names(fits.status))
    return columns


def run_block(cell: Cell, episodes: np.ndarray, device: str) -> EpisodeBlock:
    """Run a block of episodes and keep all of it."""
    body = cell_body(cell)
    key = counter_key_host(int(cell.seed) & (2**63 - 1), _content_number(body), episodes)
    body_pose = place_objects(cell.placement, key)
    told = tell_cylinder(body, body_pose, cell.placement.prior_sigma_m, key)
    truth = Truth(body_pose)
    robot = Robot([body], np.zeros(1, int), truth, key, cell.arm, cell.hand, cell.sensors,
                  device=device)
    poses = waypoint_poses(cell.strategy.waypoints, told, cell.hand, key)
    grasps = explore_by_containment(robot, poses, np.ones(poses.shape[:2], bool),
                                    cell.strategy.closings)
    evidence = evidence_from_grasps(grasps, cell.hand.link_radius_m)
    links = None
    if cell.sensors.contact_estimator == "intrinsic":
        links = touched_links(grasps, cell.hand.link_radius_m)
    fits, evidence = recover_bodies(evidence, links, cell.fit)
    enough = evidence.mask.sum(1) >= FEWEST_CONTACTS
    good = np.isin(fits.status, (FitStatus.converged, FitStatus.not_converged))
    sane = _plausible(fits, told)
    status = np.where(~enough, "too_few_contacts",
                      np.where(~good, "fit_failed", np.where(sane, "ok", "fit_implausible")))
    recovered = _or_told(fits, told, status == "ok")
    scores = score_superquadrics(recovered, body, body_pose, device=device)
    return EpisodeBlock(body, truth, told, grasps, evidence, fits, recovered, status, scores)


def cell_body(cell: Cell) -> Body:
    """The object of a cell. Raises BodyError."""
    table = dict(cell.body_table)
    if set(table) == {"name"}:
        return body_from_name(table["name"])
    return body_from_table(table, Path())


def _content_number(body: Body) -> int:
    return int(body.content[:15], 16)


def place_objects(placement: ObjectTable, key: np.ndarray) -> np.ndarray:
    """True poses of the objects on the table, (world, 7): yaw at random unless it is given."""
    stream = counter_key_host(key, int(Purpose.PLACEMENT))
    yaw = (2.0 * counter_uniform_host(stream) - 1.0) * pi
    if placement.yaw_rad is not None:
        yaw = np.full(len(key), placement.yaw_rad)
    pose = np.zeros((len(key), 7))
    pose[:, 0], pose[:, 1] = placement.x_m, placement.y_m
    pose[:, 5], pose[:, 6] = np.sin(yaw / 2), np.cos(yaw / 2)
    return pose


def tell_cylinder(
    body: Body, body_pose: np.ndarray, sigma_m: float, key: np.ndarray
) -> BoundingCylinder:
    """The bounding cylinder a strategy is told: the true one with a normal error in each number."""
    surface = sample_body(body).surface_m
    radius = float(np.hypot(surface[:, 0], surface[:, 1]).max())
    stream = counter_key_host(key, int(Purpose.PRIOR))
    error = sigma_m * counter_normal_host(counter_key_host(stream[:, None], np.arange(4)))
    return BoundingCylinder(
        x_m=body_pose[:, 0] + error[:, 0],
        y_m=body_pose[:, 1] + error[:, 1],
        radius_m=np.maximum(radius + error[:, 2], 0.010),
        height_m=np.maximum(body.high_m[2] + error[:, 3], 0.020),
    )


def _plausible(fits: SuperquadricFit, told: BoundingCylinder) -> np.ndarray:
    """Whether a body stays within twice the reach of the cylinder told (and what it may err by).

    Few contacts on one side may let a fit run away; whoever was told the rough size would not
    believe it, and neither is it scored.
    """
    middle = np.stack([told.x_m, told.y_m, told.height_m / 2], axis=1)
    reach = np.hypot(told.radius_m, told.height_m / 2) + TOLD_MARGIN_M
    far = (np.linalg.norm(fits.position_m - middle, axis=1)
           + np.linalg.norm(fits.size_m, axis=1))
    return far <= 2.0 * reach


def _or_told(fits: SuperquadricFit, told: BoundingCylinder, good: np.ndarray) -> Superquadric:
    """The fits, and the told cylinder where there is none."""
    zero = np.zeros_like(told.x_m)
    pick = good[:, None]
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    return Superquadric(
        size_m=np.where(pick, fits.size_m,
                        np.stack([told.radius_m, told.radius_m, told.height_m / 2], 1)),
        exponents=np.where(pick, fits.exponents, [0.1, 1.0]),
        position_m=np.where(pick, fits.position_m,
                            np.stack([told.x_m, told.y_m, told.height_m / 2], 1)),
        quaternion_xyzw=np.where(pick, fits.quaternion_xyzw, upright),
        taper=np.where(pick, fits.taper, np.stack([zero, zero], 1)),
        bend=np.where(pick, fits.bend, np.stack([zero, zero], 1)),
    )


def recovered_parameters(s: Superquadric) -> dict[str, np.ndarray]:
    """Columns of a recovered body's parameters, by the names of the file contract."""
    return {
        "a1_m": s.size_m[:, 0], "a2_m": s.size_m[:, 1], "a3_m": s.size_m[:, 2],
        "eps1": s.exponents[:, 0], "eps2": s.exponents[:, 1],
        "px_m": s.position_m[:, 0], "py_m": s.position_m[:, 1], "pz_m": s.position_m[:, 2],
        "qx": s.quaternion_xyzw[:, 0], "qy": s.quaternion_xyzw[:, 1],
        "qz": s.quaternion_xyzw[:, 2], "qw": s.quaternion_xyzw[:, 3],
        "kx": s.taper[:, 0], "ky": s.taper[:, 1],
        "bend_per_m": s.bend[:, 0], "bend_angle_rad": s.bend[:, 1],
    }


