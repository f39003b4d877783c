"""An episode as frames to look at: where arm and fingers are, what is felt, what is believed.

Made from the robot's own readings: believed hand poses through the arm's inverse kinematics, and
joint commands up to where each finger stopped. Only the object is drawn where it truly stands.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fit.superquadric_shape import Superquadric
from strategies.evidence import evidence_from_grasps, touched_links
from strategies.recovery import recover_bodies
from sweeps.cell import Cell
from sweeps.episodes import FEWEST_CONTACTS, EpisodeBlock
from sweeps.figure_contacts import surface_grid
from warpgrasp.arm_hand import HOME_RAD, RETREAT_M, arm_hand_links
from warpgrasp.body_mesh import body_mesh
from warpgrasp.parameters import ArmTable
from warpgrasp.puma560 import ALPHA_RAD, puma_inverse_batch
from warpgrasp.status import ProbeStatus

TRAVEL, APPROACH, CLOSE = 4, 2, 5
"""Frames of a way between retreats, of one from a retreat to the pose, of a closing."""


@dataclass(frozen=True)
class Frame:
    """One moment."""

    arm_m: np.ndarray
    """Joints of the arm and the hand's origin, (6, 3)."""
    hand_turn: np.ndarray
    """Of the hand, quaternion xyzw."""
    fingers_m: np.ndarray
    """Base, flexion joints and tip of each finger, (4, 5, 3)."""
    felt: np.ndarray
    """Which fingers feel something now, (4,)."""
    contacts: int
    """How many of the replay's contacts have been made."""
    estimate: int
    """Which of the replay's estimates is believed, -1: none yet."""
    label: str


@dataclass(frozen=True)
class Replay:
    """An episode, ready to be drawn; metres, base frame."""

    title: str
    frames: tuple[Frame, ...]
    contacts_m: np.ndarray
    """In the order they were felt, (contact, 3)."""
    estimates_m: tuple[np.ndarray, ...]
    """Surfaces believed after each probe, (row, column, 3)."""
    body_m: np.ndarray
    body_faces: np.ndarray
    link_radius_m: float


def make_replay(cell: Cell, block: EpisodeBlock, world: int = 0) -> Replay:
    """Frames of one world of a block."""
    pose = block.truth.body_pose[world]
    vertices, faces = body_mesh(block.body, 24)
    status = block.grasps.closing.status[world]
    points = block.grasps.estimate.point_m[world]
    felt = (status == ProbeStatus.CONTACT) & np.isfinite(points).all(-1)
    estimates, believed = _estimates(cell, block, world)
    frames = tuple(_frames(cell, block, world, felt, believed))
    score = float(block.scores.chamfer_m[world] * 1e3)
    return Replay(
        f"{cell.strategy.name} on {cell.object_name}: {felt.sum()} contacts, chamfer "
        f"{score:.1f} mm", frames, points[felt], estimates,
        Rotation.from_quat(pose[3:]).apply(vertices) + pose[:3], faces, cell.hand.link_radius_m)


def _estimates(cell: Cell, block: EpisodeBlock, world: int) -> tuple[
        tuple[np.ndarray, ...], list[int]]:
    """The body fitted to what was felt up to each probe, and which of them holds after each."""
    one = _world(block.grasps, world)
    evidence = evidence_from_grasps(one, cell.hand.link_radius_m)
    links = (touched_links(one, cell.hand.link_radius_m)
             if cell.sensors.contact_estimator == "intrinsic" else None)
    probes = one.closing.status.shape[1]
    every = _repeated(evidence, probes)
    every = replace(every, mask=every.mask & _so_far(every.mask.shape),
                    free_mask=every.free_mask & _so_far(every.free_mask.shape))
    fits, _ = recover_bodies(every, None if links is None else _repeated(links, probes), cell.fit)
    grids, believed, last = [], [], 0
    counts = every.mask.sum(axis=1)
    for probe in range(probes):
        body = Superquadric(*(np.asarray(getattr(fits, name))[probe:probe + 1]
                              for name in Superquadric._fields))
        if counts[probe] >= FEWEST_CONTACTS and counts[probe] > last and all(
                np.isfinite(field).all() for field in body):
            grids.append(surface_grid(body, 12))
            last = int(counts[probe])
        believed.append(len(grids) - 1)
    return tuple(grids), believed


def _so_far(shape: tuple[int, ...]) -> np.ndarray:
    """Which slots of (probe, slot) were filled by then: the same number by each probe."""
    probes, slots = shape
    return np.arange(probes)[:, None] >= np.arange(slots)[None] // (slots // probes)


def _repeated(record: Any, times: int) -> Any:
    """A record of one world, that many times."""
    return replace(record, **{name: np.repeat(value, times, axis=0)
                              for name, value in vars(record).items()
                              if isinstance(value, np.ndarray)})


