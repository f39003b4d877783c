# type: ignore  # Warp functions, which type checkers cannot follow
"""The kernel of a closing: at which step each finger stops.

A finger follows its commands. At each step it rests where its energy is least. It stops at the
first step at which the tendon difference of a flexion joint exceeds the threshold (Allen and
Michelman 1990, section IV-C). The equilibrium is computed at few of the steps:

- Free: until a link touches, the finger follows its commands but for its weight (`free_motion`).
  Where friction, noise and weight alone may stop it, the readings of all these steps are drawn.
- Pressed: the equilibrium at one step bounds the joint torques at later steps to a ball, and those
  at two steps bound the torques between them more tightly (`torque_bounds`). A step is skipped
  where its reading, with the noise drawn for it, stays below the threshold for all torques in the
  ball. The next equilibrium is computed where the reading should cross the threshold to first
  order, and then at the steps before it that this does not exclude.

The finger stops at the step at which it would stop if every step were computed, as long as the
contact energy is convex. Where a finger slips off an edge it is not: therefore no more than
`_STRIDE` is skipped at once, and where two equilibria contradict convexity the stride is halved,
down to single steps.
"""

import warp as wp

from warpgrasp.closing.closing_record import (
    ClosingRow,
    ClosingTruthRow,
    base_from_body,
    clear_rows,
    finger_key,
    stays_open,
)
from warpgrasp.core.dtypes import ZERO, real, struct, transform, vec4
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key
from warpgrasp.finger.energy import Equilibrium, free_equilibrium, largest_magnitude
from warpgrasp.finger.equilibrium import finger_equilibrium
from warpgrasp.finger.free_motion import FreeFinger, advance_free, start_free
from warpgrasp.finger.friction import NO_FRICTION
from warpgrasp.finger.path_record import LinkStep, PathStep, true_command
from warpgrasp.finger.torque_bounds import (
    agree,
    bound_shares,
    intersect_balls,
    may_stop,
    predict_joints,
    stop_reading,
    torque_bound,
)
from warpgrasp.geometry.scene import Scene, body_is_convex
from warpgrasp.geometry.segment_distance import LINK_SAMPLES
from warpgrasp.mechanism.tendon_kernel import TendonSensor
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, free_joints
from warpgrasp.probe_status import ProbeStatus

wp.set_module_options({"max_unroll": 1})  # few copies of the distance: they are then inlined
_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_TENSION_STEP = wp.constant(int(Purpose.TENSION_STEP))
_FAR = wp.constant(1000000)  # steps
_STRIDE = wp.constant(real(0.04))  # [rad] of a joint's command between two solved steps


@struct
class ClosingState:
    """The state of a closing finger. Fields of a struct change in place; a variable assigned in a
    branch would be copied.

    `low` is the equilibrium at the last step known not to stop the finger, `high` that at a step
    ahead, `free` the state of a finger that does not press.
    """

    low: Equilibrium
    high: Equilibrium
    free: FreeFinger


