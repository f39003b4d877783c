# type: ignore  # Warp functions, which type checkers cannot follow
"""Where links of the Utah-MIT hand touch a believed body of any form, by the mathematics of
`placing_posterior`.

Its normals and distances at stations along the links are found first, those of superquadrics here.
"""

import warp as wp

from strategies.contacts.placing_posterior import (
    FieldAt,
    Tried,
    placed_contact,
    write_field,
    write_stations,
)
from strategies.contacts.placing_sums import WORST
from warpgrasp.core.dtypes import ONE, ZERO, mat33, real, transform, vec3, vec4
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, finger_base, finger_pose


@wp.kernel(enable_backward=False)
def station_kernel(
    first: int,
    # Links in:
    hand: Hand,
    hand_pose: wp.array2d[transform],
    q: wp.array2d[vec4],
    finger: wp.array2d[int],
    # Places out:
    station: wp.array3d[vec3],
):
    """Where the stations of a finger's links are, link by link."""
    w, i = wp.tid()
    w += first
    f = finger_pose(hand, wp.transform_multiply(
        hand_pose[w, i], finger_base(hand, finger[w, i])), q[w, i])
    write_stations(f, hand, w, i, station)


@wp.kernel(enable_backward=False)
def superquadric_field_kernel(
    first: int,
    # Bodies in:
    has_lanes: wp.bool,
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # Links in:
    hand: Hand,
    kept: wp.array2d[wp.bool],
    hand_pose: wp.array2d[transform],
    q: wp.array2d[vec4],
    finger: wp.array2d[int],
    link_weight: wp.array2d[vec3],
    # Normals and distances out:
    field: wp.array3d[vec4],
):
    """At the stations of links that contacts may be on; others are not looked at."""
    w, i = wp.tid()
    w += first
    if not kept[w, i]:
        return
    f = finger_pose(hand, wp.transform_multiply(
        hand_pose[w, i], finger_base(hand, finger[w, i])), q[w, i])
    write_field(f, hand, link_weight[w, i], shape[w], pose[w], has_lanes, w, i, field)


@wp.kernel(enable_backward=False)
def field_placing_kernel(
    first: int,
    # Bodies in:
    field: wp.array3d[vec4],
    # Links in:
    hand: Hand,
    kept: wp.array2d[wp.bool],
    hand_pose: wp.array2d[transform],
    q: wp.array2d[vec4],
    finger: wp.array2d[int],
    torque: wp.array2d[vec4],
    torque_sigma: wp.array2d[vec4],
    step: wp.array2d[vec4],
    link_weight: wp.array2d[vec3],
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
    f = finger_pose(hand, wp.transform_multiply(
        hand_pose[w, i], finger_base(hand, finger[w, i])), q[w, i])
    believed = FieldAt()
    believed.stations = field
    believed.world = w
    believed.point = i
    sigma = torque_sigma[w, i]
    root = vec4(ONE / sigma[0], ONE / sigma[1], ONE / sigma[2], ONE / sigma[3])
    found = placed_contact(
        f, hand, torque[w, i], root, step[w, i], link_weight[w, i], vec3(-WORST, -WORST, -WORST),
        friction[w, i], believed, tried, place_sigma, farthest, normal_variance)
    point[w, i] = found.point
    covariance[w, i] = found.covariance
    normal[w, i] = found.normal
    chance[w, i] = found.chance
    misfit[w, i] = found.misfit
