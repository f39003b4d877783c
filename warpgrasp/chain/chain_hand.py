"""Any hand on the host, as its kernels take it: the tables of its chains.

The hand's frame is the model's grasp frame. A finger is moved by its drives, in order: those of its
joints that follow no other joint of the finger. Of joints that follow one of another finger the
first counts as a drive, which is commanded alike, and leads the others; so fingers remain apart.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.chain.chain_kernel import CAPSULES, JOINTS, Chain, ChainCapsule, ChainJoint
from warpgrasp.core.struct_array import record_type
from warpgrasp.hands.hand_frames import link_frames, matrix_of, place_of, posture_angles
from warpgrasp.hands.hand_model import (
    Capsule,
    Finger,
    Follow,
    HandClosing,
    HandError,
    HandJoint,
    HandModel,
)
from warpgrasp.hands.touch_shapes import Bulk, bulk_of, palmar_directions, touch_model
from warpgrasp.mechanism.calibration import Calibration
from warpgrasp.mechanism.utah_mit_weight import GRAVITY_M_S2
from warpgrasp.parameters import UTAH_MIT, ContactTable, HandTable

_NO_SERVO = 1.0
_WAY_STEPS = 16
_SHORTEST_M = 1e-6
"""A ball is a capsule as long: distances of two of them need a direction."""


@dataclass(frozen=True)
class ChainHand:
    """A hand whose fingers are chains, SI. Drives that a finger has not stand at zero."""

    model: HandModel
    """With capsules for all shapes (`touch_shapes`)."""
    drives: tuple[tuple[int, ...], ...]
    """Of each finger the number of each drive's joint within it."""
    numbers: tuple[tuple[int, ...], ...]
    """Of each finger the number of each drive's angle in a configuration of the hand; for a joint
    that follows another finger's, of the joint it follows."""
    capsules: tuple[tuple[Capsule, ...], ...]
    """Of each finger, from its first joint on; each ends towards the tip."""
    capsule_joint: tuple[tuple[int, ...], ...]
    """The joint within the finger that bears each."""
    palm: tuple[Capsule, ...]
    """In the hand's frame."""
    bulks: tuple[tuple[Bulk, ...], ...]
    """Of each finger's links: what the shapes of the hand's file weigh, not the capsules."""

    @property
    def fingers(self) -> int:
        """How many fingers."""
        return len(self.model.fingers)

    @property
    def width(self) -> int:
        """Drives of the finger that has most: arrays of angles end in (finger, width)."""
        return max(len(own) for own in self.drives)

    @property
    def links(self) -> int:
        """Joints of the finger that has most: a contact's link is the number of its joint."""
        return max(len(finger.joints) for finger in self.model.fingers)


@lru_cache(maxsize=16)
def chain_of(model: HandModel) -> ChainHand:
    """The hand of a model. Raises HandError for a finger of more than six joints."""
    touched = touch_model(model)
    known = {joint.name: n for n, joint in enumerate(touched.driven)}
    drives, numbers, capsules, bearing = [], [], [], []
    for finger in touched.fingers:
        if len(finger.joints) > JOINTS:
            raise HandError(f"finger {finger.name} has {len(finger.joints)} joints; should have "
                            f"{JOINTS} at most")
        mine = tuple(j for j, follow in enumerate(_within(finger)) if follow is None)
        drives.append(mine)
        numbers.append(tuple(known[_leader(finger, j)] for j in mine))
        found = [(_outward(c, _next_m(finger, j)), j) for j, joint in enumerate(finger.joints)
                 for c in joint.shapes if isinstance(c, Capsule)]
        capsules.append(tuple(c for c, _ in found))
        bearing.append(tuple(j for _, j in found))
    inverse = np.linalg.inv(matrix_of(touched.grasp_frame))
    palm = tuple(_outward(_moved(shape, inverse), np.zeros(3)) for shape in touched.palm
                 if isinstance(shape, Capsule))
    bulks = tuple(tuple(bulk_of(joint.shapes) for joint in finger.joints)
                  for finger in model.fingers)
    return ChainHand(touched, tuple(drives), tuple(numbers), tuple(capsules), tuple(bearing), palm,
                     bulks)


def hand_of_kind(kind: str) -> HandModel:
    """The model of a table's kind: the name of a hand that ships, or a TOML file. Raises HandError.
    """
    # What reads files is not imported where the hand is the Utah-MIT's.
    from warpgrasp.hands.hand_file import SHIPPED, hand_from_file, hand_named

    if kind in SHIPPED or not kind.endswith(".toml"):
        return hand_named(kind)  # which says what there is
    try:
        changed = Path(kind).stat()
    except OSError:
        return hand_from_file(Path(kind))  # which says what is wrong
    return _hand_of_file(kind, changed.st_mtime_ns, changed.st_size)


