# type: ignore  # Warp functions, which type checkers cannot follow
"""The arm and the open hand from pose to pose, in a kernel."""

import warp as wp

from warpgrasp.core.dtypes import ONE, TWO, ZERO, quat, real, transform, vec3, vec7
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key, counter_normal
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.arm_kernel import Arm, arm_flange, arm_joints, arm_time
from warpgrasp.mechanism.hand_clearance import hand_clearance
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
from warpgrasp.probe_status import ProbeStatus

RETREAT_M = 0.12
wp.set_module_options({"max_unroll": 1})  # compiles in half the time
_TRY = wp.constant(int(ProbeStatus.CONTACT))
_UNREACHABLE = wp.constant(int(ProbeStatus.UNREACHABLE))
_COLLISION = wp.constant(int(ProbeStatus.COLLISION))
_ARM = wp.constant(int(Purpose.ARM))
_RETREAT = wp.constant(real(RETREAT_M))
_SHORTEST_M = 5e-4
_SHORTEST = wp.constant(real(_SHORTEST_M))
_MARCHES = wp.constant(int(RETREAT_M / _SHORTEST_M) + 2)  # reach the pose, however short they are
_GLANCE = wp.constant(real(1e-6))


@wp.kernel(enable_backward=False)
def _move_kernel(
    first: int,
    # Robot:
    arm: Arm,
    true_arms: wp.array[Arm],
    # Probe in:
    key: wp.array[wp.uint64],
    probe_number: wp.array2d[int],
    mount: wp.array[transform],
    wanted: wp.array2d[transform],
    wanted_status: wp.array2d[int],
    start: wp.array[vec7],
    # Moves out:
    status: wp.array2d[int],
    believed: wp.array2d[transform],
    actual: wp.array2d[transform],
    time: wp.array2d[real],
    path: wp.array2d[real],
    end: wp.array[vec7],
):
    w = wp.tid() + first
    hand_on_flange = transform(vec3(ZERO, ZERO, arm.mount), quat(ZERO, ZERO, ZERO, ONE))
    flange_on_hand = wp.transform_inverse(hand_on_flange)
    back = transform(vec3(ZERO, ZERO, -_RETREAT), quat(ZERO, ZERO, ZERO, ONE))
    last = start[w]
    for p in range(wanted.shape[1]):
        status[w, p] = wanted_status[w, p]
        believed[w, p] = wanted[w, p]
        actual[w, p] = wanted[w, p]
        time[w, p] = ZERO
        path[w, p] = ZERO
        if wanted_status[w, p] == _TRY:
            retreat = wp.transform_multiply(wanted[w, p], back)
            q_retreat = arm_joints(arm, wp.transform_multiply(retreat, flange_on_hand), last)
            q = arm_joints(arm, wp.transform_multiply(wanted[w, p], flange_on_hand), q_retreat)
            if wp.isfinite(q_retreat[0]) and wp.isfinite(q[0]):
                if arm.encoder_step > ZERO:
                    for j in range(7):
                        q[j] = arm.encoder_step * wp.round(q[j] / arm.encoder_step)
                pose = wp.transform_multiply(arm_flange(arm, q), hand_on_flange)
                believed[w, p] = pose
                noise = counter_key(counter_key(key[w], _ARM), probe_number[w, p])
                wobble = vec3(counter_normal(counter_key(noise, 0)),
                              counter_normal(counter_key(noise, 1)),
                              counter_normal(counter_key(noise, 2))) * arm.repeatability
                real_pose = wp.transform_multiply(
                    wp.transform_multiply(arm_flange(true_arms[w % true_arms.shape[0]], q),
                                          hand_on_flange), mount[w % mount.shape[0]])
                actual[w, p] = transform(wp.transform_get_translation(real_pose) + wobble,
                                         wp.transform_get_rotation(real_pose))
                time[w, p] = arm_time(arm, last, q_retreat) + TWO * arm_time(arm, q_retreat, q)
                before = wp.transform_multiply(arm_flange(arm, last), hand_on_flange)
                path[w, p] = TWO * _RETREAT + wp.length(
                    wp.transform_get_translation(retreat) - wp.transform_get_translation(before))
                last = q_retreat
            else:
                status[w, p] = _UNREACHABLE
    end[w] = last


@wp.func
def approach_left(left: real, clear: real):
    """What is left of an approach [m] when the hand has gone as far as it is clear."""
    ahead = wp.max(left - wp.max(clear, _SHORTEST), ZERO)
    if ahead < _GLANCE:
        return ZERO
    return ahead


@wp.kernel(enable_backward=False)
def _clearance_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array2d[Hand],
    mount_length: real,
    # Probe in:
    move_status: wp.array2d[int],
    actual: wp.array2d[transform],
    commands: wp.array4d[real],
    # Status out:
    status: wp.array3d[int],
):
    w, p, g = wp.tid()
    w += first
    status[w, p, g] = move_status[w, p]
    if move_status[w, p] != _TRY:
        return
    pose = wp.transform_multiply(wp.transform_inverse(body_pose[w]), actual[w, p])
    z = wp.transform_vector(pose, vec3(ZERO, ZERO, ONE))
    place = wp.transform_get_translation(pose)
    turn = wp.transform_get_rotation(pose)
    left = ZERO
    if g == 0:
        left = _RETREAT  # the first grasp of a probe comes with the approach
    for _ in range(_MARCHES):
        here = transform(place - z * left, turn)
        clear = hand_clearance(scene, body[w % body.shape[0]], hands, w, here, mount_length,
                               commands, g)
        if clear < ZERO:
            status[w, p, g] = _COLLISION
            return
        if left <= ZERO:
            return
        left = approach_left(left, clear)
