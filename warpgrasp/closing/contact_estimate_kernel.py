# type: ignore  # Warp functions, which type checkers cannot follow
"""Where the robot concludes that a finger touched, with a covariance: the kernel.

A place is as likely as its area, what it sweeps, and how well a force there explains the torques:
of bodies that may stand anywhere, skin that goes outwards twice as fast meets twice as many.
"""

import warp as wp

from warpgrasp.closing.contact_places_kernel import (
    ALONG,
    AROUND,
    AROUND_COS,
    AROUND_SIN,
    CAP,
    CAP_COS,
    CAP_SIN,
    LEANS,
    force_gain,
    force_gain_at,
    lean_tried,
    most_force_gain,
    most_placed_gain,
    swept_share,
)
from warpgrasp.core.dtypes import (
    HALF,
    ONE,
    PI,
    ZERO,
    mat33,
    real,
    struct,
    transform,
    vec2,
    vec3,
    vec4,
)
from warpgrasp.core.reading_kernel import mean_variance
from warpgrasp.finger.sliding import force_lean
from warpgrasp.mechanism.tendon_kernel import TendonSensor, moving_sign, torque_from_tensions
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    FingerPose,
    Hand,
    finger_base,
    finger_jacobian,
    finger_pose,
    fingertip_point,
    weight_moments,
)
from warpgrasp.probe_status import ProbeStatus

# Loops over the grid of places are not unrolled: they would be copied for every place.
_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_NAN = wp.constant(real(float("nan")))
_ALONG, _AROUND, _CAP, _LEANS = (wp.constant(ALONG), wp.constant(AROUND), wp.constant(CAP),
                                 wp.constant(LEANS))
# Warp turns a constant that is cast in one place into a real everywhere: have both kinds.
_AROUND_REAL, _CAP_REAL = wp.constant(real(AROUND)), wp.constant(real(CAP))
_STEP = wp.constant(real(1.0 / ALONG))
LINES = 3 + CAP
"""Lines of places at one turn about the links: one along each, and those of the cap."""
_LINES = wp.constant(LINES)
_lines_vec = wp.types.vector(length=AROUND * LINES, dtype=real)
_TINY = wp.constant(real(1e-300))
_AT_STOP = wp.constant(real(3.0))  # deviations of a joint's reading
_DEEPEST = wp.constant(real(40.0))  # places that explain so much less than the best are left out
_RELATIVE = wp.constant(real(0.03))  # model error of a torque, of the largest [est]
_FLOOR = wp.constant(real(5e-4))  # model error of a torque [N m] [est]


@struct
class _Posterior:
    """Weighted sums over places; a weight is an area times what it sweeps times
    exp((gain - largest gain) / 2)."""

    weight: real
    best: real
    mean: vec3
    second: mat33
    normal: vec3
    link: int
    link_weight: vec3


@wp.func
def _gathered(
    post: _Posterior, x: vec3, u: vec3, outward: vec3, sums: vec3, link: int, gain: real
):
    """`post` with places x + u t added, whose weights, times 1, t and t^2, sum to `sums`.

    The best of these places has this `gain`.
    """
    if gain > post.best:
        post.best = gain
        post.link = link
    mean = x * sums[0] + u * sums[1]
    cross = wp.outer(x, u) * sums[1]
    post.weight += sums[0]
    post.mean += mean
    post.second += (wp.outer(x, x) * sums[0] + cross + wp.transpose(cross)
                    + wp.outer(u, u) * sums[2])
    post.normal -= outward * sums[0]
    post.link_weight[link] += sums[0]
    return post


@struct
class _Ways:
    """Torques of unit forces at the low end of a line of places, and by how much they rise from
    there to its other end: along the outward normal, along the line, and across it."""

    out: vec4
    along: vec4
    across: vec4
    out_rise: vec4
    across_rise: vec4


@wp.func
def _ways(
    f: FingerPose, link: int, x: vec3, line: vec3, out: vec3, along: vec3, across: vec3, root: vec4,
    leans: int
):
    """Of the places from `x` to x + `line`, in units of the torques' deviations. Only those of
    `out` where a force has one direction."""
    ways = _Ways()
    ways.out = wp.cw_mul(finger_jacobian(f, link, x, out), root)
    ways.out_rise = wp.cw_mul(finger_jacobian(f, link, x + line, out), root) - ways.out
    if leans > 1:
        # A force along the line turns the joints alike from all its places.
        ways.along = wp.cw_mul(finger_jacobian(f, link, x, along), root)
        ways.across = wp.cw_mul(finger_jacobian(f, link, x, across), root)
        ways.across_rise = (wp.cw_mul(finger_jacobian(f, link, x + line, across), root)
                            - ways.across)
    return ways


