# type: ignore  # Warp functions, which type checkers cannot follow
"""The kernel of a guarded line: intervals until a pad feels, the finger is blocked, or the distance
is spent.

Free intervals are skipped by the distance bound. A touch by noise alone is drawn from its
first-passage distribution over the free intervals, for all pads that are on. A false yield (joint
noise beyond `yield_rad`, five standard deviations by default) is not drawn.
"""

from typing import Any

import warp as wp

from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.core.dtypes import ONE, ZERO, quat, real, transform, vec2, vec3, vec4, vec7
from warpgrasp.core.random import Purpose
from warpgrasp.core.random_kernel import counter_key, counter_normal, counter_uniform
from warpgrasp.finger.chain_energy import largest_magnitude
from warpgrasp.geometry.scene import Scene, body_table_distance_grad
from warpgrasp.mechanism.arm_kernel import Arm, arm_flange, arm_joints, arm_time
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.touch.line_finger import (
    command_at,
    finger_free,
    finger_root,
    hanging,
    joints_read,
    posed,
    six_of,
    tip_centre,
    unexplained,
)
from warpgrasp.touch.line_pose import (
    along_line,
    hand_at,
    hand_slip,
    others_free,
    way_is_free,
)
from warpgrasp.touch.line_record import LineBegin, LineEnd
from warpgrasp.touch.pad_equilibrium import pad_equilibrium
from warpgrasp.touch.pad_kernel import Pad, pad_link, pad_place, pad_reading_key
from warpgrasp.touch.pad_readout import (
    felt_above,
    image_centroid,
    image_depth,
    pad_feels,
    pad_load,
    read_image,
)

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
_ENDLESS = wp.constant(real(1e9))  # more free intervals than any line has


@wp.func
def _pads_on(pad: Pad):
    return pad.on[0] + pad.on[1] + pad.on[2]


@wp.func
def _link_with_pad(pad: Pad, number: int):
    """The link of pad `number` of those that are on."""
    link = int(0)
    left = int(number)
    while link < 2 and left >= pad.on[link]:
        left -= pad.on[link]
        link += 1
    return link


@wp.func
def _below(draw: wp.uint64, count: int):
    """A whole number from 0 to `count` - 1."""
    return wp.min(int(counter_uniform(draw) * real(count)), count - 1)


@wp.func
def _not_moved(pose: transform, arm_q: vec7):
    """The end of a line that is not begun: the hand is at `pose`, the arm at `arm_q`."""
    nan3 = vec3(_NAN, _NAN, _NAN)
    end = LineEnd()
    end.link = -1
    end.point = nan3
    end.normal = nan3
    end.point_true = nan3
    end.normal_true = nan3
    end.believed = pose
    end.arm_q = arm_q
    end.q_read = vec6(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN)
    end.tip = nan3
    return end