@wp.kernel(enable_backward=False)
def closing_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array2d[Hand],
    sensors: wp.array2d[TendonSensor],
    march_scale: real,
    # Probe in:
    key: wp.array[wp.uint64],
    probe_number: wp.array2d[int],
    probe_status: wp.array3d[int],
    closes: wp.array3d[int],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[PathStep],
    links: wp.array4d[LinkStep],
    command_count: wp.array[int],
    # Out:
    felt: wp.array4d[ClosingRow],
    truth: wp.array4d[ClosingTruthRow],
):
    """A finger's closing: status, step, and the equilibrium there before refinement."""
    w, p, g, finger = wp.tid()
    w += first
    clear_rows(felt, truth, probe_status, w, p, g, finger)
    if probe_status[w, p, g] != _CONTACT:
        return

    hand = hands[w % hands.shape[0], finger]
    sensor = sensors[w % sensors.shape[0], finger]
    which = body[w % body.shape[0]]
    base = base_from_body(body_pose, hand_pose, hand, w, p, finger)
    reader = counter_key(finger_key(key, probe_number, w, p, g, finger), _TENSION_STEP)
    last = command_count[g] - 1
    stays = stays_open(closes, w, p, finger)
    if stays:
        last = 0
    k = hand.stiffness

    # Along a link the distance to a convex body has one valley.
    convex = body_is_convex(scene, which)
    samples = wp.where(convex, 0, LINK_SAMPLES)

    listening = sensor.heard != 0 or path[g, finger, last].strain > ZERO
    now = ClosingState()
    now.free = start_free(scene, which, convex, hand, base, links[g, finger, 1, 0].end)
    # Steps of `now.low` and, if not negative, of `now.high`.
    now.low = free_equilibrium(true_command(hand, path, g, finger, 0))
    heard = int(0)  # free steps before are known not to stop the finger
    low_step = int(-1)
    low_command = now.low.q
    low_pressed = int(0)
    high_step = int(-1)
    high_command = now.low.q
    high_pressed = int(0)
    high_reading = real(0.0)
    stopped = int(-1)
    reading = real(0.0)
    s = int(0)
    in_order = int(1)  # no step before `s` stops the finger
    jump = int(_FAR)  # most steps that are skipped at once, up to step `slips`
    slips = int(-1)
    while s <= last:
        if low_pressed == 0:
            # FreeFinger, to the step at which something may be touched.
            now.free = advance_free(scene, which, convex, hand, base, path, links, g, finger,
                                    march_scale, now.free, last + 1)
            s = int(now.free.step)
            if listening:
                while heard < s and stopped < 0:
                    command = true_command(hand, path, g, finger, heard)
                    now.low = free_equilibrium(free_joints(hand, base, command))
                    delta = command - true_command(hand, path, g, finger, wp.max(heard - 1, 0))
                    reading = stop_reading(sensor, (command - now.low.q) * k, delta,
                                           counter_key(reader, heard))
                    if wp.abs(reading) > sensor.threshold:
                        stopped = int(heard)
                    heard += 1
            if stopped >= 0:
                break
            if s > last:
                now.low = free_equilibrium(free_joints(
                    hand, base, true_command(hand, path, g, finger, last)))
                break
            heard = s + 1
            now.low = free_equilibrium(free_joints(
                hand, base, true_command(hand, path, g, finger, s)))
            now.low.along = now.free.along
            now.low.bend = now.free.bend
            now.low.depth = -now.free.room

        # Solve step `s`.
        command = true_command(hand, path, g, finger, s)
        start = now.low.q
        if low_pressed == 1:
            start = predict_joints(low_command, now.low, command, k)
        known = low_pressed == 0 and wp.min(now.low.along) >= ZERO
        solved = finger_equilibrium(scene, which, hand, base, command, start, now.low,
                           wp.where(known, 0, samples), NO_FRICTION)
        if low_pressed == 1 and s > low_step + 1:
            if not agree(low_command, now.low, command, solved, k):
                # Something slips on the way here.
                high_step = int(-1)
                slips = wp.max(slips, s)
                jump = (s - low_step) // 2
                s = low_step + jump
                in_order = int(jump == 1)
                continue
        pressed = int(wp.max(wp.max(solved.depth), wp.max(solved.table)) > ZERO)
        reading = real(0.0)
        if pressed == 1 and (truth[w, p, g, finger].touched < 0
                             or s < truth[w, p, g, finger].touched):
            truth[w, p, g, finger].touched = s
        if pressed == 1 or listening:
            delta = command - true_command(hand, path, g, finger, wp.max(s - 1, 0))
            reading = stop_reading(sensor, (command - solved.q) * k, delta,
                                   counter_key(reader, s))
        if in_order == 0:
            now.high = solved
            high_step = int(s)
            high_command = vec4(command)
            high_pressed = int(pressed)
            high_reading = reading
            in_order = int(1)
        else:
            now.low = solved
            low_step = int(s)
            low_command = vec4(command)
            low_pressed = int(pressed)
            if wp.abs(reading) > sensor.threshold:
                stopped = int(s)
                break
            if pressed == 0:
                now.free.step = int(s)
                for link in range(3):
                    now.free.room[link] = -march_scale * wp.max(
                        solved.depth[link], solved.table[link])
                continue

        # Skip the steps that cannot stop the finger.
        if low_step >= slips:
            jump = int(_FAR)
        low_shares = bound_shares(hand, now.low)
        s = low_step + 1
        while s <= last:
            command = true_command(hand, path, g, finger, s)
            if s == high_step:
                high_step = int(-1)
                if high_pressed == 0:
                    break
                now.low = now.high
                low_step = int(s)
                low_command = vec4(high_command)
                low_shares = bound_shares(hand, now.low)
                reading = high_reading
                if wp.abs(reading) > sensor.threshold:
                    stopped = int(s)
                    break
            else:
                ball = torque_bound(low_command, now.low, command, k, low_shares)
                if high_step >= 0:
                    ball = intersect_balls(ball, torque_bound(
                        high_command, now.high, command, k, bound_shares(hand, now.high)))
                elif s - low_step >= jump or largest_magnitude(command - low_command) > _STRIDE:
                    break
                delta = command - true_command(hand, path, g, finger, s - 1)
                if may_stop(sensor, ball, delta, counter_key(reader, s)):
                    break
            s += 1
        if stopped >= 0 or low_step == last:
            break
        s = wp.min(s, last)
        if high_step < 0:
            # Jump to where the reading is expected to stop the finger.
            ahead = int(s)
            while ahead < last and ahead - low_step < jump and (
                    largest_magnitude(command - low_command) <= _STRIDE):
                command = true_command(hand, path, g, finger, ahead)
                delta = command - true_command(hand, path, g, finger, ahead - 1)
                guess = (command - predict_joints(low_command, now.low, command, k)) * k
                if wp.abs(stop_reading(sensor, guess, delta,
                                       counter_key(reader, ahead))) > sensor.threshold:
                    break
                ahead += 1
            if ahead > s:
                in_order = int(0)
            s = int(ahead)

    if stays:
        stopped = int(-1)
    at = wp.where(stopped < 0, last, stopped)
    truth[w, p, g, finger].q = now.low.q
    torque = (true_command(hand, path, g, finger, at) - now.low.q) * k
    truth[w, p, g, finger].torque = torque
    truth[w, p, g, finger].along = now.low.along
    truth[w, p, g, finger].bend = now.low.bend
    truth[w, p, g, finger].depth = now.low.depth
    if stopped < 0:
        felt[w, p, g, finger].status = _NO_CONTACT
        felt[w, p, g, finger].step = last
        return
    felt[w, p, g, finger].step = stopped
    felt[w, p, g, finger].difference = reading
    truth[w, p, g, finger].link = low_pressed - 1
