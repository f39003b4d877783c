"""Why an episode's grasps touched little, for the one who reads its row: the truth is known here.

The space that fingers close in is taken as a box before the palm: as wide as the gap between thumb
and fingers, as long as a finger. How far the object is from it, and on which side, says what is
wrong with a waypoint.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from fit.arrays import rows_of
from strategies.exploration_record import Exploration
from strategies.poses.hand_outline import outline_of
from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import BoundingCylinder, Ring, Top
from strategies.procedures.touches import REASON_TEXT, EndReason
from warpgrasp.geometry.body import Body
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.mechanism.arm_reach import nearest_reachable, pose_reachable
from warpgrasp.parameters import ArmTable, HandTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps, Truth

_SLAB_M = 0.010
_LEAST_M = 0.002
_NO_PLACE_M = 10.0
"""Positions beyond are perhaps in millimetres."""
UNTRIED = "it did not try: its strategy wanted nothing"
UNSEEN_AXIS = "contour.axis stereo: the cameras saw no axis, so that an upright one was followed"
_WIDE = 1.3
"""A prior this many times as wide as the object is worth a word."""


def why_untouched(
    exploration: Exploration, bodies: list[Body], truth: Truth,
    prior: BoundingCylinder, arm: ArmTable, hand: HandTable,
) -> np.ndarray:
    """A sentence for each world without a contact, else empty, (world,).

    `bodies` has one entry a world.
    """
    worlds = len(bodies)
    found = np.full(worlds, "", object)
    grasps = [(p.asked_pose, p.felt, truth.closings[p.closing]) for p in exploration.procedures
              if isinstance(p.felt, Grasps) and p.asked_pose is not None]
    asked = np.concatenate([np.zeros((worlds, 0, 7)), *(pose for pose, _, _ in grasps)], 1)
    status = np.concatenate([np.zeros((worlds, 0), int),
                             *(felt.moves.status[:, :, 0] for _, felt, _ in grasps)], 1)
    tried = status != ProbeStatus.NOT_TRIED
    unfelt = np.zeros(worlds, bool)
    for _, felt, true in grasps:
        free = felt.closing.status == ProbeStatus.NO_CONTACT
        unfelt |= (free & true.pressed).any((1, 2, 3))
    silent = ~exploration.belief.evidence.mask.any(1)
    for world in np.flatnonzero(silent & ~tried.any(1)).tolist():
        found[world] = (_why_ended(exploration, world)
                        or _out_of_reach(rows_of(prior, np.array([world])), arm, hand) or UNTRIED)
    for world in np.flatnonzero(silent & tried.any(1)).tolist():
        mine = status[world][tried[world]]
        poses = asked[world][tried[world]]
        there = np.isin(mine, (ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT))
        if there.any():
            found[world] = _why_missed(poses[there], bodies[world], truth.body_pose[world], prior,
                                       world, hand, bool(unfelt[world]))
            continue
        out = poses[mine == ProbeStatus.UNREACHABLE]
        every = _poses(len(poses))
        strikes = "the open hand would strike the object or the table"
        if len(out) == len(poses):
            found[world] = (f"the arm reaches none of {every}, {_nearest_text(out[0], arm, hand)}")
        elif len(out):
            found[world] = (f"the arm does not reach {len(out)} of {every}, "
                            f"{_nearest_text(out[0], arm, hand)}; at the others {strikes}")
        else:
            found[world] = f"{strikes} at all of {every}"
    return found


def mostly_itself(exploration: Exploration) -> np.ndarray:
    """A sentence for each world of whose fingers' stops more than three in four were taken for the
    hand's own links, else empty, (world,)."""
    status = [p.felt.closing.status for p in exploration.procedures if isinstance(p.felt, Grasps)]
    own, at_object = (sum(((s == which).sum((1, 2, 3)) for s in status),
                          np.zeros(len(exploration.status), int))
                      for which in (ProbeStatus.SELF_CONTACT, ProbeStatus.CONTACT))
    return np.array([f"{n} of {n + m} stops of fingers were taken for the hand's own links"
                     if n > 3 * m else "" for n, m in zip(own, at_object, strict=True)], object)


def without_axis(exploration: Exploration, unseen: np.ndarray) -> np.ndarray:
    """A sentence for each world whose contour was followed about an upright axis because cameras
    saw none, `unseen` bool (world,), else empty."""
    followed = np.zeros(len(unseen), bool)
    for procedure in exploration.procedures:
        if procedure.name == "contour":
            followed |= procedure.took_part
    return np.where(unseen & followed, UNSEEN_AXIS, "")


