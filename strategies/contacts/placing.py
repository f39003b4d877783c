"""The kernel that places contacts on a believed body, and what it needs of the hand."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import warp as wp

from strategies.contacts.chain_placing_kernel import chain_placing_kernel
from strategies.contacts.finger_touch import TouchedLinks
from strategies.contacts.placing_kernel import _placing_kernel
from warpgrasp.chain.chain_hand import chain_of_table, true_chains
from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.chain_closing.chain_closing import no_chain_errors
from warpgrasp.chain_closing.chain_path import padded
from warpgrasp.core.dtypes import vec3, vec4
from warpgrasp.mechanism.utah_mit_hand import hand_of
from warpgrasp.parameters import ContactTable


@dataclass(frozen=True)
class Placing:
    """A kernel, and its arguments that depend on the hand."""

    kernel: Any
    hand: Mapping[str, Any]
    shapes: Mapping[str, str]
    """Of `hand`."""
    rows: Mapping[str, wp.array]
    """Joints, torques, their deviations and the links' probabilities, (world, point)."""


def placing_of(links: TouchedLinks, device: str) -> Placing:
    """The kernel for the contacts of a hand."""
    chain = chain_of_table(links.hand)
    joints, weights, given = vec4, vec3, {"hand": hand_of(links.hand)}
    if chain is not None:
        joints = weights = vec6
        given = {"hands": true_chains(chain, links.hand, ContactTable(), no_chain_errors(chain),
                                      device)}
    rows = {}
    for name, values, kind in (
            ("q", links.q_rad, joints), ("torque", links.torque_Nm, joints),
            ("torque_sigma", links.torque_sigma_Nm, joints),
            ("link_weight", links.weight, weights)):
        if chain is not None:
            values = padded(values)
            if name == "torque_sigma":
                values[..., links.q_rad.shape[-1]:] = 1.0
        rows[name] = wp.array(values, dtype=kind, device=device)
    if chain is None:
        return Placing(_placing_kernel, given, {}, rows)
    return Placing(chain_placing_kernel, given, {"hands": "1 finger"}, rows)