@wp.func(inline=False)
def line_row(
    i: int, scene: Scene, arm: Arm, hand: Any, pad: Pad, turns: wp.array[vec2],
    true_arms: wp.array[Arm], true_hands: Any, true_pads: wp.array2d[Pad],
    mount: wp.array[transform], palm: Any, joint_noise: real, march_scale: real,
    begins: wp.array[LineBegin], finger: int, commands: Any, swing: real, checked: int,
    near_bits: wp.array3d[int], image: wp.array3d[wp.uint8], ends: wp.array[LineEnd],
):
    """One row of `guarded_motion.guarded_line`, which says what goes in and what comes out; `palm`
    is what `others_free` takes."""
    begin = begins[i]
    which = begin.body
    key = begin.key
    number = begin.number
    line = begin.start
    way = begin.direction
    interval = begin.interval
    steps = begin.steps
    until_release = begin.until_release
    end = _not_moved(begin.start, begin.arm_q)
    hand_on_flange = transform(vec3(ZERO, ZERO, arm.mount), quat(ZERO, ZERO, ZERO, ONE))
    flange_on_hand = wp.transform_inverse(hand_on_flange)

    # How far along the line the arm can go.
    arm_start = arm_joints(arm, wp.transform_multiply(line, flange_on_hand), begin.arm_q)
    reachable = int(steps)
    if not wp.isfinite(arm_start[0]):
        end.status = _UNREACHABLE
        ends[i] = end
        return
    arm_last = arm_joints(arm, wp.transform_multiply(
        along_line(line, way, interval * real(steps)), flange_on_hand), arm_start)
    if not wp.isfinite(arm_last[0]):
        low = int(0)
        high = int(steps)
        while high - low > 1:
            middle = (low + high) // 2
            arm_try = arm_joints(arm, wp.transform_multiply(
                along_line(line, way, interval * real(middle)), flange_on_hand), arm_start)
            if wp.isfinite(arm_try[0]):
                low = middle
            else:
                high = middle
        reachable = low
        arm_last = arm_joints(arm, wp.transform_multiply(
            along_line(line, way, interval * real(reachable)), flange_on_hand), arm_start)

    # The robot that is: it moves and feels; `arm`, `hand` and `pad` are believed.
    own = begin.world % true_hands.shape[0]
    real_hand = true_hands[own, finger]
    real_pad = true_pads[own, finger]
    slip = hand_slip(true_arms[own], arm_start, line, hand_on_flange, mount[own])
    slip_last = hand_slip(true_arms[own], arm_last,
                      along_line(line, way, interval * real(reachable)), hand_on_flange, mount[own])
    per_step = ONE / wp.max(real(reachable), ONE)
    if checked == 1:
        before = wp.transform_multiply(arm_flange(arm, begin.arm_q), hand_on_flange)
        if not way_is_free(scene, which, true_hands, own, wp.transform_inverse(begin.body_pose),
                           wp.transform_multiply(before, slip), wp.transform_multiply(line, slip),
                           palm, commands):
            end.status = _COLLISION
            end.believed = before
            ends[i] = end
            return
    noise = counter_key(counter_key(key, _ARM), number)
    wobble = vec3(counter_normal(counter_key(noise, 0)), counter_normal(counter_key(noise, 1)),
                  counter_normal(counter_key(noise, 2))) * arm.repeatability
    to_body = wp.transform_inverse(begin.body_pose)
    # Readings of free pads without a false touch are counted, since a sum of their hazards would
    # depend on where skips end.
    false = counter_key(counter_key(key, _FALSE), number)
    hazard = -wp.log(wp.max(ONE - pad.false_touch, real(1e-300))) * real(_pads_on(pad))
    patience = -wp.log(counter_uniform(false))
    spared = int(_ENDLESS)
    if patience < hazard * _ENDLESS:
        spared = int(patience / hazard)

    status = _NO_CONTACT
    if reachable < steps:
        status = _UNREACHABLE
    s = int(0)
    q = command_at(commands, finger, 0)
    here = line
    reader = counter_key(counter_key(key, _JOINT), number)
    read = q
    felt_link = int(-1)
    peak = int(0)
    noise_alone = int(0)
    most = vec4(ZERO, ZERO, ZERO, ZERO)
    moved = int(0)
    row_bits = near_bits[i]
    # Palm and other fingers move with the arm alone: a clearance lasts until it may be used up.
    others = real(0.0)
    arm_move = interval * wp.length(way)
    step_bound = wp.max(arm_move + swing, real(1e-9))
    while True:
        command = command_at(commands, finger, s) - real_hand.offset
        here = hand_at(line, way, interval * real(s), slip, slip_last, per_step * real(s), wobble)
        pose = wp.transform_multiply(to_body, here)
        base = wp.transform_multiply(pose, finger_root(real_hand, finger))
        hangs = hanging(real_hand, base, command)
        if moved == 0:
            q = hangs
        if others <= ZERO:
            others = others_free(scene, which, true_hands, own, pose, palm, commands, finger)
        free = wp.min(finger_free(scene, which, real_hand, real_pad, base, hangs), others)
        felt_link = int(-1)
        felt = int(0)
        most = vec4(ZERO, ZERO, ZERO, ZERO)
        if free <= ZERO:
            rest = pad_equilibrium(scene, which, real_hand, real_pad, turns, base, command, q,
                                   row_bits)
            q = rest.skin.q
            moved = int(1)
            f = posed(real_hand, base, q)
            # All pads are read.
            for link in range(3):
                if pad.on[link] != 0:
                    at_link = pad_link(real_hand, real_pad, f, link)
                    load = pad_load(scene, which, real_pad, at_link, turns, row_bits)
                    if load[3] > most[3]:
                        most = load
                    if felt == 0 and pad_feels(
                            scene, which, real_pad, at_link, turns, finger, key,
                            pad_reading_key(key, number, s, finger, link), row_bits):
                        felt = int(1)
        else:
            q = hangs
            moved = int(0)
        lag = real(0.0)
        if free <= ZERO:
            read = joints_read(real_hand, q + real_hand.offset, joint_noise, counter_key(reader, s))
            lag = largest_magnitude(unexplained(
                hand, wp.transform_multiply(along_line(line, way, interval * real(s)),
                                            finger_root(hand, finger)),
                command_at(commands, finger, s), read - real_hand.offset - command))
        if until_release == 0 and s == 0 and free <= ZERO and (
                lag > pad.yield_angle or others <= ZERO):
            status = _COLLISION
            break
        if until_release == 0 and felt == 1:
            status = _CONTACT
            break
        if until_release == 1 and felt == 0:
            status = _NO_CONTACT
            break
        if until_release == 1 and s >= reachable:
            status = _CONTACT
            break
        if until_release == 0 and free <= ZERO and (
                lag > pad.yield_angle or others <= ZERO):
            status = _BLOCKED
            break
        if s >= reachable:
            break
        ahead = int(1)
        if until_release == 0 and free > ZERO:
            ahead = wp.clamp(int(wp.floor(free * march_scale / step_bound)), 1, reachable - s)
            if spared < ahead:
                # Noise alone reaches the threshold: some taxel, its count the threshold's.
                status = _CONTACT
                s += spared
                here = hand_at(line, way, interval * real(s), slip, slip_last,
                                per_step * real(s), wobble)
                q = hanging(real_hand, wp.transform_multiply(
                    wp.transform_multiply(to_body, here), finger_root(real_hand, finger)),
                                command_at(commands, finger, s) - real_hand.offset)
                felt_link = _link_with_pad(pad, _below(counter_key(false, 2), _pads_on(pad)))
                noise_alone = int(1)
                peak = int(wp.ceil(pad.threshold))
                where = _below(counter_key(false, 1), _SIDE * _SIDE)
                image[i, where // _SIDE, where % _SIDE] = wp.uint8(peak)
                break
            spared -= ahead
        s += ahead
        others -= arm_move / march_scale * real(ahead)
    if moved == 0:
        read = joints_read(real_hand, q + real_hand.offset, joint_noise, counter_key(reader, s))

    stopped = moved == 1 and noise_alone == 0
    if status != _CONTACT and status != _BLOCKED:
        stopped = False
    if stopped:
        # The finger's image is that of the pad that reads most.
        base = wp.transform_multiply(wp.transform_multiply(to_body, here),
                                     finger_root(real_hand, finger))
        f = posed(real_hand, base, q)
        read_last = int(-1)
        for link in range(3):
            if real_pad.on[link] != 0:
                most_read = read_image(scene, which, real_pad,
                                       pad_link(real_hand, real_pad, f, link), turns, finger, key,
                                       pad_reading_key(key, number, s, finger, link), row_bits,
                                       image, i)
                read_last = link
                if most_read > peak:
                    peak = most_read
                    felt_link = link
        if felt_link >= 0 and felt_link != read_last:
            peak = read_image(scene, which, real_pad,
                              pad_link(real_hand, real_pad, f, felt_link), turns, finger, key,
                              pad_reading_key(key, number, s, finger, felt_link), row_bits, image,
                              i)
    end.status = status
    end.made = s
    end.peak = peak
    end.q_true = six_of(q)
    end.q_read = six_of(read)
    end.pose_true = here
    arm_stop = arm_last
    if s < steps:
        arm_stop = arm_joints(arm, wp.transform_multiply(
            along_line(line, way, interval * real(s)), flange_on_hand), arm_start)
    end.arm_time = arm_time(arm, begin.arm_q, arm_start)
    end.line_time = arm_time(arm, arm_start, arm_stop)
    before = wp.transform_multiply(arm_flange(arm, begin.arm_q), hand_on_flange)
    end.arm_path = wp.length(
        wp.transform_get_translation(line) - wp.transform_get_translation(before))
    end.arm_q = arm_stop
    if arm.encoder_step > ZERO:
        for j in range(7):
            arm_stop[j] = arm.encoder_step * wp.round(arm_stop[j] / arm.encoder_step)
    pose_read = wp.transform_multiply(arm_flange(arm, arm_stop), hand_on_flange)
    end.believed = pose_read
    end.tip = tip_centre(hand, pad, pose_read, finger, read)
    if most[3] > ZERO:
        centre = vec3(most[0], most[1], most[2])
        g = body_table_distance_grad(scene, which, centre)
        n = vec3(g[0], g[1], g[2])
        end.force_true = most[3]
        end.point_true = wp.transform_point(begin.body_pose, centre - n * g[3])
        end.normal_true = wp.transform_vector(begin.body_pose, wp.normalize(n))
        if wp.abs(g[3] - centre[2]) < real(1e-12) and n[2] > real(0.999):
            end.on_table = 1
    if status == _CONTACT and felt_link >= 0:
        end.link = felt_link
        at = image_centroid(image, i, peak, felt_above(pad))
        touch = pad_place(pad, pad_link(hand, pad, posed(hand, wp.transform_multiply(
            pose_read, finger_root(hand, finger)), read), felt_link), at[0], at[1])
        end.point = touch.x - touch.out * image_depth(pad, image, i, at, peak)
        end.normal = -touch.out
    ends[i] = end


@wp.kernel(enable_backward=False)
def line_kernel(
    first: int,
    # Scene:
    scene: Scene,
    # Robot:
    arm: Arm,
    hand: Hand,
    pad: Pad,
    turns: wp.array[vec2],
    true_arms: wp.array[Arm],
    true_hands: wp.array2d[Hand],
    true_pads: wp.array2d[Pad],
    mount: wp.array[transform],
    joint_noise: real,
    march_scale: real,
    # Move in:
    begins: wp.array[LineBegin],
    finger: int,
    commands: wp.array3d[real],
    swing: real,
    checked: int,
    # Scratch, for the taxels in sight:
    near_bits: wp.array3d[int],
    # Touch out:
    image: wp.array3d[wp.uint8],
    ends: wp.array[LineEnd],
):
    """A row of the Utah-MIT hand's."""
    line_row(wp.tid() + first, scene, arm, hand, pad, turns, true_arms, true_hands, true_pads,
             mount, arm.mount, joint_noise, march_scale, begins, finger, commands, swing, checked,
             near_bits, image, ends)
