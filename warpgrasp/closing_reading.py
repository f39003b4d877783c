"""What is read, and what is true, where a finger stopped: the second half of a closing.

`closing` finds the step; here its rest is looked at closely (`finger_crease`), joints and tensions
are read there, and the contact is written down for the scorer.
"""

from collections.abc import Mapping
from typing import Any

import warp as wp

from warpgrasp.counter_random import Purpose, counter_key, counter_normal
from warpgrasp.finger_crease import settled_rest
from warpgrasp.finger_path import PathStep
from warpgrasp.link_nearest import lower_end
from warpgrasp.real import ONE, ZERO, mat42, real, transform, vec3, vec4
from warpgrasp.scene import Scene, body_distance_grad
from warpgrasp.status import ProbeStatus
from warpgrasp.tendon import TendonSensor, moving_sign, tendon_tensions, tension_mean_read
from warpgrasp.utah_mit_hand import Hand, finger_base, finger_pose, link_direction, link_start

wp.set_module_options({"max_unroll": 1})
_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_TENSION_REST = wp.constant(int(Purpose.TENSION_REST))
_JOINT = wp.constant(int(Purpose.JOINT))
_NAN = wp.constant(real(float("nan")))


@wp.kernel(enable_backward=False)
def _reading_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array[Hand],
    sensors: wp.array[TendonSensor],
    # Closing in:
    key: wp.array[wp.uint64],
    probe_first: int,
    hand_pose: wp.array2d[transform],
    path: wp.array3d[PathStep],
    status: wp.array4d[int],
    step: wp.array4d[int],
    # Made closer:
    q_true: wp.array4d[vec4],
    torque_true: wp.array4d[vec4],
    link_true: wp.array4d[int],
    # Contact out:
    q_read: wp.array4d[vec4],
    tension: wp.array4d[mat42],
    # Truth out:
    point_true: wp.array4d[vec3],
    normal_true: wp.array4d[vec3],
    on_table: wp.array4d[int],
):
    w, p, g, finger = wp.tid()
    w += first
    q_read[w, p, g, finger] = vec4(_NAN, _NAN, _NAN, _NAN)
    tension[w, p, g, finger] = mat42(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN)
    point_true[w, p, g, finger] = vec3(_NAN, _NAN, _NAN)
    normal_true[w, p, g, finger] = vec3(_NAN, _NAN, _NAN)
    on_table[w, p, g, finger] = 0
    if status[w, p, g, finger] != _CONTACT and status[w, p, g, finger] != _NO_CONTACT:
        return

    hand = hands[w % hands.shape[0]]
    sensor = sensors[w % sensors.shape[0]]
    stream = counter_key(counter_key(counter_key(key[w], probe_first + p), g), finger)
    at = step[w, p, g, finger]
    if link_true[w, p, g, finger] >= 0:
        which = body[w % body.shape[0]]
        base = wp.transform_multiply(
            wp.transform_inverse(body_pose[w]),
            wp.transform_multiply(hand_pose[w, p], finger_base(hand, finger)))
        command = path[g, finger, at].command
        rest = settled_rest(scene, which, hand, base, command, q_true[w, p, g, finger])
        q_true[w, p, g, finger] = rest.q
        torque_true[w, p, g, finger] = (command - rest.q) * hand.stiffness
        bearing = int(0)
        deepest = real(0.0)
        for link in range(3):
            if wp.max(rest.depth[link], rest.table[link]) > deepest:
                bearing = int(link)
                deepest = wp.max(rest.depth[link], rest.table[link])
        f = finger_pose(hand, base, rest.q)
        u = link_direction(f, bearing)
        x = link_start(f, bearing) + u * rest.along[bearing]
        n = body_distance_grad(scene, which, x)
        if rest.table[bearing] > rest.depth[bearing]:
            x = link_start(f, bearing) + u * lower_end(u, hand.link_length[bearing])
            n = vec4(ZERO, ZERO, ONE, x[2])
            on_table[w, p, g, finger] = 1
        normal = vec3(n[0], n[1], n[2])
        link_true[w, p, g, finger] = bearing
        point_true[w, p, g, finger] = wp.transform_point(body_pose[w], x - normal * n[3])
        normal_true[w, p, g, finger] = wp.transform_vector(body_pose[w], normal)

    reader = counter_key(stream, _JOINT)
    for j in range(4):
        q_read[w, p, g, finger][j] = q_true[w, p, g, finger][j] + sensor.joint_noise * (
            counter_normal(counter_key(reader, j)))
    if status[w, p, g, finger] == _NO_CONTACT:
        return
    delta = path[g, finger, at].command - path[g, finger, wp.max(at - 1, 0)].command
    reader = counter_key(stream, _TENSION_REST)
    pulls = mat42()
    for j in range(4):
        t = tendon_tensions(hand, j, torque_true[w, p, g, finger][j], moving_sign(delta[j]))
        pulls[j, 0] = tension_mean_read(sensor, t[0], counter_key(reader, 2 * j))
        pulls[j, 1] = tension_mean_read(sensor, t[1], counter_key(reader, 2 * j + 1))
    tension[w, p, g, finger] = pulls


def reading_step(
    extents: Mapping[str, int], stops: Mapping[str, Any], device: str
) -> tuple[tuple[wp.Kernel, dict[str, str], dict[str, Any]], dict[str, wp.array]]:
    """The step of `launch_in_turn` that reads stops (world, probe, grasp, finger); its readings.

    `stops` are given by the kernel's names; joints, torques and links are made closer in place.
    """
    dims = tuple(extents.values())
    read = {name: wp.empty(dims, dtype=kind, device=device) for name, kind in {
        "q_read": vec4, "tension": mat42, "point_true": vec3, "normal_true": vec3,
        "on_table": int}.items()}
    shapes = dict.fromkeys(_reading_kernel.adj.arg_types, "world probe grasp finger") | {
        "body": "world?", "body_pose": "world", "hands": "world?", "sensors": "world?",
        "key": "world", "hand_pose": "world probe", "path": "grasp finger step"}
    return (_reading_kernel, shapes, {**stops, **read}), read
