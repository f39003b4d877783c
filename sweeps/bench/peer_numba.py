# type: ignore  # other engines, which are not installed where types are checked
"""The peers' closing written for numba: one finger and one upright cylinder on a table.

The same energy, the same descent, the same stop; distances in closed form, the nearest point of a
link by golden section.
"""

from collections.abc import Callable

import numba
import numpy as np
from numba import njit, prange

from sweeps.bench.peer_closing import (
    COMMANDS_RAD,
    COUNT,
    HAND,
    HAND_POSE,
    HEIGHT_M,
    RADIUS_M,
    THRESHOLD_N,
)

_LENGTH = np.array(HAND.link_length_m)
_R, _K, _SKIN = HAND.link_radius_m, HAND.joint_stiffness_Nm_rad, HAND.skin_stiffness_N_m
_ARM = np.array(HAND.moment_arm_m)
_RUB, _REST_N = HAND.tendon_friction, HAND.co_contraction_N
_LOW_N = HAND.tension_low_N
_OFFSET = HAND.abduction_offset_m
_GOLDEN = 0.6180339887498949


@njit
def _distance(x, y, z):
    rho = np.sqrt(x * x + y * y)
    a, b = rho - RADIUS_M, abs(z - HEIGHT_M / 2) - HEIGHT_M / 2
    if a <= 0 and b <= 0:
        return max(a, b)
    return np.hypot(max(a, 0.0), max(b, 0.0))


@njit
def _nearest(a, u, length):
    """Place along a link nearest to the cylinder (convex: one valley) and the distance there."""
    low, high = 0.0, length
    while high - low > 1e-7:
        s, t = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_s = _distance(a[0] + u[0] * s, a[1] + u[1] * s, a[2] + u[2] * s)
        at_t = _distance(a[0] + u[0] * t, a[1] + u[1] * t, a[2] + u[2] * t)
        if at_s <= at_t:
            high = t
        else:
            low = s
    t = 0.5 * (low + high)
    return t, _distance(a[0] + u[0] * t, a[1] + u[1] * t, a[2] + u[2] * t)


@njit
def _energy(q, command, origin, side, palm, g, h, free):
    """Energy; fills gradient, Hessian and each link's clearance."""
    x, y, z = palm, side, np.array([0.0, 0.0, -1.0])
    c0, s0 = np.cos(q[0]), np.sin(q[0])
    axis, along = y * c0 - z * s0, z * c0 + y * s0
    e = 0.0
    h[:] = 0.0
    for k in range(4):
        e += 0.5 * _K * (command[k] - q[k]) ** 2
        g[k] = -_K * (command[k] - q[k])
        h[k, k] = _K
    joints = np.empty((3, 3))
    p = origin + along * _OFFSET
    angle = 0.0
    j = np.zeros(4)
    for link in range(3):
        angle += q[link + 1]
        u = x * np.sin(angle) + along * np.cos(angle)
        joints[link] = p
        middle = p + u * (_LENGTH[link] / 2)
        free[link] = _distance(middle[0], middle[1], middle[2]) - _LENGTH[link] / 2 - _R
        if free[link] <= 0.004:
            t, d = _nearest(p, u, _LENGTH[link])
            free[link] = d - _R
            if d < _R:
                at = p + u * t
                n = np.empty(3)
                for k in range(3):
                    step = np.zeros(3)
                    step[k] = 1e-7
                    n[k] = (_distance(at[0] + step[0], at[1] + step[1], at[2] + step[2])
                            - _distance(at[0] - step[0], at[1] - step[1], at[2] - step[2])) / 2e-7
                depth = _R - d
                j[:] = 0.0
                j[0] = np.dot(np.cross(-x, at - origin), n)
                for k in range(link + 1):
                    j[k + 1] = np.dot(np.cross(axis, at - joints[k]), n)
                e += 0.5 * _SKIN * depth * depth
                for a in range(4):
                    g[a] -= _SKIN * depth * j[a]
                    for b in range(4):
                        h[a, b] += _SKIN * j[a] * j[b]
        p = p + u * _LENGTH[link]
        free[link] = min(free[link], p[2] - _R)
    return e


