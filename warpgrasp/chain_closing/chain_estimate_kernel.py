# type: ignore  # Warp functions, which type checkers cannot follow
"""Where the robot concludes that a finger of chains touched, with a covariance: the kernel.

As `closing.contact_estimate_kernel`, capsule by capsule: the torques of the drives are explained by
a force at a place of a capsule's palmar half, or of its round end where it ends the finger. Places
that another capsule of the link covers touch nothing. A switch tells no more than that its link
touched: its places are as likely as what they sweep.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    CAPSULES,
    JOINTS,
    Chain,
    ChainPose,
    chain_capsule,
    chain_jacobian,
    chain_pose,
    link_place,
    link_turn,
    vec6,
)
from warpgrasp.chain.torque_sensor_kernel import (
    SWITCHES,
    TORQUES,
    TorqueSensor,
    torque_from_reading,
    torque_variance,
)
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
from warpgrasp.core.dtypes import HALF, ONE, PI, ZERO, mat33, real, struct, transform, vec2, vec3
from warpgrasp.finger.sliding import force_lean
from warpgrasp.mechanism.tendon_kernel import moving_sign
from warpgrasp.probe_status import ProbeStatus

_CONTACT = wp.constant(int(ProbeStatus.CONTACT))
_TORQUES, _SWITCHES = wp.constant(TORQUES), wp.constant(SWITCHES)
_NAN = wp.constant(real(float("nan")))
_ALONG, _AROUND, _CAP, _LEANS = (wp.constant(ALONG), wp.constant(AROUND), wp.constant(CAP),
                                 wp.constant(LEANS))
_AROUND_REAL, _CAP_REAL = wp.constant(real(AROUND)), wp.constant(real(CAP))
_STEP = wp.constant(real(1.0 / ALONG))
_JOINTS, _CAPSULES = wp.constant(JOINTS), wp.constant(CAPSULES)
_TINY = wp.constant(real(1e-300))
_COVERED = wp.constant(real(1e-6))
_NO_ARM = wp.constant(real(1e-9))  # of a force that turns no joint: a nanometre's arm and less
_AT_STOP = wp.constant(real(3.0))  # deviations of a joint's reading
_DEEPEST = wp.constant(real(40.0))  # places that explain so much less than the best are left out
_RELATIVE = wp.constant(real(0.03))  # model error of a torque, of the largest [est]
_FLOOR = wp.constant(real(5e-4))  # model error of a torque [N m] [est]
_along_vec = wp.types.vector(length=ALONG, dtype=real)
balls_type = wp.types.matrix(shape=(2 * CAPSULES, 3), dtype=real)


@struct
class _Posterior:
    """Weighted sums over places; a weight is an area times what it sweeps times
    exp((gain - largest gain) / 2)."""

    most: real
    """The largest gain of all places."""
    placed: real
    """That of the grid's places."""
    weight: real
    best: real
    mean: vec3
    second: mat33
    normal: vec3
    link: int
    link_weight: vec6


@struct
class _Felt:
    """Torques in units of their deviations, and one over these; how the command turned the drives
    and how they yield, in these units; by how much it turned them [rad]; the skin's friction."""

    torque: vec6
    root: vec6
    way: vec6
    ease: vec6
    turned: real
    friction: real
    leans: int
    turn: int
    """0: the largest gain is sought; 1: the places near it are gathered."""


@wp.func
def _gathered(post: _Posterior, x: vec3, u: vec3, outward: vec3, sums: vec3, link: int, best: real):
    """`post` with places x + u t added, whose weights, times 1, t and t^2, sum to `sums`."""
    if best > post.best:
        post.best = best
        post.link = link
    cross = wp.outer(x, u) * sums[1]
    post.weight += sums[0]
    post.mean += x * sums[0] + u * sums[1]
    post.second += (wp.outer(x, x) * sums[0] + cross + wp.transpose(cross)
                    + wp.outer(u, u) * sums[2])
    post.normal -= outward * sums[0]
    post.link_weight[link] += sums[0]
    return post


@wp.func
def _turns(hand: Chain, pose: ChainPose, joint: int, x: vec3, d: vec3, felt: _Felt):
    return wp.cw_mul(chain_jacobian(hand, pose, joint, x, d), felt.root)


