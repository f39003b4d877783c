"""An episode as a sequence of frames: the pose of arm and fingers, contacts and estimates so far.

Frames come from the robot's own readings: believed hand poses through the arm's inverse kinematics,
and joint commands up to where each finger stopped. Contacts are where the body that stands at the
end has them. The object alone is at its true pose.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from fit.arrays import rows_of
from fit.superquadric.geometry import Superquadric
from strategies.contacts.finger_touch import touched_links
from strategies.exploration_record import Exploration
from strategies.poses.hand_outline import outline_of
from strategies.procedures.possible import extended_of, opposed_of
from strategies.procedures.touches import TouchTable
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.evidence import evidence_from_grasps, slots_of_touches
from strategies.recovery.fit_contacts import recover_bodies
from strategies.recovery.plausibility import FEWEST_CONTACTS
from sweeps.episode.episodes import EpisodeBlock, run_block
from sweeps.figures.meshes import recovered_grid, surface_grid, true_mesh
from sweeps.spec.cell import Cell
from sweeps.spec.errors import StoreError
from warpgrasp.arms.serial_arm import nearest_joints, serial_places
from warpgrasp.chain.chain_hand import chain_of_table, closing_way
from warpgrasp.hand_capsules import capsules_of_hand
from warpgrasp.mechanism.arm import arm_home, floating_joints, is_floating, serial_model
from warpgrasp.mechanism.arm_motion_kernel import RETREAT_M
from warpgrasp.mechanism.puma560 import ALPHA_RAD, puma_inverse_batch
from warpgrasp.parameters import ArmTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps

TRAVEL, APPROACH, CLOSE = 4, 2, 5
"""Frames for a motion between retreats, for one from a retreat to the pose, for a closing."""
FULL_COUNT = 255
"""Full scale of a pad's 8-bit converter."""
FAR_RAD = 0.2
"""Between touches of pads, joint motions larger than this take TRAVEL frames, others one."""
_POST_M = 0.3
"""Height of the post above a floating wrist."""


@dataclass(frozen=True)
class Frame:
    """The robot at one moment; metres, base frame."""

    arm_m: np.ndarray
    """Base and joints of the arm and the hand's origin, (place, 3); how many, the arm says."""
    hand_turn: np.ndarray
    """Of the hand, quaternion xyzw."""
    links_m: np.ndarray
    """Ends of the axes of each finger's links, from its base on, (finger, link, 2, 3)."""
    felt: np.ndarray
    """Strength of each finger's contact in this frame, 0 to 1, (finger,): 1 for a contact of a
    grasp, for a pad its largest count over full scale."""
    contacts: int
    """Number of the replay's contacts made so far."""
    estimate: int
    """Index of the replay's current estimate, -1 before the first."""
    label: str

    def in_base(self, place_m: np.ndarray) -> np.ndarray:
        """Places (..., 3) of the hand's frame in the base frame."""
        turn = Rotation.from_quat(self.hand_turn)
        return self.arm_m[-1] + turn.apply(place_m.reshape(-1, 3)).reshape(place_m.shape)


@dataclass(frozen=True)
class HandShape:
    """The capsules that a hand is made of."""

    link_radius_m: tuple[tuple[float, ...], ...]
    """Of each finger's links."""
    bars_m: np.ndarray
    """Ends of the axes of palm and wrist in the hand's frame, (bar, 2, 3)."""
    bar_radius_m: np.ndarray
    """(bar,)."""


@dataclass(frozen=True)
class Replay:
    """An episode as frames; metres, base frame."""

    title: str
    frames: tuple[Frame, ...]
    contacts_m: np.ndarray
    """In the order in which they were made, (contact, 3)."""
    estimates_m: tuple[np.ndarray, ...]
    """Surfaces estimated after each probe, (row, column, 3)."""
    body_m: np.ndarray
    body_faces: np.ndarray
    hand: HandShape


