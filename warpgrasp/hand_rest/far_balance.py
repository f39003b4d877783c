# type: ignore  # Warp functions, which type checkers cannot follow
"""The balance of a finger that is certainly off body and table: servos, weight and stops alone.

In a hand of chains that meets most fingers touch nothing but one another. For them this is the
balance that `finger_balance` finds, without its capsules placed.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    chain_beyond_stops,
    chain_capsule,
    chain_pose,
    mat66,
    vec6,
    weight_along,
)
from warpgrasp.core.dtypes import ONE, ZERO, greater, transform, vec4
from warpgrasp.finger.chain_energy import ChainRest, links_moved
from warpgrasp.finger.energy import Equilibrium
from warpgrasp.hand_rest.chain_meetings import ChainBuild
from warpgrasp.hand_rest.meetings import HandBuild
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
from warpgrasp.rubbing.balance import Grip
from warpgrasp.rubbing.chain_balance import ChainGrip, start_grip


@wp.func
def far_balance(
    hand: Hand, base: transform, build: HandBuild, finger: int, command: vec4, q: vec4,
    state: wp.array2d[Equilibrium], i: int, slot: int, last: int, grips: wp.array2d[Grip],
    tried: int
):
    """False: of the Utah-MIT hand's closings this saves less than can be told, and takes 1.6 s more
    to compile."""
    return False


@wp.func(inline=False)
def far_balance(  # noqa: F811 (an overload)
    hand: Chain, base: transform, build: ChainBuild, finger: int, command: vec6, q: vec6,
    state: wp.array2d[ChainRest], i: int, slot: int, last: int, grips: wp.array2d[ChainGrip],
    tried: int
):
    """Whether no capsule at drives `q` can touch, by how deep they are in the state `last` of row
    `i`; then the balance is put in its state `slot`, and the grip in its grip `tried`.

    Depths become upper bounds. The finger's pose is kept for `find_meetings`.
    """
    swung, travel = links_moved(hand, q, state[i, last].q)
    depth = state[i, last].depth
    table = state[i, last].table
    for c in range(hand.capsule_count):
        capsule = chain_capsule(hand, c)
        swing = swung[capsule.joint] * capsule.far
        depth[c] = depth[c] + travel[capsule.joint] + swing
        table[c] = table[c] + travel[capsule.joint] + swing
        if greater(depth[c], table[c]) >= ZERO:
            return False
    drive = vec6()
    compliance = mat66()
    past = chain_beyond_stops(hand, q)
    for d in range(len(q)):
        k = hand.stiffness[d]
        drive[d] = (q[d] - command[d]) * k
        compliance[d, d] = ONE / wp.where(past[d] == ZERO, k, k + hand.stop)
    if hand.weighs == 1:
        pose = chain_pose(hand, wp.transform_identity(dtype=wp.float64), q)
        drive -= weight_along(hand, pose, build.up)
        build.poses[i, finger] = pose
        build.posed[i, finger] = q
    state[i, slot].q = q
    state[i, slot].drive = drive
    state[i, slot].gradient = drive + past * hand.stop
    state[i, slot].compliance = compliance
    state[i, slot].along = state[i, last].along
    state[i, slot].bend = state[i, last].bend
    state[i, slot].depth = depth
    state[i, slot].table = table
    state[i, slot].near = vec6()
    state[i, slot].near_depth = -ONE
    if grips[i, tried].touching == 0:
        grips[i, tried].q = q  # its skin is nowhere stretched already
        grips[i, tried].drift = q - q
        grips[i, tried].missed = q - q
    else:
        grips[i, tried] = start_grip(q)
    return True