def _world(grasps: Any, world: int) -> Any:
    """A record of one world, from a record of many, however deep."""
    if isinstance(grasps, np.ndarray):
        return grasps[world:world + 1]
    values = {name: _world(value, world) for name, value in vars(grasps).items()}
    if "commands_rad" in values:
        values["commands_rad"] = grasps.commands_rad
    return type(grasps)(**values)


def _frames(cell: Cell, block: EpisodeBlock, world: int, felt: np.ndarray,
            believed: list[int]) -> Iterator[Frame]:
    grasps = block.grasps
    commands, step = grasps.commands_rad, grasps.closing.step[world]
    opened = commands[0, :, 0]
    arm = np.asarray(HOME_RAD, float)
    made, estimate = 0, -1
    probes = len(step)
    for probe in range(probes):
        label = f"containment, pose {probe + 1} of {probes}"
        status = ProbeStatus(int(grasps.moves.status[world, probe, 0]))
        if status != ProbeStatus.CONTACT:
            yield _frame(cell, arm, opened, None, made, estimate,
                         f"{label}: {status.name.lower()}")
            continue
        pose = grasps.moves.believed_pose[world, probe]
        away = _reach(cell, _backed(pose, RETREAT_M), arm)
        there = _reach(cell, pose, away)
        for start, end, count in ((arm, away, TRAVEL), (away, there, APPROACH)):
            for share in np.arange(1, count + 1) / count:
                yield _frame(cell, start + share * (end - start), opened, None, made, estimate,
                             label)
        for grasp, name in enumerate(cell.strategy.closings):
            now = f"{label}, {name}"
            last = np.maximum(step[probe, grasp], 0)
            for share in np.arange(1, CLOSE + 1) / CLOSE:
                at = np.round(share * last).astype(int)
                yield _frame(cell, there, commands[grasp, np.arange(4), at], None, made,
                             estimate, now)
            made += int(felt[probe, grasp].sum())
            q = commands[grasp, np.arange(4), last]
            yield _frame(cell, there, q, felt[probe, grasp], made, estimate, now)
        estimate = believed[probe]
        yield _frame(cell, there, opened, None, made, estimate, f"{label}: fitted again")
        arm = away
    yield _frame(cell, arm, opened, None, made, estimate, "what was felt, and what is believed")


def _frame(cell: Cell, arm: np.ndarray, fingers: np.ndarray, felt: np.ndarray | None, made: int,
           estimate: int, label: str) -> Frame:
    joints, turn = arm_points(cell.arm, arm, cell.hand.mount_length_m)
    points, _ = arm_hand_links(cell.arm, cell.hand, np.concatenate([arm, fingers.ravel()])[None])
    return Frame(joints, turn, points[0], np.zeros(4, bool) if felt is None else felt, made,
                 estimate, label)


def arm_points(arm: ArmTable, q_rad: np.ndarray, mount_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Where the arm's links meet, from the base to the hand's origin, (6, 3), and its turn.

    Standard Denavit-Hartenberg frames; what coincides (the wrist's three) is given once.
    """
    at, turn = np.zeros(3), Rotation.identity()
    points = [at]
    for n, (theta, d, a, alpha) in enumerate(zip(q_rad, arm.d_m, arm.a_m, ALPHA_RAD, strict=True)):
        turn = turn * Rotation.from_euler("z", theta)
        at = at + turn.apply([a, 0.0, d])
        turn = turn * Rotation.from_euler("x", alpha)
        if n < 4:
            points.append(at)
    points.append(at + turn.apply([0.0, 0.0, mount_m]))
    return np.array(points), turn.as_quat()


def _reach(cell: Cell, hand_pose: np.ndarray, near: np.ndarray) -> np.ndarray:
    """The arm's joints for a hand pose, the branch nearest to where it is."""
    flange = _backed(hand_pose, cell.hand.mount_length_m)
    branches = puma_inverse_batch(cell.arm, flange[None])[0]
    branches = branches + 2 * np.pi * np.round((near - branches) / (2 * np.pi))
    low, high = np.array(cell.arm.limit_low_rad), np.array(cell.arm.limit_high_rad)
    far = np.abs(branches - near).max(axis=1)
    far = np.where(((branches < low) | (branches > high)).any(axis=1), far + 100.0, far)
    best = int(np.argmin(np.where(np.isfinite(far), far, np.inf)))
    return branches[best] if np.isfinite(far[best]) else near


def _backed(pose: np.ndarray, by_m: float) -> np.ndarray:
    """A pose moved back along its own z."""
    back = pose.copy()
    back[:3] -= Rotation.from_quat(pose[3:]).apply([0.0, 0.0, by_m])
    return back