@wp.kernel(enable_backward=False, module="warpgrasp.closing.closing_kernels")
def estimate_kernel(
    first: int,
    # Robot:
    hand: Hand,
    sensor: TendonSensor,
    intrinsic: int,
    pose_variance: real,
    angle_variance: real,
    arm_share: real,
    tip_variance: real,
    # Felt in:
    status: wp.array4d[int],
    hand_pose: wp.array2d[transform],
    q: wp.array4d[vec4],
    flexor: wp.array4d[vec4],
    extensor: wp.array4d[vec4],
    way: wp.array4d[vec4],
    # Estimate out:
    point: wp.array4d[vec3],
    covariance: wp.array4d[mat33],
    normal: wp.array4d[vec3],
    link_out: wp.array4d[int],
    link_weight: wp.array4d[vec3],
    joint_1: wp.array4d[vec3],
    joint_2: wp.array4d[vec3],
    joint_3: wp.array4d[vec3],
    tip: wp.array4d[vec3],
    torque_out: wp.array4d[vec4],
    torque_sigma: wp.array4d[vec4],
):
    """Where a finger that stopped is believed to have touched."""
    w, p, g, finger = wp.tid()
    w += first
    nan3 = vec3(_NAN, _NAN, _NAN)
    point[w, p, g, finger] = nan3
    normal[w, p, g, finger] = nan3
    covariance[w, p, g, finger] = mat33(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN)
    link_out[w, p, g, finger] = -1
    link_weight[w, p, g, finger] = vec3(ZERO, ZERO, ZERO)
    torque_out[w, p, g, finger] = vec4(ZERO, ZERO, ZERO, ZERO)
    torque_sigma[w, p, g, finger] = vec4(ONE, ONE, ONE, ONE)
    pose = hand_pose[w, p]
    angles = q[w, p, g, finger]
    f = finger_pose(hand, finger_base(hand, finger), angles)
    joint_1[w, p, g, finger] = wp.transform_point(pose, f.p1)
    joint_2[w, p, g, finger] = wp.transform_point(pose, f.p2)
    joint_3[w, p, g, finger] = wp.transform_point(pose, f.p3)
    tip[w, p, g, finger] = wp.transform_point(pose, f.p4)
    if status[w, p, g, finger] != _CONTACT:
        return
    unit = wp.identity(n=3, dtype=wp.float64)
    if intrinsic == 0:
        point[w, p, g, finger] = wp.transform_point(pose, fingertip_point(hand, f))
        normal[w, p, g, finger] = wp.transform_vector(pose, -f.n3)
        covariance[w, p, g, finger] = unit * (tip_variance + pose_variance)
        link_out[w, p, g, finger] = 2
        link_weight[w, p, g, finger] = vec3(ZERO, ZERO, ONE)
        return

    torque = vec4(ZERO, ZERO, ZERO, ZERO)
    step = way[w, p, g, finger]
    largest = real(0.0)
    for j in range(4):
        tensions = vec2(flexor[w, p, g, finger][j], extensor[w, p, g, finger][j])
        torque[j] = torque_from_tensions(sensor, j, tensions, moving_sign(step[j]))
    # What the servos bear beside the links' weight.
    torque += weight_moments(hand, finger_pose(
        hand, wp.transform_multiply(pose, finger_base(hand, finger)), angles))
    for j in range(4):
        largest = wp.max(largest, wp.abs(torque[j]))
    precision = vec4(ZERO, ZERO, ZERO, ZERO)
    free = vec4(ONE, ONE, ONE, ONE)
    for j in range(4):
        s = sensor.moment_arm[j]
        v = s * s * real(2.0) * mean_variance(sensor.noise, sensor.step, sensor.readings)
        m = _RELATIVE * largest
        unsure = arm_share * torque[j]  # the moment arm is known no better
        precision[j] = ONE / (v + m * m + unsure * unsure + _FLOOR * _FLOOR)
        # A joint at its stop is held by it: what its tendons bear says nothing.
        if hand.stop > ZERO and (angles[j] < hand.low[j] + _AT_STOP * sensor.joint_noise
                                 or angles[j] > hand.high[j] - _AT_STOP * sensor.joint_noise):
            precision[j] = _TINY
            free[j] = ZERO

    # In units of their deviations, all torques weigh the same.
    root = vec4(wp.sqrt(precision[0]), wp.sqrt(precision[1]), wp.sqrt(precision[2]),
                wp.sqrt(precision[3]))
    felt = wp.cw_mul(torque, root)
    commanded = wp.cw_div(wp.cw_mul(step, free), root)
    ease = wp.cw_div(free, wp.cw_mul(root, root))
    turned = wp.length(step)
    torque_out[w, p, g, finger] = torque
    torque_sigma[w, p, g, finger] = vec4(ONE / root[0], ONE / root[1], ONE / root[2], ONE / root[3])
    r = hand.link_radius
    post = _Posterior()
    # First the largest likelihood of all places, then the places that come close to it.
    most = real(0.0)
    placed = real(0.0)
    line_most = _lines_vec()
    leans = wp.where(hand.friction > ZERO, _LEANS, 1)
    arm = wp.where(hand.friction > ZERO, r, ZERO)
    for turn in range(2):
        if turn == 1 and placed < most - HALF * _DEEPEST:
            # A huge force hardly beside a joint, which no place of the grid has, explains far more.
            most = placed
        for k in range(_AROUND):
            side = f.side * real(AROUND_SIN[k])
            for link in range(3):
                a = f.p1
                u = f.u1
                n = f.n1
                if link == 1:
                    a = f.p2
                    u = f.u2
                    n = f.n2
                if link == 2:
                    a = f.p3
                    u = f.u3
                    n = f.n3
                length = hand.link_length[link]
                out = n * real(AROUND_COS[k]) + side
                line = k * _LINES + link
                if turn == 0 or line_most[line] >= most - _DEEPEST:
                    # Along the surface a force acts on the skin, a radius from the axis.
                    ways = _ways(f, link, a + out * arm, u * length, out, u, wp.cross(u, out),
                                 root, leans)
                    lean = force_lean(
                        ways.out + ways.out_rise * HALF, ways.along,
                        ways.across + ways.across_rise * HALF, commanded, ease, hand.friction)
                    outwards = wp.dot(ways.out, commanded)
                    outwards_rise = wp.dot(ways.out_rise, commanded)
                    for number in range(leans):
                        tried = lean_tried(lean, number)
                        low = ways.out + ways.along * tried[0] + ways.across * tried[1]
                        rise = ways.out_rise + ways.across_rise * tried[1]
                        square = vec3(wp.dot(low, low), real(2.0) * wp.dot(low, rise),
                                      wp.dot(rise, rise))
                        product = vec2(wp.dot(low, felt), wp.dot(rise, felt))
                        lean_most = most_force_gain(square, product, _TINY)
                        if turn == 0:
                            line_most[line] = wp.max(line_most[line], lean_most)
                            most = wp.max(most, lean_most)
                            placed = wp.max(placed, most_placed_gain(square, product, _TINY))
                        elif lean_most >= most - _DEEPEST:
                            sums = vec3(ZERO, ZERO, ZERO)
                            best = real(-1.0)
                            for i in range(_ALONG):
                                share = (real(i) + HALF) * _STEP
                                gain = force_gain_at(square, product, share, _TINY)
                                best = wp.max(best, gain)
                                if gain >= most - _DEEPEST:
                                    weight = wp.exp((gain - most) * HALF) * swept_share(
                                        outwards + outwards_rise * share, turned)
                                    sums += vec3(ONE, share, share * share) * weight
                            area = PI * r / _AROUND_REAL * length * _STEP
                            sums = vec3(sums[0], sums[1] * length, sums[2] * length * length) * area
                            post = _gathered(post, a + out * r, u, out, sums, link, best)
                if link == 2:
                    for c in range(_CAP):
                        line = k * _LINES + 3 + c
                        if turn == 1 and line_most[line] < most - _DEEPEST:
                            continue
                        tip_out = out * real(CAP_COS[c]) + u * real(CAP_SIN[c])
                        up = u * real(CAP_COS[c]) - out * real(CAP_SIN[c])
                        cell = (PI * r / _AROUND_REAL * real(CAP_COS[c])) * (
                            PI * HALF * r / _CAP_REAL)
                        ways = _ways(f, 2, f.p4 + tip_out * arm, vec3(ZERO, ZERO, ZERO), tip_out,
                                     up, wp.cross(u, out), root, leans)
                        lean = force_lean(ways.out, ways.along, ways.across, commanded, ease,
                                          hand.friction)
                        cell_swept = cell * swept_share(wp.dot(ways.out, commanded), turned)
                        for number in range(leans):
                            tried = lean_tried(lean, number)
                            push = ways.out + ways.along * tried[0] + ways.across * tried[1]
                            gain = force_gain(wp.dot(push, push), wp.dot(push, felt), _TINY)
                            if turn == 0:
                                line_most[line] = wp.max(line_most[line], gain)
                                most = wp.max(most, gain)
                                placed = wp.max(placed, gain)
                            elif gain >= most - _DEEPEST:
                                weight = cell_swept * wp.exp((gain - most) * HALF)
                                post = _gathered(post, f.p4 + tip_out * r, u, tip_out,
                                                 vec3(weight, ZERO, ZERO), 2, gain)
    if post.weight <= ZERO:
        return
    at = post.mean / post.weight
    cov = post.second / post.weight - wp.outer(at, at)
    # The grid's own cell, the joint angles read (each turning the tip), and the arm's pose.
    lever = wp.length(at - f.p1)
    floor = (_length_cell(hand) * _length_cell(hand) / real(12.0) + pose_variance
             + angle_variance * lever * lever)
    cov = cov + unit * floor
    rot = wp.quat_to_matrix(wp.transform_get_rotation(pose))
    point[w, p, g, finger] = wp.transform_point(pose, at)
    covariance[w, p, g, finger] = rot * cov * wp.transpose(rot)
    normal[w, p, g, finger] = wp.normalize(wp.transform_vector(pose, post.normal))
    link_out[w, p, g, finger] = post.link
    link_weight[w, p, g, finger] = post.link_weight / post.weight


@wp.func
def _length_cell(hand: Hand):
    """Widest cell of the posterior's grid along a link [m]."""
    return wp.max(hand.link_length[0], wp.max(hand.link_length[1], hand.link_length[2])) / real(
        _ALONG)
