"""Guarded closing of any hand in MuJoCo: its exported model with the capsules that it touches with.

Masses are set to those of the simulator, which weighs a link by the hull of its shapes; capsules
side by side would be weighed twice. A link does not meet the links of its own finger.
"""

from collections.abc import Sequence

import numpy as np

from sweeps.validate.comparison import engine
from sweeps.validate.mujoco_hand import MujocoFingers
from warpgrasp.chain.chain_hand import ChainHand
from warpgrasp.export.convex_solids import Solid
from warpgrasp.export.mjcf import mjcf_text
from warpgrasp.export.model_tree import hand_model_tree
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.parameters import ContactTable, HandTable, SensorTable

mujoco = engine("mujoco")
_LEAST_KG = 1e-3
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
        links = hand_model_tree(hand.model)
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
        for f, finger in enumerate(hand.model.fingers):
            for j in range(len(finger.joints)):
                self._finger[found[f, j]], self._link[found[f, j]] = f, j
            self._joints.append(np.array([
                model.joint(finger.joints[j].name).id for j in hand.drives[f]]))
        self._last = [found[f, len(finger.joints) - 1]
                      for f, finger in enumerate(hand.model.fingers)]

    def readings(self, torque_Nm: list[np.ndarray], delta_rad: np.ndarray) -> np.ndarray:
        """As of `MujocoFingers`: torques less what weight makes, and friction of the gears [N m].
        """
        weight = self.data.qfrc_bias  # at rest gravity alone
        low, high = self.model.jnt_range.T
        found = []
        for f, joints in enumerate(self._joints):
            moving = np.sign(np.round(delta_rad[f, :len(joints)], 12))
            read = torque_Nm[f] - weight[joints] + self.sensors.torque_friction_Nm * moving
            if self._stop_Nm_rad > 0.0:
                spring = np.array([self.hand.model.fingers[f].joints[j].stiffness_Nm_rad
                                   for j in self.hand.drives[f]])
                led = self.data.ctrl[joints] - weight[joints] / spring
                past = led - np.clip(led, low[joints], high[joints])
                read -= past / (1.0 / spring + 1.0 / self._stop_Nm_rad)
            found.append(np.abs(read).max())
        return np.array(found)

    def tip(self, finger: int) -> np.ndarray:
        """As of `MujocoFingers`."""
        d, number = self.data, self._last[finger]
        return d.xpos[number] + d.xmat[number].reshape(3, 3) @ np.array(
            self.hand.model.fingers[finger].tip_m)