def make_replay(cell: Cell, block: EpisodeBlock, world: int = 0) -> Replay:
    """The replay of one world of a block. Raises StoreError where the robot did not move."""
    pose = block.truth.body_pose[world]
    vertices, faces = true_mesh(block.body, 24)
    made = _Recording(cell, block, world)
    frames = tuple(made.frames())
    if not frames:
        raise StoreError(f"nothing to replay: the episode ended {block.status[world]}")
    hand = capsules_of_hand(cell.hand)
    score = float(block.scores.chamfer_m[world] * 1e3)
    return Replay(
        f"{cell.strategy.name} on {cell.object_name}: {len(made.contacts)} contacts, chamfer "
        f"{score:.1f} mm", frames, np.array(made.contacts).reshape(-1, 3), tuple(made.estimates),
        Rotation.from_quat(pose[3:]).apply(vertices) + pose[:3], faces,
        HandShape(tuple(tuple(radius[:count].tolist()) for radius, count in zip(
            hand.radius_m, hand.count, strict=True)), hand.bars_m, hand.bar_radius_m))


class _Recording:
    """The arm's joints, contacts and estimates of an episode up to the current frame."""

    def __init__(self, cell: Cell, block: EpisodeBlock, world: int) -> None:
        self.cell, self.block, self.world = cell, block, world
        self.arm = arm_home(cell.arm)
        self.hand = capsules_of_hand(cell.hand)
        chain = chain_of_table(cell.hand)
        self.straight = np.zeros((4, 4)) if chain is None else closing_way(
            chain, chain.model.closings[0], 2)[:, 0]
        self.contacts: list[np.ndarray] = []
        self.estimates: list[np.ndarray] = []
        self.estimate = -1

    def frames(self) -> Iterator[Frame]:
        procedures = [p for p in self.block.exploration.procedures if p.took_part[self.world]]
        alone = len({p.step for p in procedures}) == 1
        fitted = {moment.step: moment.recovered for moment in self.block.moments}
        placed = iter(placed_contacts(self.block.exploration, self.world))
        for number, procedure in enumerate(procedures):
            if isinstance(procedure.felt, Grasps):
                growing = refits(self.cell, procedure.felt, self.world) if alone else []
                yield from self._grasps(procedure.felt, next(placed), growing)
            else:
                yield from self._touches(procedure.name, procedure.felt.touches, next(placed))
            if number + 1 == len(procedures):
                self._believe(self.block.moments[-1].recovered)
                yield self._still("contacts and the last estimate")
            elif procedures[number + 1].step != procedure.step and procedure.step + 1 in fitted:
                self._believe(fitted[procedure.step + 1])
                yield self._still(f"{procedure.name}: fitted again")

    def _believe(self, recovered: Recovered) -> None:
        if recovered.shape[self.world] != Shape.PRIOR:
            self.estimates.append(recovered_grid(recovered, self.world, 12))
            self.estimate = len(self.estimates) - 1

    def _grasps(self, grasps: Grasps, points: np.ndarray, growing: list[np.ndarray | None]
                ) -> Iterator[Frame]:
        commands, step = grasps.commands_rad, grasps.closing.step[self.world]
        status = grasps.closing.status[self.world]
        felt = (status == ProbeStatus.CONTACT) & np.isfinite(points).all(-1)
        opened, fingers = commands[0, :, 0], np.arange(commands.shape[1])
        probes = len(step)
        for probe in range(probes):
            label = "containment" + (f", pose {probe + 1} of {probes}" if probes > 1 else "")
            move = ProbeStatus(int(grasps.moves.status[self.world, probe, 0]))
            if move == ProbeStatus.NOT_TRIED:
                continue
            if move != ProbeStatus.CONTACT:
                yield self._still(f"{label}: {move.name.lower()}")
                continue
            pose = grasps.moves.believed_pose[self.world, probe]
            away = _reach(self.cell, _retreated(pose, RETREAT_M), self.arm)
            there = _reach(self.cell, pose, away)
            yield from self._way(away, TRAVEL, opened, label)
            yield from self._way(there, APPROACH, opened, label)
            for grasp in range(len(commands)):
                last = np.maximum(step[probe, grasp], 0)
                for share in np.arange(1, CLOSE + 1) / CLOSE:
                    at = np.round(share * last).astype(int)
                    yield self._frame(commands[grasp, fingers, at], None, label)
                self.contacts += list(points[probe, grasp][felt[probe, grasp]])
                yield self._frame(commands[grasp, fingers, last], felt[probe, grasp], label)
            if growing and (grid := growing[probe]) is not None:
                self.estimates.append(grid)
                self.estimate = len(self.estimates) - 1
                label = f"{label}: fitted again"
            yield self._frame(opened, None, label)
            self.arm = away

    def _touches(self, name: str, table: TouchTable, points: np.ndarray) -> Iterator[Frame]:
        rows = np.flatnonzero(table.world == self.world)
        hand, pads = self.cell.hand, self.cell.pads
        posture = (extended_of(hand, pads).commands_rad if name == "planar"
                   else opposed_of(hand, pads).open_rad)[:, 0]
        for row in rows:
            label = f"{name}, part {int(table.part[row]) + 1}"
            goal = _reach(self.cell, table.hand_pose[row], self.arm)
            far = np.abs(goal - self.arm).max() > FAR_RAD
            fingers = posture.copy()
            yield from self._way(goal, TRAVEL if far else 1, fingers, label)
            finger = int(table.finger[row])
            fingers[finger] = table.q_rad[row]
            contact = bool(table.status[row] == ProbeStatus.CONTACT)
            if contact:
                self.contacts.append(points[row])
            level = float(table.taxel_peak[row]) / FULL_COUNT if contact else 0.0
            felt = np.where(np.arange(len(posture)) == finger, level, 0.0)
            yield self._frame(fingers, felt, label)

    def _way(self, goal: np.ndarray, count: int, fingers: np.ndarray,
             label: str) -> Iterator[Frame]:
        start = self.arm
        for share in np.arange(1, count + 1) / count:
            self.arm = start + share * (goal - start)
            yield self._frame(fingers, None, label)

    def _still(self, label: str) -> Frame:
        return self._frame(self.straight, None, label)

    def _frame(self, fingers: np.ndarray, felt: np.ndarray | None, label: str) -> Frame:
        cell = self.cell
        joints, turn = arm_points(cell.arm, self.arm, cell.hand.mount_length_m)
        level = np.zeros(len(fingers)) if felt is None else np.asarray(felt, float)
        frame = Frame(joints, turn, self.hand.places(fingers[:, None])[:, 0], level,
                      len(self.contacts), self.estimate, label)
        return replace(frame, links_m=frame.in_base(frame.links_m))


