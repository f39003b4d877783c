"""Where a closing finger stops: the kernel of `closing`.

A finger steps along its commands; at each step it rests where its energy is least; it stops at the
first step whose tendon difference of a flexion joint exceeds the threshold (Allen and Michelman
1990, section IV-C). Few steps are looked at:

- Free: while the distance to everything exceeds how far the links can have moved, the finger
  follows its command exactly (see `finger_path`), and a false stop (friction and noise alone past
  the threshold) is drawn from its exact first-passage law.
- Pressing: from a look the joints' torques at later steps are known to within a ball, from two
  looks better between them (see `finger_between`). A step is left out where its reading, of the
  noise drawn for it, stays below the threshold all over the ball. The next look is where the
  reading would cross it to first order; what that one does not clear is looked at after it.

So the finger stops where it would if every step were looked at, as far as its contacts' energy is
convex. Where it slips off an edge it is not: looks go no farther than `_STRIDE`, and one that does
not agree with the last one makes the next one go half as far, down to single steps.
"""

import warp as wp

from warpgrasp.closing_guard import may_stop, stop_reading
from warpgrasp.counter_random import Purpose, counter_key, counter_uniform
from warpgrasp.finger_between import agree, in_both, joints_ahead, torque_after
from warpgrasp.finger_energy import pick, put, rest_from, worst_of
from warpgrasp.finger_path import PathStep
from warpgrasp.finger_rest import finger_rest
from warpgrasp.link_nearest import LINK_SAMPLES, link_nearest
from warpgrasp.real import HALF, ONE, ZERO, real, transform, vec3, vec4
from warpgrasp.scene import Scene, body_is_convex
from warpgrasp.status import ProbeStatus
from warpgrasp.tendon import TendonSensor
from warpgrasp.utah_mit_hand import Hand, finger_base

wp.set_module_options({"max_unroll": 1})  # few copies of the distance: they are then inlined
_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NO_CONTACT = wp.constant(int(ProbeStatus.NO_CONTACT))
_FALSE_STOP = wp.constant(int(Purpose.FALSE_STOP))
_TENSION_STEP = wp.constant(int(Purpose.TENSION_STEP))
_NAN = wp.constant(real(float("nan")))
_REDRAWS = wp.constant(100000)
_FAR = wp.constant(1000000)  # steps
_ROUNDING = wp.constant(real(1e-12))  # [m]; a link pressed by no more bears 20 nN
_STRIDE = wp.constant(real(0.04))  # [rad] of a joint's command from look to look


@wp.func
def _link_end(at: PathStep, end: int):
    """The first to fourth end of links in the frame of a finger's base."""
    return wp.where(end < 2, wp.where(end == 0, at.p1, at.p2), wp.where(end == 2, at.p3, at.p4))


@wp.func
def _clearance(plane: vec4, at: PathStep, link: int):
    """How far a link's skin stays before a `plane` (normal, offset) of its base's frame [m]."""
    normal = vec3(plane[0], plane[1], plane[2])
    return plane[3] + wp.min(wp.dot(normal, _link_end(at, link)),
                             wp.dot(normal, _link_end(at, link + 1)))


@wp.func
def _free_link(
    scene: Scene, body: int, hand: Hand, base: transform, at: PathStep, link: int, guess: real,
    bend: real, samples: int
):
    """The nearest point of a free link; its distance is its skin's to everything [m].

    Or a lower bound where it is far. `guess`, `bend` and `samples` are those of `link_nearest`.
    """
    a = wp.transform_point(base, _link_end(at, link))
    length = pick(hand.link_length, link)
    u = (wp.transform_point(base, _link_end(at, link + 1)) - a) / length
    near = link_nearest(scene, body, a, u, length, guess, bend, samples,
                        length * HALF + hand.link_radius)
    table = a[2] + wp.min(u[2], ZERO) * length
    near.distance = wp.min(near.distance, table) - hand.link_radius
    return near