@lru_cache(maxsize=16)
def _hand_of_file(kind: str, changed_ns: int, size: int) -> HandModel:
    """The hand of a file; `changed_ns` and `size` only tell versions of the file apart."""
    from warpgrasp.hands.hand_file import hand_from_file

    return hand_from_file(Path(kind))


def chain_of_table(table: HandTable) -> ChainHand | None:
    """The hand that a table names; None for the Utah-MIT hand. Raises HandError."""
    return None if table.kind == UTAH_MIT else chain_of(hand_of_kind(table.kind))


def drive_angles(hand: ChainHand, q_rad: np.ndarray) -> np.ndarray:
    """Angles of every finger's drives (..., finger, width) of configurations (..., driven) of the
    hand [rad]; drives of other fingers' joints as far as these lead them."""
    found = np.zeros((*q_rad.shape[:-1], hand.fingers, hand.width))
    for f, finger in enumerate(hand.model.fingers):
        for d, (joint, number) in enumerate(zip(hand.drives[f], hand.numbers[f], strict=True)):
            follows = finger.joints[joint].follows
            factor, shift = (1.0, 0.0) if follows is None else (follows.factor, follows.offset_rad)
            found[..., f, d] = factor * q_rad[..., number] + shift
    return found


def tip_places(hand: ChainHand, q_rad: np.ndarray) -> np.ndarray:
    """Places of the tips in the hand's frame [m], (..., finger, 3), of drives (..., finger, width).
    """
    return np.stack([link_frames_of(hand, f, q_rad[..., f, :])[..., -1, :3, :]
                     @ np.array([*finger.tip_m, 1.0])
                     for f, finger in enumerate(hand.model.fingers)], -2)


def capsule_ends(hand: ChainHand, finger: int, q_rad: np.ndarray) -> np.ndarray:
    """Both ends of a finger's capsules in the hand's frame [m], (..., capsule, 2, 3), of its drives
    (..., width)."""
    frames = link_frames_of(hand, finger, q_rad)
    ends = np.array([[(*c.start, 1.0), (*c.end, 1.0)] for c in hand.capsules[finger]])
    borne = frames[..., list(hand.capsule_joint[finger]), :3, :]
    return np.einsum("...cij,cej->...cei", borne, ends.reshape(-1, 2, 4))


def link_frames_of(hand: ChainHand, finger: int, q_rad: np.ndarray) -> np.ndarray:
    """Frames of a finger's links in the hand's frame, (..., joint, 4, 4), of its drives."""
    flat = q_rad.reshape(-1, q_rad.shape[-1])
    alone = _alone(hand.model, finger)
    own = link_frames(alone, flat[:, :len(alone.driven)])[0]
    inverse = np.linalg.inv(matrix_of(hand.model.grasp_frame))
    return np.asarray(inverse @ own).reshape(*q_rad.shape[:-1], -1, 4, 4)


@lru_cache(maxsize=64)
def _alone(model: HandModel, finger: int) -> HandModel:
    """The hand with one finger."""
    return replace(model, fingers=(fingers_apart(model).fingers[finger],))


def fingers_apart(model: HandModel) -> HandModel:
    """The hand with fingers that lead themselves: of the joints that follow one of another finger,
    the first follows none and leads the others."""
    return replace(model, fingers=tuple(
        replace(own, joints=tuple(replace(joint, follows=follow) for joint, follow in zip(
            own.joints, _within(own), strict=True))) for own in model.fingers))


def _within(finger: Finger) -> list[Follow | None]:
    """Which joint of its own finger each joint follows; None of a drive."""
    own = {joint.name for joint in finger.joints}
    found: list[Follow | None] = []
    first: dict[str, HandJoint] = {}  # of those that follow a joint of another finger, by that one
    for joint in finger.joints:
        follow = joint.follows
        if follow is not None and follow.joint not in own:
            lead = first.get(follow.joint)
            if lead is None or lead.follows is None:
                if follow.factor:
                    first[follow.joint] = joint
                follow = None
            else:
                factor = follow.factor / lead.follows.factor
                follow = Follow(lead.name, factor,
                                follow.offset_rad - factor * lead.follows.offset_rad)
        found.append(follow)
    return found


