"""Guarded closing of any hand in MuJoCo: its exported model with the capsules that it touches with.

Masses are set to those of the simulator, which weighs a link by the hull of its shapes; capsules
side by side would be weighed twice. A link does not meet the links of its own finger. Joints that
follow others are held to them by stiff equality constraints, each to the servo of its own finger,
for each finger is closed for itself; they have no stops of their own.
"""

from collections.abc import Sequence

import numpy as np

from sweeps.validate.comparison import engine
from sweeps.validate.mujoco_hand import MujocoFingers
from warpgrasp.chain.chain_hand import ChainHand, fingers_apart, joint_drive
from warpgrasp.export.convex_solids import Solid
from warpgrasp.export.mjcf import mjcf_text
from warpgrasp.export.model_tree import hand_model_tree
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.parameters import ContactTable, HandTable, SensorTable

mujoco = engine("mujoco")
_LEAST_KG = 1e-3
_STIFF = {"solref": (0.002, 1.0), "solimp": (0.9999, 0.9999, 1e-6, 0.5, 2.0)}
"""Of a joint that follows another: it is off by less than 1e-4 degrees."""
_STIFF_STEP_S = 5e-4
_PARTS = 10
"""With friction: torques of the Allegro hand then differ by a third as much from ours."""
_RADIUS_M = 0.01
"""Of gyration, of links: it decides how fast a finger comes to rest, not where."""


class MujocoChain(MujocoFingers):
    """A hand of chains, guarded by the torques of its joints, in units of their threshold.

    The links' weight, at the angles that the joints have, is taken off the torques, less what stops
    bear where nothing touches.
    """

    ahead = 40
    """Links that weigh turn their joints by a twelfth of a radian: 20 degrees are enough."""

    def __init__(self, solids: Sequence[Solid], hand: ChainHand, table: HandTable,
                 sensors: SensorTable, contact: ContactTable) -> None:
        """`contact` says what acts on the fingers."""
        links = hand_model_tree(fingers_apart(hand.model))
        model = mujoco.MjModel.from_xml_string(
            mjcf_text(links, solids, limits=contact.joint_stops))
        found = np.zeros((hand.fingers, hand.links), int)
        for f, finger in enumerate(hand.model.fingers):
            for j, joint in enumerate(finger.joints):
                number = model.body(f"{joint.name}_link").id
                bulk = hand.bulks[f][j]
                mass = max(bulk.volume_m3 * table.link_density_kg_m3, _LEAST_KG * (
                    bulk.volume_m3 == 0.0))
                model.body_mass[number] = mass
                model.body_ipos[number] = bulk.centre_m
                model.body_iquat[number] = [1.0, 0.0, 0.0, 0.0]
                model.body_inertia[number] = mass * _RADIUS_M**2
                found[f, j] = number
        mujoco.mj_setConst(model, mujoco.MjData(model))
        super().__init__(model, contact, skin_N_m=table.skin_stiffness_N_m,
                         stop_Nm_rad=table.joint_stop_Nm_rad)
        self.hand, self.sensors = hand, sensors
        self.parts = _PARTS if contact.friction else 1
        self._stop_Nm_rad = table.joint_stop_Nm_rad if contact.joint_stops else 0.0
        self._palm_place = np.linalg.inv(matrix_of(hand.model.grasp_frame))
        self._led = []
        """Of each finger its joints: their numbers, which servos turn them, factors and shifts."""
        for f, finger in enumerate(hand.model.fingers):
            count = len(finger.joints)
            self._finger[found[f, :count]], self._link[found[f, :count]] = f, np.arange(count)
            numbers = np.array([model.joint(joint.name).id for joint in finger.joints])
            driven = numbers[list(hand.drives[f])]
            self._joints.append(driven)
            self._servos.append(np.array([
                np.flatnonzero(model.actuator_trnid[:, 0] == j)[0] for j in driven]))
            self._led.append((numbers, *map(np.array, zip(
                *(joint_drive(hand, f, j) for j in range(count)), strict=True))))
            model.jnt_limited[np.setdiff1d(numbers, driven)] = 0
        if model.neq:
            model.eq_solref[:], model.eq_solimp[:] = _STIFF["solref"], _STIFF["solimp"]
            model.opt.timestep = min(model.opt.timestep, _STIFF_STEP_S)
        self._last = [found[f, len(finger.joints) - 1]
                      for f, finger in enumerate(hand.model.fingers)]

    def pose(self, q_rad: np.ndarray) -> None:
        """As of `MujocoFingers`, with the joints that follow."""
        for (joints, servos, factor, shift), q in zip(self._led, q_rad, strict=True):
            self.data.qpos[joints] = factor * q[servos] + shift

    def readings(self, torque_Nm: list[np.ndarray], delta_rad: np.ndarray) -> np.ndarray:
        """As of `MujocoFingers`: torques less what weight makes, and friction of the gears [N m].
        """
        low, high = self.model.jnt_range.T
        found = []
        for f, joints in enumerate(self._joints):
            moving = np.sign(np.round(delta_rad[f, :len(joints)], 12))
            weight = np.zeros(len(joints))
            led, servos, factor, _ = self._led[f]
            np.add.at(weight, servos, factor * self.data.qfrc_bias[led])  # at rest gravity alone
            read = torque_Nm[f] - weight + self.sensors.torque_friction_Nm * moving
            if self._stop_Nm_rad > 0.0:
                spring = np.array([self.hand.model.fingers[f].joints[j].stiffness_Nm_rad
                                   for j in self.hand.drives[f]])
                hangs = self.data.ctrl[self._servos[f]] - weight / spring
                past = hangs - np.clip(hangs, low[joints], high[joints])
                read -= past / (1.0 / spring + 1.0 / self._stop_Nm_rad)
            found.append(np.abs(read).max())
        return np.array(found)

    def tip(self, finger: int) -> np.ndarray:
        """As of `MujocoFingers`."""
        d, number = self.data, self._last[finger]
        return d.xpos[number] + d.xmat[number].reshape(3, 3) @ np.array(
            self.hand.model.fingers[finger].tip_m)