@wp.kernel(enable_backward=False)
def closing_kernel(
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
    """A finger's closing: status, step, and what is true there before it is looked at closely."""
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
    reader = counter_key(stream, _TENSION_STEP)
    last = command_count[g] - 1
    k = hand.stiffness

    # Along a link the distance to a convex body has one valley.
    convex = body_is_convex(scene, which)
    samples = wp.where(convex, 0, LINK_SAMPLES)

    # First passage of a false stop: exponential in the summed hazard of the free steps.
    hazard_moving = sensor.hazard_moving
    hazard_still = sensor.hazard_still
    hazard = real(0.0)
    # Where none can come, it does not matter which of the steps left out were free.
    moves = path[g, finger, last].moves
    ahead_hazard = hazard_moving * moves + hazard_still * (real(3 * (last + 1)) - moves)
    draw = counter_uniform(counter_key(stream, _FALSE_STOP))
    patience = real(1e300)
    stride = real(_STRIDE)
    if draw + ahead_hazard >= ONE:  # exp(-x) >= 1 - x
        patience = -wp.log(draw)
        if ahead_hazard >= patience:
            stride = ZERO

    free = vec3(ZERO, ZERO, ZERO)  # how far each link can still move for certain [m]
    along = hand.link_length * HALF  # where and how it was nearest when looked at
    bend = vec3(ONE, ONE, ONE)
    # Planes (normal, offset) of the base's frame behind which all of body and table lie.
    rotation = wp.transform_get_rotation(base)
    up = wp.quat_rotate_inv(rotation, vec3(ZERO, ZERO, ONE))
    table = vec4(up[0], up[1], up[2], base[2] - hand.link_radius)
    plane1 = vec4(ZERO, ZERO, ZERO, -ONE)
    plane2 = vec4(ZERO, ZERO, ZERO, -ONE)
    plane3 = vec4(ZERO, ZERO, ZERO, -ONE)
    known_free = int(0)
    # `low` is what was found at `low_step`, the last step known not to stop the finger; `high` is
    # what was found ahead at `high_step`, if that is not negative.
    low = rest_from(path[g, finger, 0].command)
    low_step = int(-1)
    low_command = low.q
    low_pressed = int(0)
    high = rest_from(low.q)
    high_step = int(-1)
    high_command = low.q
    high_pressed = int(0)
    high_reading = real(0.0)
    torque = vec4(ZERO, ZERO, ZERO, ZERO)
    stopped = int(-1)
    reading = real(0.0)
    s = int(0)
    sure = int(1)  # no step before `s` stops the finger
    reach = int(_FAR)  # looks ahead go so many steps at most, up to step `slips`
    slips = int(-1)
    while s <= last:
        if low_pressed == 0:
            # Free, to the step at which something may be touched.
            touches = int(0)
            while s <= last and touches == 0:
                if known_free == 0:
                    at = path[g, finger, s]
                    for link in range(3):
                        if convex or free[link] <= ZERO:
                            plane = wp.where(link == 0, plane1, wp.where(link == 1, plane2, plane3))
                            clear = wp.min(_clearance(plane, at, link), _clearance(table, at, link))
                            if clear < -_ROUNDING and free[link] <= ZERO:
                                near = _free_link(
                                    scene, which, hand, base, at, link,
                                    wp.where(convex, pick(along, link), -ONE),
                                    wp.where(convex, pick(bend, link), ONE), samples)
                                clear = near.distance
                                free[link] = march_scale * clear
                                along = put(along, link, near.along)
                                bend = put(bend, link, near.bend)
                                if clear < -_ROUNDING:
                                    touches = int(1)
                                if convex:
                                    normal = wp.quat_rotate_inv(rotation, near.normal)
                                    share = near.along / pick(hand.link_length, link)
                                    place = _link_end(at, link) * (ONE - share) + (
                                        _link_end(at, link + 1) * share)
                                    plane = vec4(normal[0], normal[1], normal[2],
                                                 clear - wp.dot(normal, place))
                                    if link == 0:
                                        plane1 = plane
                                    elif link == 1:
                                        plane2 = plane
                                    else:
                                        plane3 = plane
                            free[link] = wp.max(free[link], march_scale * clear)
                known_free = int(0)
                if touches == 0:
                    # The first step at which some link may have used up what is free to it.
                    room = wp.cw_mul(free, path[g, finger, s].steps)
                    next_step = s + 1 + int(wp.min(wp.min(room[0], room[1]),
                                                   wp.min(room[2], real(last - s))))
                    if stride == ZERO:
                        moves = path[g, finger, next_step - 1].moves - (
                            path[g, finger, wp.max(s - 1, 0)].moves)
                        ahead_hazard = hazard_moving * moves + hazard_still * (
                            real(3 * (next_step - s)) - moves)
                        if hazard + ahead_hazard >= patience:
                            stopped = int(s)
                            break
                        hazard += ahead_hazard
                    if next_step <= last:
                        free -= travel[g, finger, next_step] - travel[g, finger, s]
                    s = int(next_step)
            if touches == 0:
                break
            low = rest_from(path[g, finger, s].command)
            low.along = along
            low.bend = bend
            low.depth = -free

        # Look at step `s`.
        command = path[g, finger, s].command
        start = vec4(command)
        if low_pressed == 1:
            start = joints_ahead(low_command, low, command, k)
        look = finger_rest(scene, which, hand, base, command, start, low,
                           wp.where(low_pressed == 1, samples, 0))
        if low_pressed == 1 and s > low_step + 1:
            if not agree(low_command, low, command, look, k):
                # Something slips on the way here.
                high_step = int(-1)
                slips = wp.max(slips, s)
                reach = (s - low_step) // 2
                s = low_step + reach
                sure = int(reach == 1)
                continue
        pressed = int(wp.max(wp.max(look.depth), wp.max(look.table)) > ZERO)
        reading = real(0.0)
        if pressed == 1:
            delta = command - path[g, finger, wp.max(s - 1, 0)].command
            reading = stop_reading(hand, sensor, (command - look.q) * k, delta,
                                   counter_key(reader, s))
        if sure == 0:
            high = look
            high_step = int(s)
            high_command = vec4(command)
            high_pressed = int(pressed)
            high_reading = reading
            sure = int(1)
        else:
            low = look
            low_step = int(s)
            low_command = vec4(command)
            low_pressed = int(pressed)
            torque = (command - look.q) * k
            if wp.abs(reading) > sensor.threshold:
                stopped = int(s)
                break
            if pressed == 0:
                known_free = int(1)
                for link in range(3):
                    free[link] = -march_scale * wp.max(look.depth[link], look.table[link])
                continue

        # Leave out the steps that cannot stop the finger.
        if low_step >= slips:
            reach = int(_FAR)
        s = low_step + 1
        while s <= last:
            command = path[g, finger, s].command
            if s == high_step:
                high_step = int(-1)
                if high_pressed == 0:
                    break
                low = high
                low_step = int(s)
                low_command = vec4(high_command)
                torque = (command - low.q) * k
                reading = high_reading
                if wp.abs(reading) > sensor.threshold:
                    stopped = int(s)
                    break
            else:
                ball = torque_after(low_command, low, command, k)
                if high_step >= 0:
                    ball = in_both(ball, torque_after(high_command, high, command, k))
                elif s - low_step >= reach or worst_of(command - low_command) > stride:
                    break
                delta = command - path[g, finger, s - 1].command
                if may_stop(hand, sensor, ball, delta, counter_key(reader, s)):
                    break
            s += 1
        if stopped >= 0 or low_step == last:
            break
        s = wp.min(s, last)
        if high_step < 0:
            # On to where the reading should stop the finger.
            ahead = int(s)
            while ahead < last and ahead - low_step < reach and (
                    worst_of(command - low_command) <= stride):
                command = path[g, finger, ahead].command
                delta = command - path[g, finger, ahead - 1].command
                guess = (command - joints_ahead(low_command, low, command, k)) * k
                if wp.abs(stop_reading(hand, sensor, guess, delta,
                                       counter_key(reader, ahead))) > sensor.threshold:
                    break
                ahead += 1
            if ahead > s:
                sure = int(0)
            s = int(ahead)

    q_true[w, p, g, finger] = low.q
    if low_pressed == 0:
        torque = vec4(ZERO, ZERO, ZERO, ZERO)
        q_true[w, p, g, finger] = path[g, finger, last].command
        if stopped >= 0:
            # Noise stops the finger on the way: at the first step that uses up the patience.
            delta = vec4(ZERO, ZERO, ZERO, ZERO)
            for n in range(stopped, last + 1):
                before = path[g, finger, wp.max(n - 1, 0)]
                delta = path[g, finger, n].command - before.command
                moves = path[g, finger, n].moves - before.moves
                hazard += hazard_moving * moves + hazard_still * (real(3.0) - moves)
                stopped = int(n)
                if hazard >= patience:
                    break
            q_true[w, p, g, finger] = path[g, finger, stopped].command
            redraw = counter_key(counter_key(stream, _FALSE_STOP), stopped)
            for attempt in range(_REDRAWS):
                reading = stop_reading(hand, sensor, torque, delta, counter_key(redraw, attempt))
                if wp.abs(reading) > sensor.threshold:
                    break
    torque_true[w, p, g, finger] = torque
    if stopped < 0:
        status[w, p, g, finger] = _NO_CONTACT
        step[w, p, g, finger] = last
        return
    step[w, p, g, finger] = stopped
    difference[w, p, g, finger] = reading
    link_true[w, p, g, finger] = low_pressed - 1
