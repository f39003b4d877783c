"""The second guarded move: arm or finger along a line, in intervals, until a pad feels.

After each interval the paper's two checks (Allen and Michelman 1990, section IV-D): does a pad of
the finger feel? did the finger move the whole way, by its measured joint angles? What moves is the
hand along a straight line, or the finger along its commands, or both. A finger that presses yields
by the energy of `pad_rest`. The same move backwards ends when the pads feel nothing any more.

Free intervals are skipped by the distance bound; a touch by noise alone is drawn by its
first-passage law. A false yield (joint noise past `yield_rad`, five sigma by default) is not drawn.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import warp as wp

from warpgrasp.counter_random import Purpose, counter_key, counter_normal, counter_uniform
from warpgrasp.finger_rest import link_direction, link_start
from warpgrasp.hand_clearance import finger_clearance, palm_clearance
from warpgrasp.launch import launch
from warpgrasp.link_nearest import nearest_along
from warpgrasp.pad_rest import PadRest, pad_rest
from warpgrasp.pad_touch import felt_above, image_centroid, pad_load, read_image
from warpgrasp.parameters import ArmTable, HandTable, PadTable, SensorTable
from warpgrasp.puma560 import Arm, arm_of, move_time, puma_forward, puma_reach
from warpgrasp.real import HALF, ONE, ZERO, quat, real, transform, vec3, vec4, vec6
from warpgrasp.scene import Scene, stand_distance, stand_distance_grad
from warpgrasp.status import ProbeStatus
from warpgrasp.tactile_pad import TAXELS, Pad, pad_of, pad_place, pad_reading_key
from warpgrasp.utah_mit_hand import Hand, finger_base, finger_pose, hand_of

wp.set_module_options({"max_unroll": 1})  # unrolled taxels take minutes to compile
_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_BLOCKED = wp.constant(int(ProbeStatus.BLOCKED))
_UNREACHABLE = wp.constant(int(ProbeStatus.UNREACHABLE))
_COLLISION = wp.constant(int(ProbeStatus.COLLISION))
_FALSE = wp.constant(int(Purpose.PAD_FALSE))
_JOINT = wp.constant(int(Purpose.PAD_JOINT))
_ARM = wp.constant(int(Purpose.LINE_ARM))
_NAN = wp.constant(real(float("nan")))
_SIDE = wp.constant(16)


class Until(IntEnum):
    """What ends a guarded line."""

    CONTACT = 0
    RELEASE = 1
    """A pad that felt feels no more: status NO_CONTACT."""


@dataclass(frozen=True)
class LineTouch:
    """What the robots know of a guarded line. A row for each robot that moved."""

    status: np.ndarray
    """ProbeStatus, shape (row,): CONTACT, NO_CONTACT (spent, or released), BLOCKED, UNREACHABLE,
    COLLISION (the finger is pushed away, or hand strikes, already where the line starts)."""
    link: np.ndarray
    """Link whose pad felt (0 proximal to 2 distal), -1 without a touch."""
    point_m: np.ndarray
    """Believed contact, base frame [m], (row, 3); NaN without a touch."""
    normal: np.ndarray
    """Believed outward normal of the surface: against the pad's, (row, 3)."""
    tip_m: np.ndarray
    """Believed place of the fingertip's centre [m], (row, 3)."""
    hand_pose: np.ndarray
    """Believed hand pose at the end, [m] and quaternion xyzw, (row, 7)."""
    q_rad: np.ndarray
    """Joint angles of the finger as read, (row, 4)."""
    taxel_peak: np.ndarray
    """Largest count of the pad that felt, or of the distal pad."""
    image: np.ndarray
    """Its counts, uint8, (row, 16, 16)."""
    steps: np.ndarray
    """Intervals made."""
    time_s: np.ndarray
    """Move to the start, and the intervals."""
    path_m: np.ndarray
    """Path of the hand's origin, straight between its stations [m]."""