def placed_contacts(found: Exploration, world: int) -> Iterator[np.ndarray]:
    """Of each procedure that the world took part in, where contacts lie: of grasps (probe, grasp,
    finger, 3), of touches of pads (row, 3) in the order of their table [m]. One that the body used
    lies where the body that stands has it, others where they were felt."""
    slot = 0
    for procedure in found.procedures:
        felt, own = procedure.felt, slice(slot, slot + procedure.slots)
        slot += procedure.slots
        used, points = found.placed.mask[world, own], found.placed.points_m[world, own]
        if isinstance(felt, Grasps):
            at = felt.estimate.point_m[world].copy()
            at.reshape(-1, 3)[used] = points[used]
        else:
            at = felt.touches.point_m.copy()
            rows, (worlds, slots) = slots_of_touches(felt.touches, len(found.status),
                                                     procedure.slots)
            mine = worlds == world
            at[rows[mine]] = points[slots[mine]]
        if procedure.took_part[world]:
            yield at


def refits(cell: Cell, grasps: Grasps, world: int) -> list[np.ndarray | None]:
    """Surfaces fitted to the contacts up to each probe; None where there is no new fit.

    An episode of one step is fitted once, at its end; these fits are for the replay alone.
    """
    one = replace(rows_of(grasps, [world]), commands_rad=grasps.commands_rad)
    evidence = evidence_from_grasps(one, outline_of(cell.hand).skin_m)
    links = (touched_links(one, cell.hand, cell.contact)
             if cell.sensors.contact_estimator == "intrinsic" else None)
    probes = one.closing.status.shape[1]
    copies = np.zeros(probes, int)
    every = rows_of(evidence, copies)
    every = replace(every, mask=every.mask & _so_far(every.mask.shape),
                    free_mask=every.free_mask & _so_far(every.free_mask.shape))
    fits, _ = recover_bodies(every, rows_of(links, copies), cell.fit)
    grids: list[np.ndarray | None] = []
    last = 0
    for probe, count in enumerate(every.mask.sum(axis=1)):
        body = Superquadric(*(np.asarray(getattr(fits, name))[probe:probe + 1]
                              for name in Superquadric._fields))
        known = count >= FEWEST_CONTACTS and all(np.isfinite(field).all() for field in body)
        grids.append(surface_grid(body, 12) if known and count > last else None)
        last = int(count)
    return grids


