"""Utah-MIT hand: where every finger's links are, for kernels and on the host.

Hand frame: z is the approach direction along which straight fingers point; the three fingers stand
at x = -gap/2, y = -spacing, 0, +spacing, the thumb at x = +gap/2, palmar sides facing each other.
Finger frame: origin at the finger's base, x palmar, z along the straight finger. Joint 0 abducts
(positive towards the finger's +y), joints 1 to 3 flex (positive inward). All axes of 1 to 3 are
parallel, so a finger lies in one plane, turned by the abduction.
"""

from functools import lru_cache

import numpy as np
import warp as wp

from warpgrasp.core.array_checks import check_array
from warpgrasp.core.dtypes import vec3, vec4
from warpgrasp.core.kernel_launch import array_of, launch, poses_of
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, _links_kernel
from warpgrasp.mechanism.utah_mit_weight import (
    limit_misfit,
    link_weights,
    overlap_misfit,
    weight_askew,
    weight_bounds,
    weight_misfit,
)
from warpgrasp.parameters import ContactTable, HandTable

FINGER_COUNT = 4
LINK_COUNT = 3  # proximal, middle, distal


@lru_cache(maxsize=32)
def hand_of(table: HandTable, contact: ContactTable | None = None) -> Hand:
    """The kernels' hand, not to be changed; the default of `contact` is `ContactTable()`, for those
    who ask where links are and not where they rest. Raises ValueError for what `overlap_misfit`,
    `limit_misfit` and, with a `contact`, `weight_misfit` say."""
    if wrong := (overlap_misfit(table) or limit_misfit(table)
                 or (weight_misfit(table, contact) if contact else "")):
        raise ValueError(wrong)
    contact = contact or ContactTable()
    hand = Hand()
    hand.abduction_offset = table.abduction_offset_m
    hand.link_length = vec3(*table.link_length_m)
    hand.link_radius = table.link_radius_m
    hand.spacing, hand.gap = table.finger_spacing_m, table.palm_gap_m
    hand.palm_thickness = table.palm_thickness_m
    hand.stiffness, hand.skin = table.joint_stiffness_Nm_rad, table.skin_stiffness_N_m
    hand.friction = contact.friction
    hand.stop = table.joint_stop_Nm_rad if contact.joint_stops else 0.0
    hand.low = vec4(table.abduction_limit_rad[0], *table.flexion_low_rad)
    hand.high = vec4(table.abduction_limit_rad[1], *table.flexion_high_rad)
    if contact.weight:
        weight = link_weights(table)
        hand.askew = weight_askew(table)
        _, sag, hand.lean = weight_bounds(table, weight)
        hand.weight, hand.sag = vec3(*weight), vec3(*sag)
    return hand


def hand_links(
    table: HandTable, hand_pose: np.ndarray, q_rad: np.ndarray, *, device: str = "cpu"
) -> tuple[np.ndarray, np.ndarray]:
    """Places of every joint and tip, and palmar normals, of whole hands.

    `hand_pose` (pose, 7) is position [m] and quaternion xyzw, `q_rad` (pose, finger 4, joint 4).
    Returns points [m], shape (pose, 4, 5, 3): base, three flexion joints, tip centre; and unit
    palmar normals, shape (pose, 4, link 3, 3); both in the frame of `hand_pose`. Raises TypeError
    and ValueError for other arrays, and ValueError for a pose that is no place and unit quaternion.
    """
    check_array("hand_pose", hand_pose, "numbers", "pose 7")
    check_array("q_rad", q_rad, "numbers", "pose 4 4", pose=len(hand_pose))
    count = len(hand_pose)
    points = wp.empty((count, FINGER_COUNT, 5), dtype=vec3, device=device)
    palmar = wp.empty((count, FINGER_COUNT, LINK_COUNT), dtype=vec3, device=device)
    launch(_links_kernel, {"pose": count, "finger": FINGER_COUNT},
           {"hand_pose": "pose", "q": "pose finger", "joint_point": "pose finger 5",
            "palmar": "pose finger 3"},
           {"hand": hand_of(table),
            "hand_pose": poses_of("hand_pose", hand_pose, device),
            "q": array_of(q_rad, vec4, device),
            "joint_point": points, "palmar": palmar}, device=device)
    return points.numpy().copy(), palmar.numpy().copy()
