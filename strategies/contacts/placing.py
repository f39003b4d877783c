"""The kernel that places contacts on a believed body, and what it needs of the hand."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import warp as wp

from strategies.contacts.finger_touch import TouchedLinks
from strategies.contacts.placing_kernel import _placing_kernel
from warpgrasp.chain.chain_hand import chain_of_table, true_chains
from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.core.dtypes import vec3, vec4
from warpgrasp.core.kernel_launch import array_of
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
    felt = {"q": links.q_rad, "torque": links.torque_Nm, "torque_sigma": links.torque_sigma_Nm,
            "link_weight": links.weight}
    if chain is None:
        rows = {name: array_of(values, vec3 if name == "link_weight" else vec4, device)
                for name, values in felt.items()}
        return Placing(_placing_kernel, {"hand": hand_of(links.hand)}, {}, rows)
    # Imported for hands that are chains alone.
    from strategies.contacts.chain_placing_kernel import chain_placing_kernel
    from warpgrasp.chain_closing.chain_closing import no_chain_errors
    from warpgrasp.chain_closing.chain_path import padded

    hands = true_chains(chain, links.hand, ContactTable(), no_chain_errors(chain), device)
    felt = {name: padded(values) for name, values in felt.items()}
    felt["torque_sigma"][..., links.q_rad.shape[-1]:] = 1.0
    rows = {name: array_of(values, vec6, device) for name, values in felt.items()}
    return Placing(chain_placing_kernel, {"hands": hands}, {"hands": "1 finger"}, rows)
