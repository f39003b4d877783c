# type: ignore  # Warp functions, which type checkers cannot follow
"""The readings and the true contact at the step where a finger stopped.

`closing_kernel` finds the step. Here its equilibrium is refined (`equilibrium_refine`), joints and
tensions are read, and the true contact is recorded for the scorer.
"""

import warp as wp

from warpgrasp.closing.closing_record import (
    ClosingRow,
    ClosingTruthRow,
    base_from_body,
    finger_key,
)
from warpgrasp.core.dtypes import ONE, ZERO, mat42, real, transform, vec3, vec4
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key, counter_normal
from warpgrasp.finger.energy import free_equilibrium
from warpgrasp.finger.equilibrium_refine import refine_equilibrium
from warpgrasp.finger.friction import NO_FRICTION
from warpgrasp.finger.path_record import PathStep, true_command
from warpgrasp.finger.valley_energy import refined_energy
from warpgrasp.geometry.scene import Scene, body_distance_grad, body_is_convex
from warpgrasp.geometry.segment_distance import lower_end
from warpgrasp.mechanism.tendon_kernel import (
    TendonSensor,
    moving_sign,
    tendon_tensions,
    tension_mean_read,
)
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    Hand,
    finger_pose,
    link_direction,
    link_start,
)
from warpgrasp.probe_status import ProbeStatus

_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_TENSION_REST = wp.constant(int(Purpose.TENSION_REST))
_JOINT = wp.constant(int(Purpose.JOINT))
_NAN = wp.constant(real(float("nan")))


@wp.kernel(enable_backward=False, module="warpgrasp.closing.closing_kernels")
def reading_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array2d[Hand],
    sensors: wp.array2d[TendonSensor],
    # Closing in:
    key: wp.array[wp.uint64],
    probe_number: wp.array2d[int],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[PathStep],
    # Read, and made closer:
    felt: wp.array4d[ClosingRow],
    truth: wp.array4d[ClosingTruthRow],
):
    """The readings of a stopped finger, and the true state."""
    w, p, g, finger = wp.tid()
    w += first
    felt[w, p, g, finger].q = vec4(_NAN, _NAN, _NAN, _NAN)
    felt[w, p, g, finger].tension = mat42(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN)
    truth[w, p, g, finger].point = vec3(_NAN, _NAN, _NAN)
    truth[w, p, g, finger].normal = vec3(_NAN, _NAN, _NAN)
    truth[w, p, g, finger].on_table = 0
    if truth[w, p, g, finger].met == 0 and not wp.isfinite(truth[w, p, g, finger].rest[0]):
        truth[w, p, g, finger].rest = truth[w, p, g, finger].q
    status = felt[w, p, g, finger].status
    if status != _CONTACT and status != _NO_CONTACT:
        return

    hand = hands[w % hands.shape[0], finger]
    sensor = sensors[w % sensors.shape[0], finger]
    stream = finger_key(key, probe_number, w, p, g, finger)
    at = felt[w, p, g, finger].step
    if truth[w, p, g, finger].link >= 0:
        which = body[w % body.shape[0]]
        base = base_from_body(body_pose, hand_pose, hand, w, p, finger)
        command = true_command(hand, path, g, finger, at)
        rest = free_equilibrium(truth[w, p, g, finger].q)
        rest.along = truth[w, p, g, finger].along
        rest.bend = truth[w, p, g, finger].bend
        rest.depth = truth[w, p, g, finger].depth
        # What its fellows do, and friction, is not in a finger's own energy.
        if truth[w, p, g, finger].met == 1 or hand.friction > ZERO:
            rest = refined_energy(scene, which, body_is_convex(scene, which), hand, base, command,
                                  rest.q, rest, NO_FRICTION)
        else:
            rest = refine_equilibrium(scene, which, hand, base, command, rest, NO_FRICTION)
        truth[w, p, g, finger].q = rest.q
        truth[w, p, g, finger].torque = (command - rest.q) * hand.stiffness
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
            truth[w, p, g, finger].on_table = 1
        normal = vec3(n[0], n[1], n[2])
        truth[w, p, g, finger].link = -1
        if deepest * real(2.0) > truth[w, p, g, finger].self_depth:  # two skins give in series
            truth[w, p, g, finger].self_depth = ZERO
            truth[w, p, g, finger].link = bearing
            truth[w, p, g, finger].point = wp.transform_point(body_pose[w], x - normal * n[3])
            truth[w, p, g, finger].normal = wp.transform_vector(
                body_pose[w], wp.normalize(normal))  # a grid's gradient is shorter in its creases

    reader = counter_key(stream, _JOINT)
    q = truth[w, p, g, finger].q
    for j in range(4):
        q[j] += hand.offset[j] + sensor.joint_noise * counter_normal(counter_key(reader, j))
    felt[w, p, g, finger].q = q
    if status == _NO_CONTACT:
        return
    delta = true_command(hand, path, g, finger, at) - true_command(
        hand, path, g, finger, wp.max(at - 1, 0))
    reader = counter_key(stream, _TENSION_REST)
    torque = truth[w, p, g, finger].torque
    pulls = mat42()
    for j in range(4):
        t = tendon_tensions(sensor, j, torque[j], moving_sign(delta[j]))
        pulls[j, 0] = tension_mean_read(sensor, t[0], counter_key(reader, 2 * j))
        pulls[j, 1] = tension_mean_read(sensor, t[1], counter_key(reader, 2 * j + 1))
    felt[w, p, g, finger].tension = pulls