@wp.func
def _bare(hand: Chain, pose: ChainPose, number: int, skin: vec3):
    """1 for a place of the skin; next to nothing for one that another capsule of its link covers.
    """
    joint = chain_capsule(hand, number).joint
    for other in range(hand.capsule_count):
        capsule = chain_capsule(hand, other)
        if other != number and capsule.joint == joint:
            a = link_place(pose, joint, capsule.start)
            line = link_place(pose, joint, capsule.end) - a
            share = wp.dot(skin - a, line) / wp.max(wp.dot(line, line), _TINY)
            if wp.length(a + line * wp.clamp(share, ZERO, ONE) - skin) < capsule.radius:
                return _COVERED
    return ONE


@wp.func
def _with_side(
    post: _Posterior, hand: Chain, pose: ChainPose, number: int, a: vec3, u: vec3, length: real,
    out: vec3, felt: _Felt
):
    """`post` with the places along one side of capsule `number`."""
    joint = chain_capsule(hand, number).joint
    radius = chain_capsule(hand, number).radius
    arm = wp.where(felt.leans > 1, radius, ZERO)  # along the surface a force acts on the skin
    x = a + out * arm
    line = u * length
    across = wp.cross(u, out)
    by_out = _turns(hand, pose, joint, x, out, felt)
    rise_out = _turns(hand, pose, joint, x + line, out, felt) - by_out
    by_along = vec6()
    by_across = vec6()
    rise_across = vec6()
    if felt.leans > 1:
        by_along = _turns(hand, pose, joint, x, u, felt)
        by_across = _turns(hand, pose, joint, x, across, felt)
        rise_across = _turns(hand, pose, joint, x + line, across, felt) - by_across
    lean = force_lean(by_out + rise_out * HALF, by_along, by_across + rise_across * HALF, felt.way,
                      felt.ease, felt.friction)
    outwards = wp.dot(by_out, felt.way)
    outwards_rise = wp.dot(rise_out, felt.way)
    swept = _along_vec()
    known = int(0)
    for tried in range(felt.leans):
        leans = lean_tried(lean, tried)
        low = by_out + by_along * leans[0] + by_across * leans[1]
        rise = rise_out + rise_across * leans[1]
        square = vec3(wp.dot(low, low), real(2.0) * wp.dot(low, rise), wp.dot(rise, rise))
        product = vec2(wp.dot(low, felt.torque), wp.dot(rise, felt.torque))
        line_most = most_force_gain(square, product, _NO_ARM)
        if felt.turn == 0:
            post.most = wp.max(post.most, line_most)
            post.placed = wp.max(post.placed, most_placed_gain(square, product, _NO_ARM))
        elif line_most >= post.most - _DEEPEST:
            if known == 0:
                known = 1
                for i in range(_ALONG):
                    share = (real(i) + HALF) * _STEP
                    swept[i] = (swept_share(outwards + outwards_rise * share, felt.turned)
                                * _bare(hand, pose, number, a + line * share + out * radius))
            sums = vec3(ZERO, ZERO, ZERO)
            best = real(-1.0)
            for i in range(_ALONG):
                share = (real(i) + HALF) * _STEP
                g = force_gain_at(square, product, share, _NO_ARM)
                best = wp.max(best, g)
                if g >= post.most - _DEEPEST:
                    sums += vec3(ONE, share, share * share) * (
                        wp.exp((g - post.most) * HALF) * swept[i])
            area = PI * radius / _AROUND_REAL * length * _STEP
            sums = vec3(sums[0], sums[1] * length, sums[2] * length * length) * area
            post = _gathered(post, a + out * radius, u, out, sums, joint, best)
    return post


