"""PUMA 560 kinematics against roboticstoolbox, which has the same table."""

from math import nan
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sweeps.validate.comparison import Comparison, engine
from warpgrasp.mechanism.puma560 import puma_forward_batch, puma_inverse_batch
from warpgrasp.parameters import ArmTable

POSES = 10_000
ANALYTIC_POSES = 500
NEAR = 1e-9  # [m], [rad]
_BRANCHES = tuple(s + e + w for w in "nf" for e in "ud" for s in "rl")  # right or left, ...


def compare_puma(poses: int = POSES) -> list[Comparison]:
    """Forward kinematics, and every inverse branch put back through the toolbox's forward."""
    toolbox = engine("roboticstoolbox")
    robot = toolbox.models.DH.Puma560()
    table = ArmTable()
    rows = _table(robot, table)
    rng = np.random.default_rng(0)
    q = rng.uniform(table.limit_low_rad, table.limit_high_rad, (poses, 6))
    ours = puma_forward_batch(table, q)
    theirs = np.asarray(robot.fkine(q).A).reshape(-1, 4, 4)
    rows += _poses(f"forward, {poses} poses", ours, theirs)
    branches = puma_inverse_batch(table, ours)
    reached = np.isfinite(branches.sum(-1))
    wanted = np.repeat(ours[:, None], 8, 1)[reached]
    rows += _poses(f"inverse then their forward, {reached.sum()} solutions of 8 branches", wanted,
                   np.asarray(robot.fkine(branches[reached]).A).reshape(-1, 4, 4))
    off = np.abs(_turned(branches - q[:, None])).max(-1)
    nearest = np.min(np.where(reached, off, np.inf), axis=1)
    rows.append(Comparison("puma", "configuration the pose came from, nearest branch, p99", "rad",
                           nan, nan, float(np.quantile(nearest, 0.99)), NEAR,
                           f"largest {nearest.max():.2g}, near the wrist's singularity"))
    rows.append(_analytic(robot, table, q[:ANALYTIC_POSES], theirs[:ANALYTIC_POSES]))
    return rows


def _table(robot: Any, table: ArmTable) -> list[Comparison]:
    rows = []
    for name, ours in (("d", table.d_m), ("a", table.a_m)):
        theirs = [float(getattr(link, name)) for link in robot.links]
        worst = int(np.argmax(np.abs(np.subtract(ours, theirs))))
        rows.append(Comparison("puma", f"table: {name}, sum of six", "m", float(np.sum(ours)),
                               float(np.sum(theirs)), float(abs(ours[worst] - theirs[worst])),
                               NEAR))
    return rows


def _poses(what: str, ours: np.ndarray, theirs: Any) -> list[Comparison]:
    apart = np.linalg.norm(ours[:, :3] - theirs[:, :3, 3], axis=1)
    turn = Rotation.from_quat(ours[:, 3:]).as_matrix()
    # Of a small turn, the sine: an arc cosine would drown it in rounding.
    skew = np.einsum("pji,pjk->pik", turn, theirs[:, :3, :3])
    angle = 0.5 * np.linalg.norm(np.stack([
        skew[:, 2, 1] - skew[:, 1, 2], skew[:, 0, 2] - skew[:, 2, 0],
        skew[:, 1, 0] - skew[:, 0, 1]], 1), axis=1)
    return [Comparison("puma", f"{what}: position", "m", nan, nan, float(apart.max()), NEAR),
            Comparison("puma", f"{what}: rotation", "rad", nan, nan, float(angle.max()), NEAR)]


def _analytic(robot: Any, table: ArmTable, q: np.ndarray, poses: np.ndarray) -> Comparison:
    """The toolbox's own closed form: are its solutions among ours?

    A solution of theirs counts if it reaches the pose; the toolbox returns one that does not where
    its closed form does not fit the pose.
    """
    ours = puma_inverse_batch(table, _as_seven(poses))
    found, wrong, worst = 0, 0, 0.0
    for number, pose in enumerate(poses):
        seen = ours[number][np.isfinite(ours[number]).all(-1)]
        for branch in _BRANCHES:
            theirs = robot.ikine_a(pose, branch)
            if not theirs.success or np.abs(robot.fkine(theirs.q).A - pose).max() > NEAR:
                wrong += 1
                continue
            found += 1
            worst = max(worst, float(np.abs(_turned(seen - theirs.q)).max(-1).min()))
    return Comparison("puma", f"their closed form among ours, {found} solutions of {len(q)} poses",
                      "rad", nan, nan, worst, 1e-7, f"{wrong} of theirs do not reach the pose")


def _as_seven(poses: np.ndarray) -> np.ndarray:
    return np.concatenate([poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()], 1)


def _turned(angle: np.ndarray) -> np.ndarray:
    """The equivalent angle in -pi to pi."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