def _so_far(shape: tuple[int, ...]) -> np.ndarray:
    """Mask (probe, slot) of the slots filled up to each probe; every probe fills as many."""
    probes, slots = shape
    return np.arange(probes)[:, None] >= np.arange(slots)[None] // (slots // probes)


def arm_points(arm: ArmTable, q_rad: np.ndarray, mount_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Joints of the arm from the base to the hand's origin, (point, 3), and the hand's quaternion
    xyzw.

    Of the PUMA 560 standard Denavit-Hartenberg frames; the three coincident joints of the wrist are
    given once. A floating wrist is drawn at the foot of a post.
    """
    model = serial_model(arm)
    if model is not None:
        places = serial_places(model, q_rad)
        turn = Rotation.from_quat(places[-1, 3:])
        return np.vstack([places[:, :3], places[-1, :3] + turn.apply([0.0, 0.0, mount_m])]
                         ), turn.as_quat()
    if is_floating(arm):
        turn = Rotation.from_rotvec(q_rad[3:])
        post = q_rad[:3] + np.outer(np.linspace(_POST_M, 0.0, 5), [0.0, 0.0, 1.0])
        return np.vstack([post, q_rad[:3] + turn.apply([0.0, 0.0, mount_m])]), turn.as_quat()
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


def segment_pose(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """The middle of a segment, and a rotation that turns the z axis along it."""
    length = float(np.linalg.norm(b - a))
    if length < 1e-9:
        return a, Rotation.identity()
    along = (b - a) / length
    return (a + b) / 2, Rotation.align_vectors([along], [[0.0, 0.0, 1.0]])[0]


def _reach(cell: Cell, hand_pose: np.ndarray, near: np.ndarray) -> np.ndarray:
    """The arm's joints for a hand pose: those within the limits, of all branches of the inverse and
    whole turns more or less, that are nearest to `near`; where none are within, the nearest."""
    flange = _retreated(hand_pose, cell.hand.mount_length_m)
    if is_floating(cell.arm):
        return floating_joints(flange[None])[0]
    model = serial_model(cell.arm)
    if model is not None:
        found = nearest_joints(model, flange[None], near[None])[0]
        return found if np.isfinite(found).all() else near
    turns = puma_inverse_batch(cell.arm, flange[None])[0] + 2 * np.pi * np.arange(-1, 2)[
        :, None, None]  # (turn, branch, joint)
    far = np.abs(turns - near)
    far += 100.0 * ((turns < cell.arm.limit_low_rad) | (turns > cell.arm.limit_high_rad))
    far = np.where(np.isfinite(far), far, np.inf)
    best = int(far.min(axis=0).max(axis=1).argmin())
    turn = far[:, best].argmin(axis=0)
    return turns[turn, best, np.arange(len(near))] if np.isfinite(far[:, best]).all() else near


def _retreated(pose: np.ndarray, by_m: float) -> np.ndarray:
    """A pose moved back along its own z axis."""
    back = pose.copy()
    back[:3] -= Rotation.from_quat(pose[3:]).apply([0.0, 0.0, by_m])
    return back


def replay_of(task: tuple[Cell, int, str]) -> Replay:
    """Runs an episode again and makes its replay; in a worker, so that it is bit-identical. Raises
    StoreError where there is none."""
    cell, episode, device = task
    try:
        block = run_block(cell, np.array([episode]), device)
    except ValueError as error:
        raise StoreError(f"nothing to replay: the episode fails: {error}") from error
    return make_replay(cell, block)
