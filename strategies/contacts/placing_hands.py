"""What kernels that place contacts take of a hand, the Utah-MIT's or one that is chains: which they
are, and links and torques as they have them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from jaxtyping import Bool, Int

from strategies.contacts.finger_touch import TouchedLinks
from warpgrasp.chain.chain_hand import chain_of_table, true_chains
from warpgrasp.core.array_checks import check_range
from warpgrasp.core.dtypes import transform, vec3, vec4
from warpgrasp.core.kernel_launch import array_of
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, hand_of
from warpgrasp.parameters import ContactTable, HandTable

ENOUGH_TORQUES = 4
"""Of a finger, by which they tell which link touched, where along it, which way the surface looks
and how hard."""


@dataclass(frozen=True)
class PlacingHand:
    """One hand's kernels, and what they take. A finger's links are capsules where it is a chain."""

    station: Any
    superquadric_field: Any
    placing: Any
    hand: Any
    """Warp's struct of the hand, or an array of its fingers."""
    shapes: dict[str, str]
    """Of `hand`, as `launch` has it."""
    joint_vector: Any
    """Warp's type of joints and torques, with room for more than a finger has."""
    link_vector: Any
    """The same of weights, which a chain has by joint."""
    joint_of: Int[np.ndarray, "finger link"]
    """Which weight is each link's; -1 where a finger has fewer."""

    @property
    def links(self) -> int:
        """Of the finger that has most."""
        return self.joint_of.shape[1]

    def stood(self, links: TouchedLinks, device: str) -> dict[str, wp.array]:
        """How fingers stood. Raises ValueError for a finger that the hand has not."""
        check_range("links.finger", links.finger, 0, len(self.joint_of) - 1)
        return {"hand_pose": array_of(links.hand_pose, transform, device),
                "q": _array(links.q_rad, self.joint_vector, device),
                "finger": array_of(links.finger, int, device)}

    def weights(self, links: TouchedLinks, device: str) -> dict[str, wp.array]:
        """How likely each link is."""
        return {"link_weight": _array(links.weight, self.link_vector, device)}

    def torques(self, links: TouchedLinks, device: str) -> dict[str, wp.array]:
        """What joints felt, and how they had gone; those that a finger has not felt nothing."""
        return {"torque": _array(links.torque_Nm, self.joint_vector, device),
                "torque_sigma": _array(links.torque_sigma_Nm, self.joint_vector, device, 1.0),
                "step": _array(links.step_rad, self.joint_vector, device)}


def placing_hand(table: HandTable, device: str) -> PlacingHand:
    """The kernels of a table's hand; without errors, as it is believed. Raises HandError."""
    chain = chain_of_table(table)
    if chain is None:
        from strategies.contacts import field_placing_kernel as own

        return PlacingHand(
            own.station_kernel, own.superquadric_field_kernel, own.field_placing_kernel,
            hand_of(table), {}, vec4, vec3,
            np.tile(np.arange(len(table.link_length_m)), (FINGER_COUNT, 1)))
    # Imported for hands that are chains alone.
    from strategies.contacts import chain_placing_kernel as theirs
    from warpgrasp.chain.chain_kernel import vec6
    from warpgrasp.chain_closing.chain_path import no_chain_errors

    joint_of = np.full((chain.fingers, max(map(len, chain.capsule_joint))), -1)
    for finger, joints in enumerate(chain.capsule_joint):
        joint_of[finger, :len(joints)] = joints
    return PlacingHand(
        theirs.chain_station_kernel, theirs.chain_field_kernel, theirs.chain_placing_kernel,
        true_chains(chain, table, ContactTable(), no_chain_errors(chain), device),
        {"hand": "1 finger"}, vec6, vec6, joint_of)


def told_by_torques(links: TouchedLinks) -> Bool[np.ndarray, "world point"]:
    """Of which contacts the torques alone say about where on the finger they are: not of fingers
    with few drives, or with a switch."""
    chain = chain_of_table(links.hand)
    if chain is None:
        return np.ones(links.finger.shape, bool)
    torques = chain.model.senses in ("joint_torques", "tendons")
    told = np.array([torques and len(own) >= ENOUGH_TORQUES for own in chain.drives])
    return told[links.finger]


def _array(values: np.ndarray, kind: Any, device: str, fill: float = 0.0) -> wp.array:
    """Rows of `values` as vectors, with `fill` where these have room for more."""
    room = kind._length_ - values.shape[-1]
    if room:
        values = np.pad(values, [*[(0, 0)] * (values.ndim - 1), (0, room)], constant_values=fill)
    return array_of(values, kind, device)
