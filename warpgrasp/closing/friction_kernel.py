# type: ignore  # Warp functions, which type checkers cannot follow
"""The kernel of a closing with friction: at which step each finger stops.

As `closing_kernel`, but the skin of a finger that touches remembers how it is stretched
(`finger.friction`). So every step is computed from the first that touches on; only free steps are
skipped.
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
from warpgrasp.core.dtypes import ZERO, real, transform
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key
from warpgrasp.finger.free_motion import advance_free, start_free
from warpgrasp.finger.path_record import LinkStep, PathStep, true_command
from warpgrasp.finger.torque_bounds import stop_reading
from warpgrasp.geometry.scene import Scene, body_is_convex
from warpgrasp.geometry.segment_distance import LINK_SAMPLES
from warpgrasp.mechanism.tendon_kernel import TendonSensor
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, free_joints
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.rubbing.friction_step import next_rubbed, refine_rubbed, start_rubbed

_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_TENSION_STEP = wp.constant(int(Purpose.TENSION_STEP))


@wp.kernel(enable_backward=False, module="warpgrasp.closing.closing_kernels")
def friction_kernel(
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
    """A finger's closing: status, step, and the rest there."""
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
    convex = body_is_convex(scene, which)
    samples = wp.where(convex, 0, LINK_SAMPLES)
    listening = sensor.heard != 0 or path[g, finger, last].strain > ZERO

    free = start_free(scene, which, convex, hand, base, links[g, finger, 1, 0].end)
    now = start_rubbed(hand, base, true_command(hand, path, g, finger, 0))
    heard = int(0)  # free steps before are known not to stop the finger
    stopped = int(-1)
    reading = real(0.0)
    s = int(0)
    while s <= last:
        known = False
        if now.pressed == 0:
            free = advance_free(scene, which, convex, hand, base, path, links, g, finger,
                                march_scale, free, last + 1)
            s = free.step
            if listening:
                while heard < wp.min(s, last + 1) and stopped < 0:
                    command = true_command(hand, path, g, finger, heard)
                    delta = command - true_command(hand, path, g, finger, wp.max(heard - 1, 0))
                    now.rest.q = free_joints(hand, base, command)
                    reading = stop_reading(sensor, (command - now.rest.q) * k, delta,
                                           counter_key(reader, heard))
                    if wp.abs(reading) > sensor.threshold:
                        stopped = int(heard)
                    heard += 1
            if stopped >= 0:
                break
            now = start_rubbed(hand, base, true_command(hand, path, g, finger,
                                                        wp.min(wp.max(s - 1, 0), last)))
            if s > last:
                break
            heard = s + 1
            now.rest.along = free.along
            now.rest.bend = free.bend
            # As at the step itself: bounds of it hold for the one before within what a step moves.
            now.rest.depth = -free.room
            known = wp.min(free.along) >= ZERO
        now = next_rubbed(scene, which, hand, base, true_command(hand, path, g, finger, s), now,
                          wp.where(known, 0, samples))
        reading = real(0.0)
        if now.pressed == 1 and truth[w, p, g, finger].touched < 0:
            truth[w, p, g, finger].touched = s
        if now.pressed == 1 or listening:
            delta = now.command - true_command(hand, path, g, finger, wp.max(s - 1, 0))
            reading = stop_reading(sensor, (now.command - now.rest.q) * k, delta,
                                   counter_key(reader, s))
            if wp.abs(reading) > sensor.threshold:
                stopped = int(s)
                break
        if now.pressed == 0:
            free.step = s
            for link in range(3):
                free.room[link] = -march_scale * wp.max(now.rest.depth[link], now.rest.table[link])
        s += 1

    if stays:
        stopped = int(-1)
    at = wp.where(stopped < 0, last, stopped)
    if stopped >= 0 and now.pressed == 1:
        now.rest = refine_rubbed(scene, which, hand, base, now)
    truth[w, p, g, finger].q = now.rest.q
    truth[w, p, g, finger].torque = (true_command(hand, path, g, finger, at) - now.rest.q) * k
    truth[w, p, g, finger].along = now.rest.along
    truth[w, p, g, finger].bend = now.rest.bend
    truth[w, p, g, finger].depth = now.rest.depth
    felt[w, p, g, finger].step = at
    felt[w, p, g, finger].status = _NO_CONTACT
    if stopped >= 0:
        felt[w, p, g, finger].status = _CONTACT
        felt[w, p, g, finger].difference = reading
        truth[w, p, g, finger].link = now.pressed - 1
