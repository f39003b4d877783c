"""Contacts of hands that are chains, placed on believed superquadrics."""

import numpy as np
import warp as wp
from jaxtyping import Bool

from strategies.contacts.field_placing import FieldPlaces
from strategies.contacts.finger_touch import TouchedLinks
from warpgrasp.chain.chain_hand import chain_of_table, true_chains
from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.core.dtypes import mat33, real, transform, vec3
from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.parameters import ContactTable


def chain_places(
    links: TouchedLinks, asked: Bool[np.ndarray, "world point"], shape: wp.array, pose: wp.array,
    *, lean_share: float, place_sigma_m: float, turn_sigma_rad: float, farthest_m: float,
    normal_sigma_m: float, device: str = "cpu",
) -> FieldPlaces:
    """The likeliest places of the contacts `asked`, by torques and by the superquadrics of which
    `shape` and `pose` (world,) are the kernels' arrays.

    The numbers are those of `strategies.recovery.fit_contacts`. Raises ShapeError where shapes
    disagree.
    """
    # Imported for hands that are chains alone.
    from strategies.contacts.chain_placing_kernel import chain_placing_kernel
    from warpgrasp.chain_closing.chain_closing import no_chain_errors
    from warpgrasp.chain_closing.chain_path import padded

    chain = chain_of_table(links.hand)
    assert chain is not None
    hands = true_chains(chain, links.hand, ContactTable(), no_chain_errors(chain), device)
    felt = {"q": links.q_rad, "torque": links.torque_Nm, "torque_sigma": links.torque_sigma_Nm,
            "link_weight": links.weight}
    felt = {name: padded(values) for name, values in felt.items()}
    felt["torque_sigma"][..., links.q_rad.shape[-1]:] = 1.0
    given = {name: array_of(values, kind, device) for name, values, kind in (
        *((name, values, vec6) for name, values in felt.items()),
        ("kept", asked, wp.bool), ("hand_pose", links.hand_pose, transform),
        ("finger", links.finger, int), ("lean", lean_share * links.friction, real))}
    found = {name: wp.empty(asked.shape, dtype=kind, device=device) for name, kind in (
        ("point", vec3), ("covariance", mat33), ("normal", vec3), ("chance", real),
        ("misfit", real))}
    launch(chain_placing_kernel, {"world": asked.shape[0], "point": asked.shape[1]}, {
        "shape": "world", "pose": "world", "hands": "1 finger",
        **dict.fromkeys((*given, *found), "world point")}, {
        "shape": shape, "pose": pose, "hands": hands, "place_sigma": place_sigma_m,
        "turn_sigma": turn_sigma_rad, "farthest": farthest_m,
        "normal_variance": normal_sigma_m**2, **given, **found}, device=device)
    return FieldPlaces(*(values.numpy() for values in found.values()))