@dataclass(frozen=True)
class LineTruth:
    """What happened, for the scorer alone."""

    rows: np.ndarray
    """World of each row."""
    q_rad: np.ndarray
    """(row, 4)."""
    point_m: np.ndarray
    """Surface point at the pad's centre of force, base frame [m], (row, 3); NaN without load."""
    normal: np.ndarray
    """Outward surface normal there, (row, 3)."""
    force_N: np.ndarray
    """On all taxels together, (row,)."""
    on_table: np.ndarray
    """Whether the table, not the object, was touched."""
    hand_pose: np.ndarray
    """(row, 7)."""


@wp.func
def _along(line: transform, direction: vec3, s: real):
    return transform(wp.transform_get_translation(line) + direction * s,
                     wp.transform_get_rotation(line))


@wp.func
def _command(commands: wp.array3d[real], finger: int, step: int):
    k = wp.min(step, commands.shape[1] - 1)
    return vec4(commands[finger, k, 0], commands[finger, k, 1], commands[finger, k, 2],
                commands[finger, k, 3])


@wp.func
def _finger_free(scene: Scene, body: int, hand: Hand, pad: Pad, base: transform, q: vec4):
    """How far a finger's skin and pads surely are from everything [m]; not positive: may touch."""
    f = finger_pose(hand, base, q)
    free = real(1e9)
    for link in range(3):
        radius = hand.link_radius
        if pad.on[link] != 0:
            radius += pad.thickness
        a = link_start(f, link)
        u = link_direction(f, link)
        length = hand.link_length[link]
        bound = stand_distance(scene, body, a + u * (length * HALF)) - length * HALF - radius
        if bound < free:
            # The bound is loose near by; the nearest point of the axis is exact.
            if bound < real(0.02):
                bound = nearest_along(scene, body, a, u, length)[1] - radius
            free = wp.min(free, bound)
    return free


@wp.func
def _others_free(
    scene: Scene, body: int, hand: Hand, pose: transform, mount: real,
    commands: wp.array3d[real], finger: int
):
    """Clearance of palm and the other fingers [m], which stay at their first command."""
    worst = real(1e9)
    for other in range(4):
        if other != finger:
            worst = finger_clearance(scene, body, hand,
                                     wp.transform_multiply(pose, finger_base(hand, other)),
                                     _command(commands, other, 0), worst)
    return palm_clearance(scene, body, hand, pose, mount, worst)


@wp.func
def _tip(hand: Hand, pose: transform, finger: int, q: vec4):
    f = finger_pose(hand, wp.transform_multiply(pose, finger_base(hand, finger)), q)
    return f.p4


