"""From actions to probes: where the hand grasps, which face or contour the pads follow."""

from collections.abc import Sequence

import numpy as np

from strategies.planners.next_procedure import contour_to_follow, faces_to_cross
from strategies.planners.probes import CrossFaces, Grasp, Probe
from strategies.poses.hand_poses import pose_about
from strategies.poses.waypoints import Placement
from strategies.recovery.belief import Belief
from sweeps.spec.cell import Cell

PROCEDURES = ("containment", "planar", "contour")
AIMS = 4
"""Numbers that say where; one more says which procedure, if there are several."""


def action_size(procedures: Sequence[str]) -> int:
    """Numbers of one world's action."""
    return AIMS + (len(procedures) > 1)


def chosen_procedure(actions: np.ndarray, procedures: Sequence[str]) -> np.ndarray:
    """The number of the procedure that each world's action asks for, (world,)."""
    if len(procedures) == 1:
        return np.zeros(len(actions), int)
    share = (np.clip(actions[:, AIMS], -1.0, 1.0) + 1.0) / 2.0
    return np.minimum((share * len(procedures)).astype(int), len(procedures) - 1)


def probes_of(actions: np.ndarray, procedures: Sequence[str], belief: Belief,
              cell: Cell) -> list[Probe]:
    """The probes of actions (world, size) in [-1, 1], each wanted in the worlds that chose it."""
    aimed = np.clip(actions[:, :AIMS], -1.0, 1.0)
    chosen = chosen_procedure(actions, procedures)
    probes: list[Probe] = []
    for number, name in enumerate(procedures):
        wanted = chosen == number
        if not wanted.any():
            continue
        if name == "containment":
            probes.append(Grasp(_hand_pose(aimed, belief), wanted[:, None]))
        elif name == "planar":
            probes.append(_face(aimed, belief, cell, wanted))
        else:
            probes.append(contour_to_follow(belief, cell.contour, wanted))
    return probes


def _hand_pose(aimed: np.ndarray, belief: Belief) -> np.ndarray:
    usual = Placement()
    return pose_about(
        belief.prior, np.pi * aimed[:, :1], np.pi / 4 * (aimed[:, 1:2] + 1), np.pi * aimed[:, 2:3],
        (aimed[:, 3:4] + 1) / 2, 0.0, usual.palm_clearance_m, usual.clearance_per_radius,
        belief.hand)


def _face(aimed: np.ndarray, belief: Belief, cell: Cell, wanted: np.ndarray) -> CrossFaces:
    """The face of the body believed whose outward normal is nearest to where the hand would be."""
    faces = faces_to_cross(belief, cell.planar, wanted)
    assert faces.wanted is not None
    azimuth = np.pi * aimed[:, 0] + belief.prior.front()
    tilt = np.pi / 4 * (aimed[:, 1] + 1)
    out = np.stack([np.cos(azimuth) * np.sin(tilt), np.sin(azimuth) * np.sin(tilt),
                    np.cos(tilt)], -1)
    near = np.where(faces.wanted, np.einsum("wfi,wi->wf", faces.normal, out), -np.inf)
    pick = near.argmax(1)[:, None, None]
    return CrossFaces(np.take_along_axis(faces.point_m, pick, 1),
                      np.take_along_axis(faces.normal, pick, 1),
                      np.take_along_axis(faces.wanted, pick[..., 0], 1), faces.options)