@wp.func
def _with_cap(
    post: _Posterior, hand: Chain, pose: ChainPose, number: int, end: vec3, u: vec3, out: vec3,
    felt: _Felt
):
    """`post` with the places of the round end of capsule `number` beyond one side."""
    joint = chain_capsule(hand, number).joint
    radius = chain_capsule(hand, number).radius
    arm = wp.where(felt.leans > 1, radius, ZERO)
    for c in range(_CAP):
        tip_out = out * real(CAP_COS[c]) + u * real(CAP_SIN[c])
        up = u * real(CAP_COS[c]) - out * real(CAP_SIN[c])
        cell = (PI * radius / _AROUND_REAL * real(CAP_COS[c])) * (PI * HALF * radius / _CAP_REAL)
        x = end + tip_out * arm
        by_out = _turns(hand, pose, joint, x, tip_out, felt)
        by_up = vec6()
        by_across = vec6()
        if felt.leans > 1:
            by_up = _turns(hand, pose, joint, x, up, felt)
            by_across = _turns(hand, pose, joint, x, wp.cross(u, out), felt)
        lean = force_lean(by_out, by_up, by_across, felt.way, felt.ease, felt.friction)
        for tried in range(felt.leans):
            leans = lean_tried(lean, tried)
            push = by_out + by_up * leans[0] + by_across * leans[1]
            g = force_gain(wp.dot(push, push), wp.dot(push, felt.torque), _NO_ARM)
            if felt.turn == 0:
                post.most = wp.max(post.most, g)
                post.placed = wp.max(post.placed, g)
            elif g >= post.most - _DEEPEST:
                weight = (cell * wp.exp((g - post.most) * HALF)
                          * swept_share(wp.dot(by_out, felt.way), felt.turned)
                          * _bare(hand, pose, number, end + tip_out * radius))
                post = _gathered(post, end + tip_out * radius, u, tip_out,
                                 vec3(weight, ZERO, ZERO), joint, g)
    return post


@wp.func
def _felt(
    hand: Chain, sensor: TorqueSensor, q: vec6, torque: vec6, way: vec6, arm_share: real
):
    """Torques in units of their deviations; a drive that its stop holds goes nowhere."""
    felt = _Felt()
    felt.friction = hand.friction
    felt.leans = wp.where(hand.friction > ZERO, _LEANS, 1)
    largest = real(0.0)
    for d in range(hand.drives):
        largest = wp.max(largest, wp.abs(torque[d]))
    for d in range(hand.drives):
        model = _RELATIVE * largest
        unsure = arm_share * torque[d]
        precision = ONE / (torque_variance(sensor) + model * model + unsure * unsure
                           + _FLOOR * _FLOOR)
        free = ONE
        # A drive at its stop is held by it: what its motor bears says nothing.
        if hand.stop > ZERO and (q[d] < hand.low[d] + _AT_STOP * sensor.joint_noise
                                 or q[d] > hand.high[d] - _AT_STOP * sensor.joint_noise):
            precision = _TINY
            free = ZERO
        felt.root[d] = wp.sqrt(precision)
        felt.torque[d] = torque[d] * felt.root[d]
        felt.way[d] = free * way[d] / felt.root[d]
        felt.ease[d] = free / (hand.stiffness[d] * precision)
    felt.turned = wp.length(way)
    return felt


