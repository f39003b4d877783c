# type: ignore  # Warp functions, which type checkers cannot follow
"""Forward kinematics of any chain in kernels: the frame of each link of a finger.

The chain is walked joint by joint, so that one kernel serves every number of joints.
"""

import warp as wp

from warpgrasp.core.dtypes import HALF, quat, real, transform, vec3
from warpgrasp.core.turns import sine_cosine


@wp.func
def turned_about(frame: transform, axis: vec3, angle: real):
    """`frame` turned by `angle` [rad] about the unit vector `axis` of its own."""
    half = sine_cosine(angle * HALF)
    about = quat(axis[0] * half[0], axis[1] * half[0], axis[2] * half[0], half[1])
    return wp.transform_multiply(
        frame, transform(vec3(), about))


@wp.kernel(enable_backward=False)
def link_frames_kernel(
    first: int,
    # Chains in, one a finger, filled up with joints that stand still:
    place: wp.array2d[transform],
    axis: wp.array2d[vec3],
    # Configurations in:
    angle: wp.array3d[real],
    # Frames out, in the palm's frame:
    frame: wp.array3d[transform],
):
    """One finger of one configuration, from the palm outwards."""
    i, finger = wp.tid()
    i += first
    now = wp.transform_identity(dtype=real)
    for joint in range(place.shape[1]):
        now = wp.transform_multiply(now, place[finger, joint])
        now = turned_about(now, axis[finger, joint], angle[i, finger, joint])
        frame[i, finger, joint] = now
