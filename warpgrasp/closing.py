"""Tendon-guarded closing: the contact event of the paper's first exploratory procedure.

All fingers of all grasps of all probes of all worlds close in one launch. A finger steps along its
commands; at each step it rests where its energy is least; it stops at the first step whose tendon
difference of a flexion joint exceeds the threshold (Allen and Michelman 1990, section IV-C).

Free steps are not simulated one by one: while the distance to everything exceeds how far the links
can have moved, the finger follows its command exactly (see `finger_path`), and a false stop
(friction and noise alone past the threshold) is drawn from its exact first-passage law.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from warpgrasp.closing_reading import read_stops
from warpgrasp.counter_random import (
    Purpose,
    counter_key,
    counter_uniform,
)
from warpgrasp.finger_energy import rest_from
from warpgrasp.finger_path import PathStep, first_uncertain, path_table
from warpgrasp.finger_rest import finger_rest
from warpgrasp.launch import launch
from warpgrasp.link_nearest import LINK_SAMPLES, link_nearest
from warpgrasp.parameters import HandTable, SensorTable
from warpgrasp.real import HALF, ONE, ZERO, real, transform, vec3, vec4
from warpgrasp.scene import Scene
from warpgrasp.status import ProbeStatus
from warpgrasp.tendon import (
    TendonSensor,
    may_cross,
    moving_sign,
    tendon_sensor_of,
    tendon_tensions,
    tension_difference_read,
)
from warpgrasp.utah_mit_hand import (
    FINGER_COUNT,
    Hand,
    finger_base,
    hand_of,
)

wp.set_module_options({"max_unroll": 1})  # few copies of the distance: they are then inlined
_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_FALSE_STOP = wp.constant(int(Purpose.FALSE_STOP))
_TENSION_STEP = wp.constant(int(Purpose.TENSION_STEP))
_TENSION_REST = wp.constant(int(Purpose.TENSION_REST))
_JOINT = wp.constant(int(Purpose.JOINT))
_NAN = wp.constant(real(float("nan")))
_REDRAWS = wp.constant(100000)


@dataclass(frozen=True)
class ClosingTruth:
    """What happened, for the scorer alone. Shapes start with (world, probe, grasp, finger)."""

    q_rad: np.ndarray
    """Joints at rest [rad], (..., 4)."""
    torque_Nm: np.ndarray
    """Joint torques at rest [N m], (..., 4)."""
    link: np.ndarray
    """Link that bears the largest force (0 proximal to 2 distal), -1: none, a false stop."""
    point_m: np.ndarray
    """Contact on the surface, base frame [m], (..., 3); NaN without contact."""
    normal: np.ndarray
    """Outward surface normal there, (..., 3)."""
    on_table: np.ndarray
    """Whether the table, not the object, was touched."""


@dataclass(frozen=True)
class Closing:
    """What the robot knows of a closing. Shapes start with (world, probe, grasp, finger)."""

    status: np.ndarray
    """ProbeStatus."""
    step: np.ndarray
    """Command at which the finger stopped (its number on the path)."""
    q_rad: np.ndarray
    """Joint angles as read [rad], (..., 4)."""
    tension_N: np.ndarray
    """Mean tensions read at rest [N], (..., joint 4, flexor and extensor 2)."""
    tension_difference_N: np.ndarray
    """The reading that stopped the finger [N] (largest of the flexions); NaN without a stop."""


@wp.func
def _clearance(scene: Scene, body: int, hand: Hand, base: transform, at: PathStep, link: int):
    """Distance of a free link's skin to everything [m], or a lower bound where it is far."""
    a = at.p1
    b = at.p2
    if link == 1:
        a = at.p2
        b = at.p3
    elif link == 2:
        a = at.p3
        b = at.p4
    a = wp.transform_point(base, a)
    length = hand.link_length[link]
    u = (wp.transform_point(base, b) - a) / length
    near = link_nearest(scene, body, a, u, length, -ONE, ONE, LINK_SAMPLES,
                        length * HALF + hand.link_radius)
    table = a[2] + wp.min(u[2], ZERO) * length
    return wp.min(near.distance, table) - hand.link_radius


@wp.func
def _stop_reading(
    hand: Hand, sensor: TendonSensor, torque: vec4, delta: vec4, key: wp.uint64
):
    """The largest tendon difference of the flexion joints in one reading of each [N], by size.

    Readings that are sure to stay below the threshold are left out.
    """
    largest = real(0.0)
    for j in range(1, 4):
        tensions = tendon_tensions(hand, j, torque[j], moving_sign(delta[j]))
        noise = counter_key(key, j)
        if may_cross(sensor, tensions, noise):
            d = tension_difference_read(sensor, tensions, noise)
            if wp.abs(d) > wp.abs(largest):
                largest = d
    return largest