@wp.kernel(enable_backward=False, module="warpgrasp.chain_closing.chain_closing_kernels")
def chain_estimate_kernel(
    first: int,
    # Robot:
    believed: wp.array2d[Chain],
    sensors: wp.array2d[TorqueSensor],
    intrinsic: int,
    pose_variance: real,
    angle_variance: real,
    arm_share: real,
    # Felt in:
    status: wp.array4d[int],
    hand_pose: wp.array2d[transform],
    q: wp.array4d[vec6],
    read: wp.array4d[vec6],
    way: wp.array4d[vec6],
    # Estimate out:
    point: wp.array4d[vec3],
    covariance: wp.array4d[mat33],
    normal: wp.array4d[vec3],
    link_out: wp.array4d[int],
    link_weight: wp.array4d[vec6],
    torque_out: wp.array4d[vec6],
    torque_sigma: wp.array4d[vec6],
    balls: wp.array4d[balls_type],
):
    """The estimate of a finger; balls are the middles and ends of its capsules' axes."""
    w, p, g, finger = wp.tid()
    w += first
    nan3 = vec3(_NAN, _NAN, _NAN)
    point[w, p, g, finger] = nan3
    normal[w, p, g, finger] = nan3
    covariance[w, p, g, finger] = mat33(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN)
    link_out[w, p, g, finger] = -1
    link_weight[w, p, g, finger] = vec6()
    torque_out[w, p, g, finger] = vec6()
    torque_sigma[w, p, g, finger] = vec6(ONE, ONE, ONE, ONE, ONE, ONE)
    hand = believed[0, finger]
    sensor = sensors[0, finger]
    to_world = hand_pose[w, p]
    angles = vec6()
    for d in range(hand.drives):
        angles[d] = q[w, p, g, finger][d]
    pose = chain_pose(hand, wp.transform_identity(dtype=wp.float64), angles)
    at = balls_type()
    for c in range(_CAPSULES):
        middle = nan3
        end = nan3
        if c < hand.capsule_count:
            capsule = chain_capsule(hand, c)
            end = link_place(pose, capsule.joint, capsule.end)
            middle = (link_place(pose, capsule.joint, capsule.start) + end) * HALF
        at[2 * c] = wp.transform_point(to_world, middle)
        at[2 * c + 1] = wp.transform_point(to_world, end)
    balls[w, p, g, finger] = at
    if status[w, p, g, finger] != _CONTACT:
        return

    switched = sensor.kind == _SWITCHES or intrinsic == 0
    torque = vec6()
    if sensor.kind == _TORQUES:
        for d in range(hand.drives):
            torque[d] = torque_from_reading(sensor, read[w, p, g, finger][d],
                                            moving_sign(way[w, p, g, finger][d]))
    felt = _felt(hand, sensor, angles, torque, way[w, p, g, finger], arm_share)
    torque_out[w, p, g, finger] = torque
    for d in range(_JOINTS):
        torque_sigma[w, p, g, finger][d] = wp.where(
            felt.root[d] > ZERO, ONE / wp.max(felt.root[d], _TINY), ONE)
    if switched:
        felt.torque = vec6()
        felt.leans = 1
    post = _Posterior()
    post.best = -ONE
    longest = real(0.0)
    for turn in range(2):
        felt.turn = turn
        if turn == 1 and post.placed < post.most - HALF * _DEEPEST:
            # A huge force hardly beside a joint, which no place of the grid has, explains far more.
            post.most = post.placed
        for c in range(hand.capsule_count):
            capsule = chain_capsule(hand, c)
            joint = capsule.joint
            if not switched or joint == hand.joint_count - 1:
                a = link_place(pose, joint, capsule.start)
                end = link_place(pose, joint, capsule.end)
                n = wp.quat_rotate(link_turn(pose, joint), capsule.palmar)
                length = wp.length(end - a)
                longest = wp.max(longest, length)
                u = wp.quat_rotate(link_turn(pose, joint), wp.cross(
                    capsule.palmar, vec3(ONE, ZERO, ZERO)))
                if length > ZERO:
                    u = (end - a) / length
                elif wp.length(u) < HALF * HALF:
                    u = wp.quat_rotate(link_turn(pose, joint), wp.cross(
                        capsule.palmar, vec3(ZERO, ONE, ZERO)))
                u = wp.normalize(u)
                side = wp.cross(u, n)
                for k in range(_AROUND):
                    out = n * real(AROUND_COS[k]) + side * real(AROUND_SIN[k])
                    if length > ZERO:
                        post = _with_side(post, hand, pose, c, a, u, length, out, felt)
                    if joint == hand.joint_count - 1:
                        post = _with_cap(post, hand, pose, c, end, u, out, felt)
                        # Thick tips touch with all of their round end.
                        post = _with_cap(post, hand, pose, c, end, u, -out, felt)
    if post.weight <= ZERO:
        return
    mean = post.mean / post.weight
    cov = post.second / post.weight - wp.outer(mean, mean)
    # The grid's own cell, the joint angles read (each turning the tip), and the arm's pose.
    lever = wp.length(mean - pose.at[0])
    cell = longest * _STEP
    floor = cell * cell / real(12.0) + pose_variance + angle_variance * lever * lever
    cov = cov + wp.identity(n=3, dtype=wp.float64) * floor
    rot = wp.quat_to_matrix(wp.transform_get_rotation(to_world))
    point[w, p, g, finger] = wp.transform_point(to_world, mean)
    covariance[w, p, g, finger] = rot * cov * wp.transpose(rot)
    normal[w, p, g, finger] = wp.normalize(wp.transform_vector(to_world, post.normal))
    concluded = post.link
    if hand.drives == 1:  # every place that pushes explains one torque
        for j in range(hand.joint_count):
            if post.link_weight[j] > post.link_weight[concluded]:
                concluded = j
    link_out[w, p, g, finger] = concluded
    link_weight[w, p, g, finger] = post.link_weight / post.weight
