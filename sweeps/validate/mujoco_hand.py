"""Guarded closing in MuJoCo: the exported hand, its servos commanded step by step, settled at each.

The finger's rest at a command is where the dynamics come to stand. Contacts are given the stiffness
of the skin: with a constant impedance d, MuJoCo's force at rest is stiffness * depth / ((1 - d) A),
A the approximate inverse mass it keeps for each body (its documentation, "Constraint model").

Its friction resists motion, not displacement: a contact that should stick creeps, the slower the
greater `impratio`. At 10 it creeps by as much as the fingers move, and they do not come to rest; at
1e4 they do, within less than a micrometre of where 3e3 steps instead of 600 leave them. The cone is
elliptic: Coulomb's.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sweeps.validate.comparison import engine
from warpgrasp.export.convex_solids import Solid
from warpgrasp.export.mjcf import mjcf_text
from warpgrasp.export.robot_tree import DENSITY_KG_M3, FINGERS, PHALANGES, hand_tree
from warpgrasp.parameters import ContactTable, HandTable, PadTable

mujoco = engine("mujoco")
_IMPEDANCE = 0.9
_STILL_RAD_S = 1e-4
_STEPS_BETWEEN_LOOKS = 10
_MOST_STEPS = 600
_PART_STEPS = 30


@dataclass(frozen=True)
class MujocoStop:
    """The state of one finger where it stopped. NaN and -1 without a stop."""

    step: int
    q_rad: np.ndarray
    torque_Nm: np.ndarray
    tip_m: np.ndarray
    link: int
    """Of the largest force (0 proximal to 2 distal), -1: none."""
    point_m: np.ndarray
    """On the object's surface."""
    normal: np.ndarray
    """Out of the object."""
    contacts: int
    """Contacts of this finger with a force."""
    settled: bool
    touch_N: float
    """What the touch sensor of the distal pad's site reads."""