def chain_rows(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of Chain (world or 1, finger), whose addresses are still to be set, of ChainJoint
    (world or 1, finger, `JOINTS`), and of ChainCapsule (world or 1, finger, `CAPSULES`).

    A link's length stretches all that stands in its frame; the place of a finger's base shifts its
    first joint.
    """
    worlds = errors.worlds
    chains = np.zeros((worlds, hand.fingers), record_type(Chain))
    joints = np.zeros((worlds, hand.fingers, JOINTS), record_type(ChainJoint))
    capsules = np.zeros((worlds, hand.fingers, CAPSULES), record_type(ChainCapsule))
    toward = palmar_sides(hand)
    inverse = np.linalg.inv(matrix_of(hand.model.grasp_frame))
    chains["stop"] = table.joint_stop_Nm_rad if contact.joint_stops else 0.0
    chains["skin"], chains["friction"] = table.skin_stiffness_N_m, contact.friction
    chains["weighs"] = contact.weight and table.link_density_kg_m3 > 0.0
    for f, finger in enumerate(hand.model.fingers):
        stretch = 1.0 + errors.link_length_share[:, f]
        reach = np.zeros(worlds)
        for j, joint in enumerate(finger.joints):
            place = joint.place if j else place_of(inverse @ matrix_of(joint.place))
            row = joints[:, f, j]
            row["place"] = place
            if j:
                row["place"][:, :3] *= stretch[:, j - 1, None]
                row["arm"] = np.linalg.norm(row["place"][:, :3], axis=1)
            else:
                row["place"][:, :3] += errors.finger_base_m[:, f]
            row["axis"] = joint.axis
            row["drive"], row["factor"], row["shift"] = joint_drive(hand, f, j)
            bulk = hand.bulks[f][j]
            row["weight"] = bulk.volume_m3 * table.link_density_kg_m3 * GRAVITY_M_S2
            row["centre"] = np.array(bulk.centre_m) * stretch[:, j, None]
            reach += row["arm"]
        chain = chains[:, f]
        chain["joint_count"], chain["drives"] = len(finger.joints), len(hand.drives[f])
        chain["capsule_count"] = len(hand.capsules[f])
        chain["tip"] = np.array(finger.tip_m) * stretch[:, len(finger.joints) - 1, None]
        chain["stiffness"] = _NO_SERVO
        for d, j in enumerate(hand.drives[f]):
            joint = finger.joints[j]
            chain["stiffness"][:, d] = joint.stiffness_Nm_rad
            chain["offset"][:, d] = errors.joint_offset_rad[:, f, d]
            chain["low"][:, d] = joint.low_rad - errors.joint_offset_rad[:, f, d]
            chain["high"][:, d] = joint.high_rad - errors.joint_offset_rad[:, f, d]
        for c, (capsule, j) in enumerate(zip(hand.capsules[f], hand.capsule_joint[f],
                                             strict=True)):
            row = capsules[:, f, c]
            row["joint"], row["radius"] = j, capsule.radius
            row["start"] = np.array(capsule.start) * stretch[:, j, None]
            row["end"] = np.array(capsule.end) * stretch[:, j, None]
            row["palmar"] = toward[f][c]
            row["far"] = np.linalg.norm([row["start"], row["end"]], axis=2).max(0)
        beyond = np.zeros(worlds)  # from a joint to the farthest place that it moves
        for j in reversed(range(len(finger.joints))):
            borne = capsules[:, f]["far"] * (capsules[:, f]["joint"] == j)
            beyond = np.maximum(beyond, borne.max(1))
            row = joints[:, f, j]
            chain["levers"][np.arange(worlds), row["drive"]] += np.abs(row["factor"]) * beyond
            beyond = beyond + row["arm"]
        far = capsules[:, f]["far"].max(1)
        chain["reach"] = reach + np.maximum(far, np.linalg.norm(chain["tip"], axis=1))
    return chains, joints, capsules


@lru_cache(maxsize=8)
def true_chains(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration, device: str
) -> wp.array:
    """The true fingers as kernels take them, (world or 1, finger); without errors those believed.

    A drive's stops are where its sensor reads its limits: the zeros are set by them.
    """
    chains, joints, capsules = chain_rows(hand, table, contact, errors)
    kept = (wp.array(joints, dtype=ChainJoint, device=device),
            wp.array(capsules, dtype=ChainCapsule, device=device))
    for name, rows in zip(("joints", "capsules"), kept, strict=True):
        number = np.arange(chains.size, dtype=np.uint64).reshape(chains.shape)
        address: Any = rows.ptr
        stride: Any = rows.strides[1]
        chains[name] = np.uint64(address) + number * np.uint64(stride)
    found = wp.array(chains, dtype=Chain, device=device)
    found._ref = kept  # as long as the fingers live, so do their rows
    return found


def joint_reaches(arm_m: np.ndarray) -> np.ndarray:
    """From each joint to the joint of each link beyond it, stretched out [m], (..., joint, joint),
    0 before it; of ways from joint to joint (..., joint)."""
    way = arm_m.cumsum(-1)
    return np.triu(way[..., None, :] - way[..., :, None])


def weight_moments(joints: np.ndarray) -> np.ndarray:
    """The most that links' weight turns each joint with [N m], (..., joint), of rows of ChainJoint
    (..., joint)."""
    arm = joint_reaches(joints["arm"]) + np.linalg.norm(joints["centre"], axis=-1)[..., None, :]
    return np.asarray((np.triu(arm) * joints["weight"][..., None, :]).sum(-1))


def joint_drive(hand: ChainHand, finger: int, joint: int) -> tuple[int, float, float]:
    """The drive of a joint, its factor and its shift [rad]."""
    if joint in hand.drives[finger]:
        return hand.drives[finger].index(joint), 1.0, 0.0
    follows = _within(hand.model.fingers[finger])[joint]
    assert follows is not None
    names = [hand.model.fingers[finger].joints[j].name for j in hand.drives[finger]]
    return names.index(follows.joint), follows.factor, follows.offset_rad


def _next_m(finger: Finger, joint: int) -> np.ndarray:
    """Where the next joint, or the tip, stands in a joint's frame [m], (3,)."""
    if joint + 1 < len(finger.joints):
        return np.array(finger.joints[joint + 1].place[:3])
    return np.array(finger.tip_m)


def _outward(capsule: Capsule, toward_m: np.ndarray) -> Capsule:
    """The capsule, its end the nearer one to a place, and its axis not without length."""
    start, end = (np.linalg.norm(toward_m - np.array(at)) for at in (capsule.start, capsule.end))
    if capsule.start == capsule.end:
        x, y, z = capsule.start
        return replace(capsule, end=(x, y, z + _SHORTEST_M))
    return capsule if end <= start else replace(capsule, start=capsule.end, end=capsule.start)


def _leader(finger: Finger, joint: int) -> str:
    follows = finger.joints[joint].follows
    return finger.joints[joint].name if follows is None else follows.joint


def _moved(capsule: Capsule, matrix: np.ndarray) -> Capsule:
    start, end = ((float(x), float(y), float(z)) for x, y, z in (
        matrix[:3, :3] @ np.array(at) + matrix[:3, 3] for at in (capsule.start, capsule.end)))
    return Capsule(start, end, capsule.radius, capsule.fit_error_m)


@lru_cache(maxsize=16)
def palmar_sides(hand: ChainHand) -> list[np.ndarray]:
    """The side that each capsule closes towards along the hand's first closing path, in its link's
    frame, (capsule, 3) a finger."""
    closing = hand.model.closings[0] if hand.model.closings else None
    found = []
    for f in range(hand.fingers):
        axes = np.array([np.subtract(c.end, c.start) for c in hand.capsules[f]]).reshape(-1, 3)
        moved = np.zeros_like(axes)
        if closing is not None and len(axes):
            q = closing_way(hand, closing, _WAY_STEPS)[f]
            middle = capsule_ends(hand, f, q).mean(2)
            turns = link_frames_of(hand, f, q)[:-1, list(hand.capsule_joint[f]), :3, :3]
            moved = np.einsum("scij,sci->cj", turns, np.diff(middle, axis=0))
        found.append(palmar_directions(moved, axes))
    return found


def closing_way(hand: ChainHand, closing: HandClosing, steps: int) -> np.ndarray:
    """Drives along a closing path, evenly, [rad], (finger, step, width)."""
    start, end = (posture_angles(hand.model, hand.model.posture(name))
                  for name in (closing.start, closing.end))
    names = [joint.name for joint in hand.model.driven]
    moves = np.array([name in closing.moves for name in names])
    share = np.linspace(0.0, 1.0, steps)[:, None]
    return np.moveaxis(drive_angles(hand, start + share * np.where(moves, end - start, 0.0)), 1, 0)


def padded(q: np.ndarray) -> np.ndarray:
    """Angles of drives (..., width) with zeros up to six, contiguous."""
    return np.ascontiguousarray(np.pad(q, [*[(0, 0)] * (q.ndim - 1), (0, JOINTS - q.shape[-1])]),
                                np.float64)