@njit
def _close(origin, side, palm, commands, travel, skip):
    g, h, free = np.empty(4), np.empty((4, 4)), np.empty(3)
    g2, h2, free2 = np.empty(4), np.empty((4, 4)), np.empty(3)
    q = commands[0].copy()
    s = 0
    while s < len(commands):
        command = commands[s]
        delta = command - commands[max(s - 1, 0)]
        q = q + delta
        e = _energy(q, command, origin, side, palm, g, h, free)
        if free.min() > 0.0:
            q = command.copy()
            s += 1
            while skip and s < len(commands) and (
                    travel[s] - travel[s - 1] < free.min()) and (
                    travel[s] - travel[s - 1] > 0.0) and free.min() > travel[s] - travel[s - 1]:
                free -= travel[s] - travel[s - 1]
                q = commands[s].copy()
                s += 1
            continue
        for _ in range(30):
            if np.abs(g).max() < 1e-6:
                break
            step = -np.linalg.solve(h, g)
            scale, better = 1.0, False
            for _ in range(12):
                e2 = _energy(q + scale * step, command, origin, side, palm, g2, h2, free2)
                if e2 < e:
                    q = q + scale * step
                    e = e2
                    g[:], h[:], free[:] = g2, h2, free2
                    better = True
                    break
                scale *= 0.5
            if not better:
                break
        for k in range(1, 4):
            pull = _K * (command[k] - q[k]) / _ARM[k]
            slack = max(_REST_N - abs(pull) / 2, _LOW_N)
            moving = np.sign(delta[k]) if abs(delta[k]) > 1e-12 else 0.0
            flexor = (slack + max(pull, 0.0)) * (1 + _RUB * moving)
            extensor = (slack - min(pull, 0.0)) * (1 - _RUB * moving)
            if abs(flexor - extensor) > THRESHOLD_N:
                return s
        s += 1
    return len(commands) - 1


@njit(parallel=True)
def _close_all(origins, sides, palms, commands, travel, skip, stops):
    for i in prange(len(stops)):
        f = i % 4
        stops[i] = _close(origins[f], sides[f], palms[f], commands[f], travel, skip)


def numba_closings(batch: int, *, skip: bool) -> tuple[Callable[[], int], Callable[[], np.ndarray]]:
    """`batch` hands: a call that closes them, and the steps of one's stops, (4,)."""
    import os

    numba.set_num_threads(min(int(os.environ.get("WARPGRASP_THREADS", "1")),
                              numba.config.NUMBA_NUM_THREADS))
    # The hand points down (half a turn about x): its y axis is the world's -y.
    place = np.array([[-HAND.palm_gap_m / 2, -HAND.finger_spacing_m * (f - 1), HAND_POSE[2]]
                      for f in range(3)] + [[HAND.palm_gap_m / 2, 0.0, HAND_POSE[2]]])
    side = np.array([[0.0, -1.0, 0.0]] * 3 + [[0.0, 1.0, 0.0]])
    palm = np.array([[1.0, 0.0, 0.0]] * 3 + [[-1.0, 0.0, 0.0]])
    commands = np.ascontiguousarray(COMMANDS_RAD[0])
    reach = sum(HAND.link_length_m)
    travel = np.concatenate([[0.0], np.abs(np.diff(commands[0, :, 1])).cumsum() * reach])
    stops = np.empty(4 * batch, np.int64)

    def call() -> int:
        _close_all(place, side, palm, commands, travel, skip, stops)
        return 4 * batch

    def one() -> np.ndarray:
        call()
        assert stops.max() < COUNT
        return stops[:4].copy()

    return call, one