class MujocoFingers(ABC):
    """The fingers of an exported hand before an object that stands on the table at the origin.

    A subclass says which of a model's bodies are which links, how its fingers are guarded, and
    where their tips are.
    """

    ahead = 1
    """Steps that are simulated before the first whose commands touch anything."""
    parts = 1
    """In which a step of the command is led: a finger swings where the command jumps, and friction
    may hold it where it swung to."""

    def __init__(self, model: Any, contact: ContactTable, *, skin_N_m: float,
                 stop_Nm_rad: float) -> None:
        """`contact` says what acts on the fingers; masses are those of the model."""
        self.model, self.data = model, mujoco.MjData(model)
        m = model
        m.opt.iterations, m.opt.ccd_iterations = 100, 100
        m.opt.tolerance, m.opt.ccd_tolerance = 1e-12, 1e-9
        m.opt.impratio = 1e4
        m.opt.gravity[2] = -9.81 if contact.weight else 0.0
        m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD
        ours = m.geom_contype == 1
        if contact.self_contact:  # links meet links too; a body never meets its parent
            m.geom_conaffinity[ours] |= 1
            m.body_conaffinity[m.body_contype == 1] |= 1
        body = m.geom_bodyid[ours]
        stiffness = skin_N_m * (1.0 - _IMPEDANCE) * np.maximum(m.body_invweight0[body, 0], 1e-9)
        m.geom_solref[ours] = np.stack([-stiffness, -2.0 * np.sqrt(stiffness)], 1)
        m.geom_solimp[ours] = [_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 2.0]
        m.geom_priority[ours] = 1
        stop = stop_Nm_rad * (1.0 - _IMPEDANCE) * m.dof_invweight0
        m.jnt_solref[:] = np.stack([-stop, -2.0 * np.sqrt(stop)], 1)
        m.jnt_solimp[:] = [_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 2.0]
        # Object and table rub, links among themselves do not: of a pair the rougher counts.
        m.geom_condim[ours], m.geom_friction[ours, 0] = 1, 0.0
        stands = m.geom_contype == 2
        m.geom_condim[stands], m.geom_friction[stands, 0] = (
            3 if contact.friction else 1), contact.friction
        m.geom_priority[stands], m.geom_solmix[stands] = 1, 0.0
        self._palm = m.body("palm").id
        self._palm_place = np.eye(4)
        # finger and link of every body: -1 where it is none
        self._finger = np.full(m.nbody, -1)
        self._link = np.full(m.nbody, -1)
        self._joints: list[np.ndarray] = []
        """Of each finger the numbers of the joints that have a servo."""
        self._servos: list[np.ndarray] = []
        """The numbers of these."""

    @abstractmethod
    def readings(self, torque_Nm: list[np.ndarray], delta_rad: np.ndarray) -> np.ndarray:
        """The largest reading of each finger, in units of the thresholds, (finger,)."""
        ...

    @abstractmethod
    def tip(self, finger: int) -> np.ndarray:
        """Place of a finger's tip now [m], (3,)."""
        ...

    def touched(self, finger: int) -> float:
        """What the touch sensor of a finger's distal pad reads [N]; NaN without one."""
        return float("nan")

    def place(self, pose: np.ndarray) -> None:
        """Move the hand: position [m] and quaternion xyzw, (7,)."""
        turn = Rotation.from_quat(pose[3:])
        self.model.body_pos[self._palm] = pose[:3] + turn.apply(self._palm_place[:3, 3])
        palm = turn * Rotation.from_matrix(self._palm_place[:3, :3])
        self.model.body_quat[self._palm] = np.roll(palm.as_quat(), 1)

    def pose(self, q_rad: np.ndarray) -> None:
        """Put the joints where servos (finger, servo) hold them."""
        for joints, q in zip(self._joints, q_rad, strict=True):
            self.data.qpos[joints] = q[:len(joints)]

    def touches(self, q_rad: np.ndarray) -> bool:
        """Whether a hand held by its servos (finger, servo) touches anything."""
        self.pose(q_rad)
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        return self.data.ncon > 0

    def close(self, commands_rad: np.ndarray, thresholds: Sequence[float]
              ) -> list[list[MujocoStop | None]]:
        """Close along (finger, step, servo); where each finger stops at each threshold, in order.

        The stop is decided as the simulator does, without sensor noise, from the actuators'
        torques.
        """
        steps = commands_rad.shape[1]
        found: list[list[MujocoStop | None]] = [[None] * len(thresholds) for _ in self._joints]
        first = 0
        while first < steps and not self.touches(commands_rad[:, first]):
            first += 1  # a finger that touches nothing rests at its command, or sags a little
        first = max(first - self.ahead, 0)
        self.touches(commands_rad[:, first])
        for servos, q in zip(self._servos, commands_rad[:, first], strict=True):
            self.data.ctrl[servos] = q[:len(servos)]
        held = np.zeros(len(self._joints), bool)
        command = commands_rad[:, first].copy()
        for step in range(first, steps):
            delta = commands_rad[:, step] - commands_rad[:, max(step - 1, 0)]
            command[~held] = commands_rad[~held, step]
            settled = self._settle(command)
            torque = [self.data.actuator_force[servos] for servos in self._servos]
            reading = self.readings(torque, delta)
            for f in np.flatnonzero(~held):
                for k, threshold in enumerate(thresholds):
                    if found[f][k] is None and reading[f] > threshold:
                        found[f][k] = self._stop(int(f), step, settled)
                held[f] = found[f][-1] is not None
            if held.all():
                break
        return found

    def _settle(self, command: np.ndarray) -> bool:
        m, d = self.model, self.data
        before = d.ctrl.copy()
        for servos, q in zip(self._servos, command, strict=True):
            d.ctrl[servos] = q[:len(servos)]
        led = d.ctrl.copy()
        for part in range(1, self.parts):
            d.ctrl[:] = before + (led - before) * (part / self.parts)
            mujoco.mj_step(m, d, _PART_STEPS)
        d.ctrl[:] = led
        for _ in range(_MOST_STEPS // _STEPS_BETWEEN_LOOKS):
            mujoco.mj_step(m, d, _STEPS_BETWEEN_LOOKS)
            if np.abs(d.qvel).max() < _STILL_RAD_S:
                break
        mujoco.mj_forward(m, d)
        return bool(np.abs(d.qvel).max() < _STILL_RAD_S)

    def _stop(self, f: int, step: int, settled: bool) -> MujocoStop:
        m, d = self.model, self.data
        link, largest, contacts = -1, 0.0, 0
        point, normal = np.full(3, np.nan), np.full(3, np.nan)
        wrench = np.zeros(6)
        for k in range(d.ncon):
            contact = d.contact[k]
            bodies = m.geom_bodyid[contact.geom]
            mine = np.flatnonzero(self._finger[bodies] == f)
            if len(mine) == 0:
                continue
            mujoco.mj_contactForce(m, d, k, wrench)
            contacts += wrench[0] > 1e-6
            if wrench[0] > largest:
                largest = float(wrench[0])
                link = int(self._link[bodies[mine[0]]])
                # The frame's first axis points from the first geom to the second.
                normal = contact.frame[:3] * (1.0 if mine[0] == 1 else -1.0)
                point = contact.pos - 0.5 * contact.dist * normal  # MuJoCo's is midway
        return MujocoStop(step, d.qpos[self._joints[f]].copy(),
                          d.actuator_force[self._servos[f]].copy(), self.tip(f), link,
                          point.copy(), normal.copy(), int(contacts), settled, self.touched(f))


class MujocoHand(MujocoFingers):
    """The Utah-MIT hand, guarded by its tendons."""

    def __init__(self, solids: Sequence[Solid], hand: HandTable, contact: ContactTable) -> None:
        """`contact` says what acts on the fingers."""
        text = mjcf_text(hand_tree(hand, PadTable()), solids, limits=contact.joint_stops)
        model = mujoco.MjModel.from_xml_string(text)
        model.body_mass *= hand.link_density_kg_m3 / DENSITY_KG_M3
        super().__init__(model, contact, skin_N_m=hand.skin_stiffness_N_m,
                         stop_Nm_rad=hand.joint_stop_Nm_rad)
        self.hand = hand
        self._joints = self._servos = list(np.arange(16).reshape(4, 4))
        for f, finger in enumerate(FINGERS):
            for k, phalanx in enumerate(PHALANGES):
                number = model.body(f"{finger}_{phalanx}").id
                self._finger[number], self._link[number] = f, k
        self._distal = [model.body(f"{finger}_distal").id for finger in FINGERS]

    def readings(self, torque_Nm: list[np.ndarray], delta_rad: np.ndarray) -> np.ndarray:
        """As of `MujocoFingers`: the tension differences, rubbed by Coulomb friction [N]."""
        return np.abs(tension_differences(self.hand, np.array(torque_Nm), delta_rad)).max(1)

    def tip(self, finger: int) -> np.ndarray:
        """As of `MujocoFingers`: its centre."""
        d, number = self.data, self._distal[finger]
        return d.xpos[number] + d.xmat[number].reshape(3, 3)[:, 2] * self.hand.link_length_m[2]

    def touched(self, finger: int) -> float:
        """As of `MujocoFingers`."""
        return float(self.data.sensordata[finger])


def tension_differences(
    hand: HandTable, torque_Nm: np.ndarray, delta_rad: np.ndarray
) -> np.ndarray:
    """Flexor less extensor tension [N] of the three flexions, (finger, 3), independently."""
    pull = torque_Nm[:, 1:] / np.asarray(hand.moment_arm_m[1:])
    slack = np.maximum(hand.co_contraction_N - np.abs(pull) / 2, hand.tension_low_N)
    flexor, extensor = slack + np.maximum(pull, 0.0), slack - np.minimum(pull, 0.0)
    moving = np.where(np.abs(delta_rad[:, 1:]) > 1e-12, np.sign(delta_rad[:, 1:]), 0.0)
    rub = hand.tendon_friction * moving
    return flexor * (1.0 + rub) - extensor * (1.0 - rub)
