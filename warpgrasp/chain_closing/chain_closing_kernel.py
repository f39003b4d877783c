# type: ignore  # Warp functions, which type checkers cannot follow
"""The kernel of a closing of a hand of chains: at which step each finger stops.

A finger follows its commands. While it is certainly free it is not looked at (`free_chain`), unless
friction and noise alone may stop it: then the reading of a free step is drawn where its noise is
large enough (`noise_may_stop`). From the first touch on it is brought to rest at every step
(`finger.equilibrium`), and stops at the first step whose reading passes the threshold; with
friction, the skin remembers how it is stretched (`rubbing`). What the robot believes its links to
weigh is taken off the readings, at the angles that its sensors tell, and what stops bear of it put
back.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    chain_beyond_stops,
    chain_capsule,
    chain_free_joints,
    chain_pose,
    chain_weight,
    vec6,
)
from warpgrasp.chain.torque_sensor_kernel import TorqueSensor, guard_reading, noise_may_stop
from warpgrasp.chain_closing.chain_record import (
    ChainClosingRow,
    ChainTruthRow,
    clear_chain_rows,
    finger_stream,
    hand_from_body,
)
from warpgrasp.chain_closing.free_chain import FreeChain, advance_chain, advance_in_lanes
from warpgrasp.closing.closing_record import stays_open
from warpgrasp.core.dtypes import ONE, ZERO, real, struct, transform
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key
from warpgrasp.finger.chain_energy import ChainRest, free_chain
from warpgrasp.finger.equilibrium import finger_equilibrium
from warpgrasp.finger.friction import NO_FRICTION
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import LINK_SAMPLES
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.rubbing.chain_balance import ChainGrip, ChainRubbed, predicted, start_rubbed
from warpgrasp.rubbing.friction_step import next_rubbed, refine_rubbed

_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_TENSION_STEP = wp.constant(int(Purpose.TENSION_STEP))


@struct
class _State:
    """Fields change in place; a struct assigned in a branch would be copied."""

    rest: ChainRest
    free: FreeChain
    rubbed: ChainRubbed
    """With friction: `rest`, and how the skin is stretched there."""


@wp.func
def tip_force(hand: Chain, rest: ChainRest):
    """The force on the skin of the last link [N]."""
    force = real(0.0)
    for c in range(hand.capsule_count):
        if chain_capsule(hand, c).joint == hand.joint_count - 1:
            force += hand.skin * (wp.max(rest.depth[c], ZERO) + wp.max(rest.table[c], ZERO))
    return force


@wp.func
def touches(hand: Chain, rest: ChainRest):
    """Whether any capsule presses."""
    deepest = real(-1.0)
    for c in range(hand.capsule_count):
        deepest = wp.max(deepest, wp.max(rest.depth[c], rest.table[c]))
    return deepest > ZERO


@wp.func
def strayed(hand: Chain, base: transform, command: vec6, q: vec6):
    """How far any place of a finger at drives `q` is from where it would be free [m], at most."""
    free = chain_free_joints(hand, base, command)
    off = real(0.0)
    for d in range(hand.drives):
        off += wp.abs(q[d] - free[d]) * hand.levers[d]
    return off


@wp.func
def felt_torque(hand: Chain, believed: Chain, base: transform, command: vec6, q: vec6):
    """What the servos bear at drives `q` beside the weight that the robot believes [N m]."""
    return wp.cw_mul(command - q, hand.stiffness) + chain_weight(
        believed, chain_pose(believed, base, q + hand.offset))


@wp.func
def guarded_torque(hand: Chain, believed: Chain, base: transform, command: vec6, q: vec6):
    """What the servos bear beside what the robot believes them to where nothing touches [N m].

    A drive that is led onto its stop, or sinks onto it, presses it with the servo's spring and the
    stop's in series; that much of the weight, or of the command, is not felt.
    """
    drive = wp.cw_mul(command - q, hand.stiffness)
    felt = felt_torque(hand, believed, base, command, q)
    led = command + hand.offset
    for d in range(hand.drives):
        led[d] += (felt[d] - drive[d]) / hand.stiffness[d]
    past = chain_beyond_stops(believed, led)
    for d in range(hand.drives):
        k = hand.stiffness[d]
        felt[d] -= past[d] * (k * hand.stop / (k + hand.stop))
    return felt


@wp.kernel(enable_backward=False, module="warpgrasp.chain_closing.chain_closing_kernels")
def chain_closing_kernel(
    first: int,
    has_lanes: wp.bool,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array2d[Chain],
    believed: wp.array2d[Chain],
    sensors: wp.array2d[TorqueSensor],
    march_scale: real,
    # Probe in:
    key: wp.array[wp.uint64],
    probe_number: wp.array2d[int],
    probe_status: wp.array3d[int],
    closes: wp.array3d[int],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[vec6],
    come: wp.array4d[real],
    command_count: wp.array[int],
    # Out:
    felt: wp.array4d[ChainClosingRow],
    truth: wp.array4d[ChainTruthRow],
    ended: wp.array4d[ChainGrip],
):
    """A finger's closing: status, step, and the equilibrium there before refinement; of a finger
    that presses where it stops, and whose skin rubs, what its last step began with."""
    w, p, g, finger = wp.tid()
    w += first
    clear_chain_rows(felt, truth, probe_status, w, p, g, finger)
    if probe_status[w, p, g] != _CONTACT:
        return
    hand = hands[w % hands.shape[0], finger]
    sensor = sensors[w % sensors.shape[0], finger]
    which = body[w % body.shape[0]]
    base = hand_from_body(body_pose, hand_pose, w, p)
    reader = counter_key(finger_stream(key, probe_number, w, p, g, finger), _TENSION_STEP)
    last = command_count[g] - 1
    stays = stays_open(closes, w, p, finger)
    if stays:
        last = 0
    now = _State()
    now.free.step = -1
    command = path[g, finger, 0] - hand.offset
    before = vec6(command)
    pressed = int(0)
    stopped = int(-1)
    reading = real(0.0)
    s = int(0)
    while s <= last:
        if pressed == 0:
            begin = now.free.step + 1
            if has_lanes:
                now.free = advance_in_lanes(scene, which, hand, base, path, come, g, finger,
                                            march_scale, now.free, last + 1)
            else:
                now.free = advance_chain(scene, which, hand, base, path, come, g, finger,
                                         march_scale, now.free, last + 1)
            if sensor.suspect > ZERO:
                for t in range(begin, now.free.step):
                    if stopped < 0 and noise_may_stop(sensor, hand.drives, counter_key(reader, t)):
                        command = path[g, finger, t] - hand.offset
                        delta = path[g, finger, t] - path[g, finger, wp.max(t - 1, 0)]
                        now.rest = free_chain(chain_free_joints(hand, base, command))
                        drawn = guard_reading(
                            sensor, hand.drives,
                            guarded_torque(hand, believed[0, finger], base, command, now.rest.q),
                            ZERO, delta, counter_key(reader, t))
                        if drawn[0] > ONE:
                            stopped = int(t)
                            reading = drawn[1]
            if stopped >= 0:
                break
            s = int(now.free.step)
            if s > last:
                command = path[g, finger, last] - hand.offset
                now.rest = free_chain(chain_free_joints(hand, base, command))
                break
            command = path[g, finger, s] - hand.offset
            if hand.friction > ZERO:
                now.rubbed = start_rubbed(hand, base,
                                          path[g, finger, wp.max(s - 1, 0)] - hand.offset)
            else:
                now.rest = free_chain(chain_free_joints(hand, base, command))
                now.rest = finger_equilibrium(scene, which, hand, base, command, now.rest.q,
                                              now.rest, LINK_SAMPLES, NO_FRICTION)
        else:
            before = vec6(command)
            command = path[g, finger, s] - hand.offset
            if hand.friction == ZERO:
                ahead = predicted(hand, before, now.rest, command)
                now.rest = finger_equilibrium(scene, which, hand, base, command, ahead, now.rest,
                                              LINK_SAMPLES, NO_FRICTION)
        if hand.friction > ZERO:
            now.rubbed = next_rubbed(scene, which, hand, base, command, now.rubbed, LINK_SAMPLES)
            now.rest = now.rubbed.rest
            pressed = int(now.rubbed.pressed)
        else:
            pressed = int(touches(hand, now.rest))
        if pressed == 1:
            truth[w, p, g, finger].strayed = wp.max(
                truth[w, p, g, finger].strayed, strayed(hand, base, command, now.rest.q))
            if truth[w, p, g, finger].touched < 0:
                truth[w, p, g, finger].touched = s
        if pressed == 1 or sensor.suspect > ZERO:
            delta = path[g, finger, s] - path[g, finger, wp.max(s - 1, 0)]
            drawn = guard_reading(
                sensor, hand.drives,
                guarded_torque(hand, believed[0, finger], base, command, now.rest.q),
                tip_force(hand, now.rest), delta, counter_key(reader, s))
            if drawn[0] > ONE:
                stopped = int(s)
                reading = drawn[1]
                break
        if pressed == 0:
            now.free.step = int(s)
            for c in range(hand.capsule_count):
                now.free.until[c] = come[g, finger, c, s] - march_scale * wp.max(
                    now.rest.depth[c], now.rest.table[c])
        s += 1

    if stays:
        stopped = int(-1)
    at = wp.where(stopped < 0, last, stopped)
    if stopped >= 0 and pressed == 1 and hand.friction > ZERO:
        now.rest = refine_rubbed(scene, which, hand, base, now.rubbed)
        ended[w, p, g, finger] = now.rubbed.grip
    truth[w, p, g, finger].q = now.rest.q
    truth[w, p, g, finger].torque = wp.cw_mul(command - now.rest.q, hand.stiffness)
    truth[w, p, g, finger].along = now.rest.along
    truth[w, p, g, finger].bend = now.rest.bend
    truth[w, p, g, finger].depth = now.rest.depth
    felt[w, p, g, finger].step = at
    if stopped < 0:
        felt[w, p, g, finger].status = _NO_CONTACT
        return
    felt[w, p, g, finger].reading = reading
    truth[w, p, g, finger].link = pressed - 1
