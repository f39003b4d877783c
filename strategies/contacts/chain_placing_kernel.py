# type: ignore  # Warp functions, which type checkers cannot follow
"""As `field_placing_kernel`, of hands that are chains: a finger's links are its capsules here."""

import warp as wp

from strategies.contacts.link_places import ChainAt
from strategies.contacts.placing_posterior import (
    FieldAt,
    Tried,
    placed_contact,
    write_field,
    write_stations,
)
from warpgrasp.chain.chain_kernel import JOINTS, Chain, chain_pose, vec6, vec12
from warpgrasp.core.dtypes import ONE, ZERO, mat33, real, transform, vec3, vec4
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape

_JOINTS = wp.constant(JOINTS)


@wp.func
def _chain_at(hand: Chain, hand_pose: transform, q: vec6):
    f = ChainAt()
    f.hand = hand
    f.pose = chain_pose(hand, hand_pose, q)
    return f


@wp.kernel(enable_backward=False)
def chain_station_kernel(
    first: int,
    # Links in:
    hand: wp.array2d[Chain],
    hand_pose: wp.array2d[transform],
    q: wp.array2d[vec6],
    finger: wp.array2d[int],
    # Places out:
    station: wp.array3d[vec3],
):
    """Where the stations of a finger's capsules are, capsule by capsule."""
    w, i = wp.tid()
    w += first
    f = _chain_at(hand[0, finger[w, i]], hand_pose[w, i], q[w, i])
    write_stations(f, f.hand, w, i, station)


@wp.kernel(enable_backward=False)
def chain_field_kernel(
    first: int,
    # Bodies in:
    has_lanes: wp.bool,
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # Links in:
    hand: wp.array2d[Chain],
    kept: wp.array2d[wp.bool],
    hand_pose: wp.array2d[transform],
    q: wp.array2d[vec6],
    finger: wp.array2d[int],
    link_weight: wp.array2d[vec6],
    # Normals and distances out:
    field: wp.array3d[vec4],
):
    """At the stations of capsules that contacts may be on; others are not looked at."""
    w, i = wp.tid()
    w += first
    if not kept[w, i]:
        return
    f = _chain_at(hand[0, finger[w, i]], hand_pose[w, i], q[w, i])
    write_field(f, f.hand, link_weight[w, i], shape[w], pose[w], has_lanes, w, i, field)


@wp.kernel(enable_backward=False)
def chain_placing_kernel(
    first: int,
    # Bodies in:
    field: wp.array3d[vec4],
    # Links in:
    hand: wp.array2d[Chain],
    kept: wp.array2d[wp.bool],
    hand_pose: wp.array2d[transform],
    q: wp.array2d[vec6],
    finger: wp.array2d[int],
    torque: wp.array2d[vec6],
    torque_sigma: wp.array2d[vec6],
    step: wp.array2d[vec6],
    link_weight: wp.array2d[vec6],
    friction: wp.array2d[real],
    tried: Tried,
    place_sigma: real,
    farthest: real,
    normal_variance: real,
    # Contacts out:
    point: wp.array2d[vec3],
    covariance: wp.array2d[mat33],
    normal: wp.array2d[vec3],
    chance: wp.array2d[real],
    misfit: wp.array2d[real],
):
    """`field` holds normal and distance at the stations of every contact."""
    w, i = wp.tid()
    w += first
    point[w, i] = vec3(ZERO, ZERO, ZERO)
    covariance[w, i] = wp.identity(n=3, dtype=wp.float64)
    normal[w, i] = vec3(ZERO, ZERO, ZERO)
    chance[w, i] = ZERO
    misfit[w, i] = ZERO
    if not kept[w, i]:
        return
    f = _chain_at(hand[0, finger[w, i]], hand_pose[w, i], q[w, i])
    believed = FieldAt()
    believed.stations = field
    believed.world = w
    believed.point = i
    root = vec6()
    for d in range(_JOINTS):
        root[d] = ONE / torque_sigma[w, i][d]
    found = placed_contact(
        f, f.hand, torque[w, i], root, step[w, i], link_weight[w, i], vec12(), friction[w, i],
        believed, tried, place_sigma, farthest, normal_variance)
    point[w, i] = found.point
    covariance[w, i] = found.covariance
    normal[w, i] = found.normal
    chance[w, i] = found.chance
    misfit[w, i] = found.misfit