@wp.kernel(enable_backward=False)
def _line_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    arm: Arm,
    hand: Hand,
    pad: Pad,
    joint_noise: real,
    mount: wp.array[transform],
    mount_length: real,
    march_scale: real,
    # Move in:
    key: wp.array[wp.uint64],
    rows: wp.array[int],
    move: wp.array[int],
    start: wp.array[transform],
    direction: wp.array[vec3],
    interval: real,
    steps: int,
    finger: int,
    commands: wp.array3d[real],
    step_bound: real,
    until_release: int,
    arm_q: wp.array[vec6],
    # Touch out:
    status: wp.array[int],
    link_out: wp.array[int],
    point: wp.array[vec3],
    normal: wp.array[vec3],
    tip: wp.array[vec3],
    believed: wp.array[transform],
    q_read: wp.array[vec4],
    peak_out: wp.array[int],
    image: wp.array3d[wp.uint8],
    made: wp.array[int],
    arm_time: wp.array[real],
    arm_end: wp.array[vec6],
    # Truth out:
    q_true: wp.array[vec4],
    point_true: wp.array[vec3],
    normal_true: wp.array[vec3],
    force_true: wp.array[real],
    on_table: wp.array[int],
    pose_true: wp.array[transform],
):
    i = wp.tid() + first
    w = rows[i]
    which = body[w % body.shape[0]]
    nan3 = vec3(_NAN, _NAN, _NAN)
    link_out[i] = -1
    point[i] = nan3
    normal[i] = nan3
    point_true[i] = nan3
    normal_true[i] = nan3
    line = start[i]
    way = direction[i]
    hand_on_flange = transform(vec3(ZERO, ZERO, arm.mount), quat(ZERO, ZERO, ZERO, ONE))
    flange_on_hand = wp.transform_inverse(hand_on_flange)

    # How far along the line the arm can go.
    arm_start = puma_reach(arm, wp.transform_multiply(line, flange_on_hand), arm_q[i])
    reachable = int(steps)
    if not wp.isfinite(arm_start[0]):
        status[i] = _UNREACHABLE
        believed[i] = line
        arm_end[i] = arm_q[i]
        q_read[i] = vec4(_NAN, _NAN, _NAN, _NAN)
        tip[i] = nan3
        return
    arm_last = puma_reach(arm, wp.transform_multiply(
        _along(line, way, interval * real(steps)), flange_on_hand), arm_start)
    if not wp.isfinite(arm_last[0]):
        low = int(0)
        high = int(steps)
        while high - low > 1:
            middle = (low + high) // 2
            arm_try = puma_reach(arm, wp.transform_multiply(
                _along(line, way, interval * real(middle)), flange_on_hand), arm_start)
            if wp.isfinite(arm_try[0]):
                low = middle
            else:
                high = middle
        reachable = low

    noise = counter_key(counter_key(key[w], _ARM), move[i])
    wobble = vec3(counter_normal(counter_key(noise, 0)), counter_normal(counter_key(noise, 1)),
                  counter_normal(counter_key(noise, 2))) * arm.repeatability
    to_body = wp.transform_inverse(body_pose[w])
    patience = -wp.log(counter_uniform(counter_key(counter_key(key[w], _FALSE), move[i])))
    hazard_step = -wp.log(wp.max(ONE - pad.false_touch, real(1e-300)))
    hazard = real(0.0)

    end = _NO_CONTACT
    if reachable < steps:
        end = _UNREACHABLE
    s = int(0)
    q = _command(commands, finger, 0)
    here = line
    reader = counter_key(counter_key(key[w], _JOINT), move[i])
    read = q
    felt_link = int(-1)
    peak = int(0)
    rest = PadRest()
    most = vec4(ZERO, ZERO, ZERO, ZERO)
    moved = int(0)
    while True:
        command = _command(commands, finger, s)
        if moved == 0:
            q = command
        here = wp.transform_multiply(_along(line, way, interval * real(s)), mount[w])
        here = transform(wp.transform_get_translation(here) + wobble,
                         wp.transform_get_rotation(here))
        pose = wp.transform_multiply(to_body, here)
        base = wp.transform_multiply(pose, finger_base(hand, finger))
        others = _others_free(scene, which, hand, pose, mount_length, commands, finger)
        free = wp.min(_finger_free(scene, which, hand, pad, base, command), others)
        felt_link = int(-1)
        peak = int(0)
        most = vec4(ZERO, ZERO, ZERO, ZERO)
        if free <= ZERO:
            rest = pad_rest(scene, which, hand, pad, base, command, q)
            q = rest.skin.q
            moved = int(1)
            f = finger_pose(hand, base, q)
            # All pads are read; the one pressed most speaks for the finger.
            for link in range(3):
                if pad.on[link] != 0:
                    load = pad_load(scene, which, pad, hand, f, link)
                    if load[3] > most[3]:
                        most = load
                        felt_link = int(link)
            if felt_link >= 0:
                peak = read_image(scene, which, pad, hand, f, finger, felt_link, key[w],
                                  pad_reading_key(key[w], move[i], s, finger, felt_link), image,
                                  i)
        else:
            q = command
            moved = int(0)
        for j in range(4):
            read[j] = q[j] + joint_noise * counter_normal(
                counter_key(counter_key(reader, s), j))
        felt = int(0)
        if real(peak) >= pad.threshold:
            felt = int(1)
        lag = real(0.0)
        for j in range(4):
            lag = wp.max(lag, wp.abs(read[j] - command[j]))
        if until_release == 0 and s == 0 and free <= ZERO and (
                lag > pad.yield_angle or others <= ZERO):
            end = _COLLISION
            felt_link = int(-1)
            break
        if until_release == 0 and felt == 1:
            end = _CONTACT
            break
        if until_release == 1 and felt == 0:
            end = _NO_CONTACT
            break
        if until_release == 1 and s >= reachable:
            end = _CONTACT
            break
        if until_release == 0 and free <= ZERO and (
                lag > pad.yield_angle or others <= ZERO):
            end = _BLOCKED
            break
        if s >= reachable:
            break
        ahead = int(1)
        if until_release == 0 and free > ZERO:
            ahead = wp.clamp(int(wp.floor(free * march_scale / wp.max(step_bound, real(1e-9)))),
                             1, reachable - s)
            hazard += hazard_step * real(ahead)
            if hazard > patience:
                # Noise alone reached the threshold: some taxel, its count the threshold's.
                end = _CONTACT
                felt_link = 2
                peak = int(wp.ceil(pad.threshold))
                draw = counter_key(counter_key(key[w], _FALSE), move[i])
                where = wp.min(int(counter_uniform(counter_key(draw, 1)) * real(256.0)), 255)
                image[i, where // _SIDE, where % _SIDE] = wp.uint8(peak)
                break
        s += ahead

    status[i] = end
    made[i] = s
    peak_out[i] = peak
    q_true[i] = q
    q_read[i] = read
    pose_true[i] = here
    arm_stop = puma_reach(arm, wp.transform_multiply(
        _along(line, way, interval * real(s)), flange_on_hand), arm_start)
    arm_time[i] = move_time(arm, arm_q[i], arm_start)
    arm_end[i] = arm_stop
    if arm.encoder_step > ZERO:
        for j in range(6):
            arm_stop[j] = arm.encoder_step * wp.round(arm_stop[j] / arm.encoder_step)
    pose_read = wp.transform_multiply(puma_forward(arm, arm_stop), hand_on_flange)
    believed[i] = pose_read
    tip[i] = _tip(hand, pose_read, finger, read)
    if most[3] > ZERO:
        centre = vec3(most[0], most[1], most[2])
        g = stand_distance_grad(scene, which, centre)
        n = vec3(g[0], g[1], g[2])
        force_true[i] = most[3]
        point_true[i] = wp.transform_point(body_pose[w], centre - n * g[3])
        normal_true[i] = wp.transform_vector(body_pose[w], n)
        if wp.abs(g[3] - centre[2]) < real(1e-12) and n[2] > real(0.999):
            on_table[i] = 1
    if end == _CONTACT and felt_link >= 0:
        link_out[i] = felt_link
        at = image_centroid(image, i, felt_above(pad))
        touch = pad_place(pad, hand, finger_pose(hand, wp.transform_multiply(
            pose_read, finger_base(hand, finger)), read), felt_link, at[0], at[1])
        point[i] = touch.x
        normal[i] = -touch.out


@dataclass(frozen=True)
class LineMove:
    """One guarded line for some of the worlds, row by row."""

    rows: np.ndarray
    """Worlds that move, (row,)."""
    number: np.ndarray
    """How many lines each of them has made before, (row,): seeds the noise."""
    hand_pose: np.ndarray
    """Where the line starts, as believed, [m] and quaternion xyzw, (row, 7)."""
    direction: np.ndarray
    """Way of the arm in one interval, in units of it, base frame, (row, 3): a unit vector, a
    shorter one for shorter intervals, zero where the arm stays."""
    interval_m: float
    steps: int
    finger: int
    """Whose pads count: 0 to 2, 3 the thumb."""
    commands_rad: np.ndarray
    """Joint commands of all fingers at each interval, (finger 4, step, 4), the last one held; the
    fingers that do not probe stay at their first."""
    until: Until = Until.CONTACT


def guarded_line(
    scene: Scene,
    body: np.ndarray,
    body_pose: np.ndarray,
    arm: ArmTable,
    hand: HandTable,
    sensors: SensorTable,
    pads: PadTable,
    key: np.ndarray,
    mount: np.ndarray,
    arm_q_rad: np.ndarray,
    move: LineMove,
    *,
    march_scale: float = 1.0,
    device: str = "cpu",
) -> tuple[LineTouch, LineTruth, np.ndarray]:
    """Make one guarded line; also returns the arms' joints after it (row, 6).

    `body` (world or 1,), `body_pose` and `mount` (world, 7), `key` (world,) uint64, `arm_q_rad`
    (row, 6) where the arms stand. Worlds not among `move.rows` cost nothing. Raises ShapeError.
    """
    n = len(move.rows)
    commands = np.ascontiguousarray(move.commands_rad, float)
    speed = float(np.linalg.norm(move.direction, axis=1).max(initial=0.0))
    reach = (hand.abduction_offset_m + sum(hand.link_length_m) + hand.link_radius_m
             + pads.thickness_m)
    swing = np.abs(np.diff(commands[move.finger], axis=0)).sum(-1).max(initial=0.0) * reach
    out = {name: wp.zeros(n, dtype=dtype, device=device) for name, dtype in {
        "status": int, "link_out": int, "point": vec3, "normal": vec3, "tip": vec3,
        "believed": transform, "q_read": vec4, "peak_out": int, "made": int, "arm_time": real,
        "arm_end": vec6, "q_true": vec4, "point_true": vec3, "normal_true": vec3,
        "force_true": real, "on_table": int, "pose_true": transform}.items()}
    out["image"] = wp.zeros((n, TAXELS, TAXELS), dtype=wp.uint8, device=device)
    launch(_line_kernel, {"row": n}, {
        **dict.fromkeys(out, "row"), "image": "row 16 16", "body": "world", "body_pose": "world",
        "mount": "world", "key": "world", "rows": "row", "move": "row", "start": "row",
        "direction": "row", "commands": "4 step 4", "arm_q": "row"}, {
        "scene": scene, "body": wp.array(np.broadcast_to(body, len(key)), dtype=int, device=device),
        "body_pose": wp.array(body_pose, dtype=transform, device=device),
        "arm": arm_of(arm, hand.mount_length_m), "hand": hand_of(hand),
        "pad": pad_of(pads, hand), "joint_noise": sensors.joint_noise_rad,
        "mount": wp.array(mount, dtype=transform, device=device),
        "mount_length": hand.mount_length_m, "march_scale": march_scale,
        "key": wp.array(key, dtype=wp.uint64, device=device),
        "rows": wp.array(move.rows, dtype=int, device=device),
        "move": wp.array(move.number, dtype=int, device=device),
        "start": wp.array(move.hand_pose, dtype=transform, device=device),
        "direction": wp.array(move.direction, dtype=vec3, device=device),
        "interval": move.interval_m, "steps": move.steps, "finger": move.finger,
        "commands": wp.array(commands, dtype=real, device=device),
        "step_bound": move.interval_m * speed + swing,
        "until_release": int(move.until == Until.RELEASE),
        "arm_q": wp.array(arm_q_rad, dtype=vec6, device=device), **out}, device=device)
    host = {name: array.numpy().copy() for name, array in out.items()}
    gone = host["made"] * move.interval_m * np.linalg.norm(move.direction, axis=1)
    touch = LineTouch(
        status=host["status"], link=host["link_out"], point_m=host["point"],
        normal=host["normal"], tip_m=host["tip"], hand_pose=host["believed"],
        q_rad=host["q_read"], taxel_peak=host["peak_out"], image=host["image"],
        steps=host["made"], time_s=host["arm_time"] + host["made"] * arm.guarded_step_s,
        path_m=gone)
    truth = LineTruth(move.rows, host["q_true"], host["point_true"], host["normal_true"],
                      host["force_true"], host["on_table"].astype(bool), host["pose_true"])
    return touch, truth, host["arm_end"]
