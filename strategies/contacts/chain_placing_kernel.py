# type: ignore  # Warp functions, which type checkers cannot follow
"""Where capsules of a hand of chains touch a believed body: the torques of a finger and the body
taken together, by the mathematics of `placing_posterior`."""

import warp as wp

from strategies.contacts.link_places import ChainAt, direction_at
from strategies.contacts.placing_posterior import (
    ALONG,
    UNLIKELY,
    SuperquadricAt,
    places_of_link,
)
from strategies.contacts.placing_sums import NEGLIGIBLE, WORST, Place
from warpgrasp.chain.chain_kernel import CAPSULES, JOINTS, Chain, chain_capsule, chain_pose, vec6
from warpgrasp.core.dtypes import HALF, ONE, ZERO, mat33, real, transform, vec3
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape

_STEP = wp.constant(real(1.0 / ALONG))
_JOINTS, _CAPSULES = wp.constant(JOINTS), wp.constant(CAPSULES)
_logs = wp.types.vector(length=CAPSULES, dtype=real)


@wp.kernel(enable_backward=False)
def chain_placing_kernel(
    first: int,
    # Bodies in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # Links in:
    hands: wp.array2d[Chain],
    kept: wp.array2d[wp.bool],
    hand_pose: wp.array2d[transform],
    q: wp.array2d[vec6],
    finger: wp.array2d[int],
    torque: wp.array2d[vec6],
    torque_sigma: wp.array2d[vec6],
    link_weight: wp.array2d[vec6],
    lean: wp.array2d[real],
    place_sigma: real,
    turn_sigma: real,
    farthest: real,
    normal_variance: real,
    # Contacts out:
    point: wp.array2d[vec3],
    covariance: wp.array2d[mat33],
    normal: wp.array2d[vec3],
    chance: wp.array2d[real],
    misfit: wp.array2d[real],
):
    """The likeliest place of each contact; `chance` is that of the link that bears it."""
    w, i = wp.tid()
    w += first
    point[w, i] = vec3(ZERO, ZERO, ZERO)
    covariance[w, i] = wp.identity(n=3, dtype=wp.float64)
    normal[w, i] = vec3(ZERO, ZERO, ZERO)
    chance[w, i] = ZERO
    misfit[w, i] = ZERO
    if not kept[w, i]:
        return
    f = ChainAt()
    f.hand = hands[0, finger[w, i]]
    f.pose = chain_pose(f.hand, hand_pose[w, i], q[w, i])
    believed = SuperquadricAt()
    believed.shape = shape[w]
    believed.pose = pose[w]
    root = vec6()
    for d in range(_JOINTS):
        root[d] = ONE / torque_sigma[w, i][d]
    felt = wp.cw_mul(torque[w, i], root)
    best = Place()
    best.least = WORST
    best_capsule = int(-1)
    most = real(-WORST)
    logs = _logs()
    for c in range(f.hand.capsule_count):
        logs[c] = -WORST
        capsule = chain_capsule(f.hand, c)
        if link_weight[w, i][capsule.joint] >= UNLIKELY:
            length = wp.length(capsule.end - capsule.start)
            ends = wp.where(capsule.joint == f.hand.joint_count - 1 or length == ZERO, 1, 0)
            post = places_of_link(f, c, ends, length, capsule.radius, lean[w, i], felt, root,
                                  believed, place_sigma, turn_sigma, farthest)
            if post.weight > ZERO:
                logs[c] = wp.log(post.weight) - HALF * post.least
                if logs[c] > most:
                    most = logs[c]
                    best = post
                    best_capsule = c
    if best_capsule < 0:
        return
    bears = chain_capsule(f.hand, best_capsule)
    alike = real(0.0)
    others = real(0.0)
    for c in range(f.hand.capsule_count):
        share = wp.exp(wp.max(logs[c] - most, -NEGLIGIBLE))
        others += share
        if chain_capsule(f.hand, c).joint == bears.joint:
            alike += share
    outward = wp.normalize(best.outward)
    u = direction_at(f, best_capsule)
    cell = wp.length(bears.end - bears.start) * _STEP
    mean = best.alone_along / best.alone
    spread = wp.max(best.alone_square / best.alone - mean * mean, cell * cell / real(12.0))
    point[w, i] = best.axis / best.weight + outward * bears.radius
    # Of the place along the axis as torques tell it: what the body says is no evidence of its own.
    covariance[w, i] = (wp.identity(n=3, dtype=wp.float64) * normal_variance
                        + wp.outer(u, u) * spread)
    normal[w, i] = -outward
    chance[w, i] = alike / others
    misfit[w, i] = best.misfit