def _why_ended(exploration: Exploration, world: int) -> str:
    """Why what felt with pads ended in a world, each reason once; empty where nothing did."""
    return "; ".join(dict.fromkeys(
        f"{p.name}: {REASON_TEXT[EndReason(p.felt.reason[world])]}"
        for p in exploration.procedures
        if not isinstance(p.felt, Grasps) and p.took_part[world]))


def _out_of_reach(prior: BoundingCylinder, arm: ArmTable, hand: HandTable) -> str:
    """That no pose around and above the object of one world is reached, if so: planners do not ask
    for such poses."""
    poses, = waypoint_poses((Ring(), Top()), prior, hand, np.zeros(1, np.uint64))
    if any(pose_reachable(arm, hand, pose) for pose in poses):
        return ""
    return (f"the arm reaches none of {_poses(len(poses))} around the object, such as "
            f"{_place(poses[0])}")


def _poses(count: int) -> str:
    return "1 pose" if count == 1 else f"{count} poses"


def _nearest_text(pose: np.ndarray, arm: ArmTable, hand: HandTable) -> str:
    text = f"such as {_place(pose)}"
    metres = np.concatenate([pose[:3] / 1000, pose[3:]])
    if np.abs(pose[:3]).max() > _NO_PLACE_M and pose_reachable(arm, hand, metres):
        return f"{text}: positions are in metres, not millimetres ({_place(metres)} is reachable)"
    near = nearest_reachable(arm, hand, pose)
    return text + (": turned so, the arm reaches no place" if near is None else
                   f"; the nearest that it reaches, turned so, is {_place(near)}")


def _place(pose: np.ndarray) -> str:
    return "({}) m".format(", ".join(f"{round(float(v), 3):g}" for v in pose[:3]))


def _why_missed(poses: np.ndarray, body: Body, body_pose: np.ndarray, prior: BoundingCylinder,
                world: int, hand: HandTable, unfelt: bool) -> str:
    points = Rotation.from_quat(body_pose[3:]).apply(sample_body(body).surface_m) + body_pose[:3]
    outline = outline_of(hand)
    side = np.array([outline.half_gap_m, outline.half_side_m, 0.0])
    long = outline.reach_m + outline.skin_m
    turns = Rotation.from_quat(poses[:, 3:])
    gaps, ways = [], []
    for pose, turn in zip(poses, turns, strict=True):
        seen = turn.inv().apply(points - pose[:3])
        inside = np.clip(seen, [-side[0], -side[1], 0.0], [side[0], side[1], long])
        apart = np.linalg.norm(seen - inside, axis=1)
        near = int(apart.argmin())
        gaps.append(float(apart[near]))
        ways.append(turn.apply(seen[near] - inside[near]))
    best = int(np.argmin(gaps))
    closed = f"fingers closed at {_poses(len(poses))} and touched"
    if gaps[best] < _LEAST_M and unfelt:
        return f"{closed} the object, but the sensors did not feel it"
    if gaps[best] < _LEAST_M:
        text = f"{closed} nothing: they stayed open around the object"
    else:
        text = f"{closed} nothing: at the nearest they closed {1e3 * gaps[best]:.0f} mm " + _side(
            ways[best], turns[best].apply([0.0, 0.0, 1.0]))
    wide = _half_width(points, poses[best], turns[best])
    given = float(prior.radius_m[world])
    if given > _WIDE * wide:
        text += (f"; the prior, {1e3 * given:.0f} mm in radius, is {given / wide:.1f} times as "
                 "wide as the object there")
    return text


def _side(to_object: np.ndarray, approach: np.ndarray) -> str:
    """Where a hand is whose object lies `to_object` of it."""
    way = to_object / np.linalg.norm(to_object)
    if way[2] < -0.7:
        return "above the object"
    if way[2] > 0.7:
        return "below the object"
    return "short of the object" if way @ approach > 0.7 else "beside the object"


def _half_width(points: np.ndarray, pose: np.ndarray, turn: Rotation) -> float:
    """Half the width of the object across the approach, at the height the hand aims at [m]."""
    approach = turn.apply([0.0, 0.0, 1.0])
    axis = points[:, :2].mean(0)
    level = approach[:2] @ approach[:2]
    way = (axis - pose[:2]) @ approach[:2] / level if level > 0.01 else 0.0
    height = np.clip(pose[2] + way * approach[2], points[:, 2].min(), points[:, 2].max())
    slab = points[np.abs(points[:, 2] - height) <= _SLAB_M]
    if len(slab) < 2:
        slab = points
    across = turn.apply([1.0, 0.0, 0.0])[:2]
    size = np.linalg.norm(across)
    across = across / size if size > 0.3 else turn.apply([0.0, 1.0, 0.0])[:2]
    return float(max(np.ptp(slab[:, :2] @ across) / 2, 1e-3))
