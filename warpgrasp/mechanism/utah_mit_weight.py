"""Utah-MIT hand: what its links weigh, how far that turns its fingers from their commands,
and which hands are refused."""

import numpy as np

from warpgrasp.parameters import ContactTable, HandTable
from warpgrasp.table_misfit import order_misfit

GRAVITY_M_S2 = 9.81
_LEAST_ASKEW = 0.02
"""Radians by which weight turns a finger's joints together at least, in bounds."""
_MOST_ASKEW = 0.1
"""More is refused: rests of free fingers are of first order, and tips would be off by 0.1 mm."""


def link_weights(table: HandTable) -> np.ndarray:
    """Of the three links of a finger, solid capsules [N]."""
    length, radius = np.array(table.link_length_m), table.link_radius_m
    return (np.pi * radius**2 * (length + 4 / 3 * radius)
            * table.link_density_kg_m3 * GRAVITY_M_S2)


def weight_askew(table: HandTable) -> float:
    """The most that weight turns all joints of a finger by together [rad], or a little more."""
    turn = weight_bounds(table, link_weights(table))[0].sum() / table.joint_stiffness_Nm_rad
    return max(_LEAST_ASKEW, float(turn))


def overlap_misfit(table: HandTable) -> str:
    """Why straight fingers lie in one another; empty where they do not."""
    thick = 2.0 * table.link_radius_m
    for apart, what, key in (
            (table.finger_spacing_m, "neighbouring fingers", "finger_spacing_mm"),
            (table.palm_gap_m, "fingers and thumb", "palm_gap_mm")):
        if thick > apart:
            return (f"links of {table.link_radius_m * 1e3:g} mm radius overlap where {what} stand "
                    f"{apart * 1e3:g} mm apart; {key} should be {thick * 1e3:g} at least, or "
                    f"link_radius_mm {apart * 5e2:g} at most")
    return ""


def limit_misfit(table: HandTable) -> str:
    """Why joints have no room between their limits; empty where they have."""
    least, most = table.abduction_limit_rad
    return (order_misfit((least,), (most,), "abduction_limit_deg should rise")
            or order_misfit(table.flexion_low_rad, table.flexion_high_rad,
                            "flexion_low_deg should be below flexion_high_deg"))


def weight_misfit(table: HandTable, contact: ContactTable) -> str:
    """Why fingers hang too far from their commands; empty where they do not."""
    if not contact.weight or (turn := weight_askew(table)) <= _MOST_ASKEW:
        return ""
    return (f"the fingers' own weight turns their joints by {turn:.2g} rad together; should be "
            f"{_MOST_ASKEW:g} at most: servos should be stiffer ([hand] joint_stiffness_Nm_rad) or "
            "links lighter (link_density_kg_m3), shorter or thinner, or [contact] weight false")


def weight_bounds(table: HandTable, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The most that links of `weight` (3,) [N] can do, however the finger is bent and turned.

    Returns torques on the four joints [N m], how far they can let a place of each link sink [m],
    and how far any place sideways [m], a tenth added for what errors of calibration change.
    """
    length = np.array(table.link_length_m)
    start = np.concatenate([[0.0], length.cumsum()[:-1]])  # of each link from the first flexion
    middle, end = start + length / 2, start + length
    flexion = [float((weight * np.maximum(middle - start[j], 0.0)).sum()) for j in range(3)]
    abduction = float((weight * (table.abduction_offset_m + middle)).sum())
    turn = np.array([abduction, *flexion]) / table.joint_stiffness_Nm_rad
    lever = np.stack([end + table.abduction_offset_m,
                      *(np.maximum(end - start[j], 0.0) for j in range(3))])
    across, along = turn[0] * lever[0], (turn[1:, None] * lever[1:]).sum(0)
    return (np.array([abduction, *flexion]), 1.1 * np.hypot(across, along),
            float(1.1 * across[-1]))