@wp.kernel(enable_backward=False)
def _closing_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array[Hand],
    sensors: wp.array[TendonSensor],
    march_scale: real,
    # Probe in:
    key: wp.array[wp.uint64],
    probe_first: int,
    probe_status: wp.array3d[int],
    hand_pose: wp.array2d[transform],
    path: wp.array3d[PathStep],
    travel: wp.array3d[vec3],
    command_count: wp.array[int],
    # Out:
    status: wp.array4d[int],
    step: wp.array4d[int],
    difference: wp.array4d[real],
    q_true: wp.array4d[vec4],
    torque_true: wp.array4d[vec4],
    link_true: wp.array4d[int],
):
    w, p, g, finger = wp.tid()
    w += first
    status[w, p, g, finger] = probe_status[w, p, g]
    step[w, p, g, finger] = -1
    link_true[w, p, g, finger] = -1
    difference[w, p, g, finger] = _NAN
    q_true[w, p, g, finger] = vec4(_NAN, _NAN, _NAN, _NAN)
    torque_true[w, p, g, finger] = vec4(_NAN, _NAN, _NAN, _NAN)
    if probe_status[w, p, g] != _CONTACT:
        return

    hand = hands[w % hands.shape[0]]
    sensor = sensors[w % sensors.shape[0]]
    which = body[w % body.shape[0]]
    to_body = wp.transform_inverse(body_pose[w])
    base = wp.transform_multiply(
        to_body, wp.transform_multiply(hand_pose[w, p], finger_base(hand, finger)))
    stream = counter_key(counter_key(counter_key(key[w], probe_first + p), g), finger)
    last = command_count[g] - 1

    # First passage of a false stop: exponential in the summed hazard of the free steps.
    patience = -wp.log(counter_uniform(counter_key(stream, _FALSE_STOP)))
    hazard_moving = -wp.log(wp.max(ONE - sensor.false_stop_moving, real(1e-300)))
    hazard_still = -wp.log(wp.max(ONE - sensor.false_stop_still, real(1e-300)))
    hazard = real(0.0)

    q = path[g, finger, 0].command
    known = rest_from(q)  # of the links, when the finger last rested
    free = vec3(ZERO, ZERO, ZERO)  # how far each link can still move for certain [m]
    torque = vec4(ZERO, ZERO, ZERO, ZERO)
    delta = vec4(ZERO, ZERO, ZERO, ZERO)
    stopped = int(-1)
    reading = real(0.0)
    touching = int(0)
    s = int(0)
    while s <= last:
        at = path[g, finger, s]
        delta = at.command - path[g, finger, wp.max(s - 1, 0)].command
        maybe = int(touching)
        if touching == 0:
            q = at.command
            known = rest_from(q)
            for link in range(3):
                if free[link] <= ZERO:
                    free[link] = march_scale * _clearance(scene, which, hand, base, at, link)
                    if free[link] <= ZERO:
                        maybe = int(1)
        if maybe == 1:
            # Where the joints go to first order when the command moves on.
            ahead = q
            if touching == 1:
                ahead = q + known.compliance * (delta * hand.stiffness)
            known = finger_rest(scene, which, hand, base, at.command, ahead, known)
            q = known.q
            touching = int(0)
            for link in range(3):
                pressed = wp.max(known.depth[link], known.table[link])
                free[link] = -march_scale * pressed
                if pressed > ZERO:
                    touching = int(1)
        if touching == 1:
            torque = (at.command - q) * hand.stiffness
            reading = _stop_reading(hand, sensor, torque, delta,
                                    counter_key(counter_key(stream, _TENSION_STEP), s))
            if wp.abs(reading) > sensor.threshold:
                stopped = int(s)
                break
            s += 1
        else:
            torque = vec4(ZERO, ZERO, ZERO, ZERO)
            next_step = first_uncertain(travel, g, finger, s, last, free)
            moves = path[g, finger, next_step - 1].moves - path[g, finger, wp.max(s - 1, 0)].moves
            ahead_hazard = hazard_moving * moves + hazard_still * (
                real(3 * (next_step - s)) - moves)
            if hazard + ahead_hazard >= patience:
                # Noise stops the finger on the way: at the first step that uses up the patience.
                for k in range(s, next_step):
                    before = path[g, finger, wp.max(k - 1, 0)]
                    delta = path[g, finger, k].command - before.command
                    moves = path[g, finger, k].moves - before.moves
                    hazard += hazard_moving * moves + hazard_still * (real(3.0) - moves)
                    stopped = int(k)
                    if hazard >= patience:
                        break
                q = path[g, finger, stopped].command
                redraw = counter_key(counter_key(stream, _FALSE_STOP), stopped)
                for attempt in range(_REDRAWS):
                    reading = _stop_reading(hand, sensor, torque, delta,
                                            counter_key(redraw, attempt))
                    if wp.abs(reading) > sensor.threshold:
                        break
                break
            hazard += ahead_hazard
            if next_step > last:
                q = path[g, finger, last].command
                delta = q - path[g, finger, wp.max(last - 1, 0)].command
            else:
                free -= travel[g, finger, next_step] - travel[g, finger, s]
            s = next_step

    q_true[w, p, g, finger] = q
    torque_true[w, p, g, finger] = torque
    if stopped < 0:
        status[w, p, g, finger] = _NO_CONTACT
        step[w, p, g, finger] = last
        return
    step[w, p, g, finger] = stopped
    difference[w, p, g, finger] = reading
    link_true[w, p, g, finger] = touching - 1


