# type: ignore  # Warp functions, which type checkers cannot follow
"""The readings and the true contact at the step where a finger that is a chain stopped.

`chain_closing_kernel` finds the step. Here its equilibrium is refined, drives and torques are read,
and the true contact is recorded for the scorer.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    chain_capsule,
    chain_pose,
    link_place,
    vec6,
)
from warpgrasp.chain.torque_sensor_kernel import TorqueSensor, torque_mean_read
from warpgrasp.chain_closing.chain_closing_kernel import felt_torque
from warpgrasp.chain_closing.chain_record import (
    ChainClosingRow,
    ChainTruthRow,
    finger_stream,
    hand_from_body,
)
from warpgrasp.core.dtypes import ONE, ZERO, real, transform, vec3, vec4
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key, counter_normal
from warpgrasp.finger.chain_energy import free_chain, refined_energy
from warpgrasp.finger.equilibrium_refine import refine_equilibrium
from warpgrasp.finger.friction import NO_FRICTION
from warpgrasp.geometry.scene import Scene, body_distance_grad, body_is_convex
from warpgrasp.geometry.segment_distance import lower_end
from warpgrasp.mechanism.tendon_kernel import moving_sign
from warpgrasp.probe_status import ProbeStatus

_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_TENSION_REST = wp.constant(int(Purpose.TENSION_REST))
_JOINT = wp.constant(int(Purpose.JOINT))


@wp.kernel(enable_backward=False, module="warpgrasp.chain_closing.chain_closing_kernels")
def chain_reading_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array2d[Chain],
    believed: wp.array2d[Chain],
    sensors: wp.array2d[TorqueSensor],
    # Closing in:
    key: wp.array[wp.uint64],
    probe_number: wp.array2d[int],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[vec6],
    # Read, and made closer:
    felt: wp.array4d[ChainClosingRow],
    truth: wp.array4d[ChainTruthRow],
):
    """The readings of a stopped finger, and the true state."""
    w, p, g, finger = wp.tid()
    w += first
    status = felt[w, p, g, finger].status
    if status != _CONTACT and status != _NO_CONTACT:
        return
    hand = hands[w % hands.shape[0], finger]
    sensor = sensors[w % sensors.shape[0], finger]
    stream = finger_stream(key, probe_number, w, p, g, finger)
    at = felt[w, p, g, finger].step
    base = hand_from_body(body_pose, hand_pose, w, p)
    command = path[g, finger, at] - hand.offset
    if truth[w, p, g, finger].link >= 0:
        which = body[w % body.shape[0]]
        rest = free_chain(truth[w, p, g, finger].q)
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
        truth[w, p, g, finger].torque = wp.cw_mul(command - rest.q, hand.stiffness)
        bearing = int(0)
        deepest = real(0.0)
        for c in range(hand.capsule_count):
            if wp.max(rest.depth[c], rest.table[c]) > deepest:
                bearing = int(c)
                deepest = wp.max(rest.depth[c], rest.table[c])
        truth[w, p, g, finger].link = -1
        if deepest * real(2.0) > truth[w, p, g, finger].self_depth:  # two skins give in series
            capsule = chain_capsule(hand, bearing)
            pose = chain_pose(hand, base, rest.q)
            a = link_place(pose, capsule.joint, capsule.start)
            u = link_place(pose, capsule.joint, capsule.end) - a
            length = wp.length(u)
            if length > ZERO:
                u = u / length
            x = a + u * rest.along[bearing]
            n = body_distance_grad(scene, which, x)
            if rest.table[bearing] > rest.depth[bearing]:
                x = a + u * lower_end(u, length)
                n = vec4(ZERO, ZERO, ONE, x[2])
                truth[w, p, g, finger].on_table = 1
            normal = vec3(n[0], n[1], n[2])
            truth[w, p, g, finger].self_depth = ZERO
            truth[w, p, g, finger].link = capsule.joint
            truth[w, p, g, finger].point = wp.transform_point(body_pose[w], x - normal * n[3])
            truth[w, p, g, finger].normal = wp.transform_vector(
                body_pose[w], wp.normalize(normal))  # a grid's gradient is shorter in its creases

    if not wp.isfinite(truth[w, p, g, finger].rest[0]):
        truth[w, p, g, finger].rest = truth[w, p, g, finger].q
    reader = counter_key(stream, _JOINT)
    q = truth[w, p, g, finger].q
    for d in range(hand.drives):
        felt[w, p, g, finger].q[d] = q[d] + hand.offset[d] + (
            sensor.joint_noise * counter_normal(counter_key(reader, d)))
    if status == _NO_CONTACT:
        return
    reader = counter_key(stream, _TENSION_REST)
    torque = felt_torque(hand, believed[0, finger], base, command, q)
    delta = path[g, finger, at] - path[g, finger, wp.max(at - 1, 0)]
    for d in range(hand.drives):
        felt[w, p, g, finger].torque[d] = torque_mean_read(
            sensor, d, torque[d], moving_sign(delta[d]), counter_key(reader, d))