def close_fingers(
    scene: Scene,
    body: np.ndarray,
    body_pose: np.ndarray,
    hand: HandTable,
    sensors: SensorTable,
    key: np.ndarray,
    probe_status: np.ndarray,
    hand_pose: np.ndarray,
    commands_rad: np.ndarray,
    command_count: np.ndarray,
    *,
    probe_first: int = 0,
    march_scale: float = 1.0,
    device: str = "cpu",
) -> tuple[Closing, ClosingTruth]:
    """Close every finger of every grasp at every probe, guarded by the tendon difference.

    `body` (world or 1,) numbers the scene's bodies, `body_pose` and `hand_pose` (the true ones) are
    [m] and quaternion xyzw, shapes (world, 7) and (world, probe, 7), in the base frame, the table
    at z = 0. `key` (world,) uint64 seeds the noise,
    `probe_first` numbers the probes on. `probe_status` (world, probe, grasp) says
    CONTACT where the probe is to be made; other values are passed on. `commands_rad` has shape
    (grasp, finger, step, 4), of which `command_count` (grasp,) steps count. `march_scale` shortens
    the skipping of free steps for bodies whose distance is not a sure bound. Raises ShapeError.
    """
    worlds, probes = hand_pose.shape[:2]
    grasps = len(command_count)
    extents = {"world": worlds, "probe": probes, "grasp": grasps, "finger": FINGER_COUNT}
    dims = tuple(extents.values())

    def empty(dtype: type) -> wp.array:
        return wp.empty(dims, dtype=dtype, device=device)

    stop = {"status": empty(int), "step": empty(int), "difference": empty(real),
            "q_true": empty(vec4), "torque_true": empty(vec4), "link_true": empty(int)}
    shapes = dict.fromkeys(stop, "world probe grasp finger") | {
        "body": "world?", "body_pose": "world", "hands": "world?", "sensors": "world?",
        "key": "world", "probe_status": "world probe grasp", "hand_pose": "world probe",
        "path": "grasp finger step", "travel": "grasp finger step", "command_count": "grasp"}
    path, travel = path_table(hand, commands_rad)
    given = {
        "scene": scene,
        "body": wp.array(body, dtype=int, device=device),
        "body_pose": wp.array(body_pose, dtype=transform, device=device),
        "hands": wp.array([hand_of(hand)], dtype=Hand, device=device),
        "sensors": wp.array([tendon_sensor_of(hand, sensors)], dtype=TendonSensor, device=device),
        "key": wp.array(key, dtype=wp.uint64, device=device), "probe_first": probe_first,
        "hand_pose": wp.array(hand_pose, dtype=transform, device=device),
        "path": wp.array(path, dtype=PathStep, device=device)}
    launch(_closing_kernel, extents, shapes, given | stop | {
        "march_scale": march_scale,
        "probe_status": wp.array(probe_status, dtype=int, device=device),
        "travel": wp.array(travel, dtype=vec3, device=device),
        "command_count": wp.array(command_count, dtype=int, device=device)}, device=device)
    difference = stop.pop("difference").numpy().copy()
    read = read_stops(extents, given | stop, device)
    host = {name: array.numpy().copy() for name, array in (stop | read).items()}
    tension = np.stack([host["tension_flexor"], host["tension_extensor"]], -1)
    felt = Closing(host["status"], host["step"], host["q_read"], tension, difference)
    truth = ClosingTruth(host["q_true"], host["torque_true"], host["link_true"],
                         host["point_true"], host["normal_true"], host["on_table"].astype(bool))
    return felt, truth


