# type: ignore  # Warp functions, which type checkers cannot follow
"""The equilibrium of a finger with pads: `finger_energy` plus the springs of the taxels.

    E(q) = E_servo,skin(q) + sum over taxels 1/2 k max(0, -phi(x_taxel(q)))^2

up to the pad's thickness, beyond which a taxel is pressed flat (`pad_kernel.taxel_spring`).

Pads stand above the skin: they yield first, then the skin behind them.
"""

from typing import Any

import warp as wp

from warpgrasp.chain.chain_kernel import JOINTS, Chain, mat66, vec6
from warpgrasp.core.dtypes import HALF, ONE, TWO, ZERO, mat44, real, struct, vec2, vec3, vec4
from warpgrasp.finger.chain_energy import ChainRest, finger_energy, free_chain, largest_magnitude
from warpgrasp.finger.energy import Equilibrium, free_equilibrium
from warpgrasp.geometry.scene import Scene, body_table_distance, body_table_distance_grad
from warpgrasp.geometry.segment_distance import LINK_SAMPLES
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
from warpgrasp.touch.line_finger import pad_moves, posed
from warpgrasp.touch.pad_culling import (
    CULLING_MARGIN,
    culling_holds,
    pad_is_near,
    rows_near,
    taxel_place,
    taxel_row,
)
from warpgrasp.touch.pad_kernel import Pad, pad_link, taxel_spring

_SIX = wp.constant(JOINTS)
_ITERATIONS = wp.constant(30)
_SHORTENED = wp.constant(12)
_GRADIENT = wp.constant(real(1e-6))  # [N m]: some 1e-5 N at the tip, a taxel feels 1e-2 N
_LAST_GRADIENT = wp.constant(real(1e-4))  # [N m]: a step from there leaves less than _GRADIENT
_STEEPEST = wp.constant(real(0.75))  # (n - 1) / n of n = 4
_LEFT = wp.constant(real(1e-3))  # share of a spring's depth, least
_LONGEST = wp.constant(real(3.0))  # steps of Newton's
_LEAST_BACK = wp.constant(real(0.2))  # of a step that led uphill
_MOST_BACK = wp.constant(real(0.85))


@struct
class PadEquilibrium:
    """Joints, energy and gradient with the pads, curvature, load of a finger at equilibrium."""

    skin: Equilibrium
    hessian: mat44
    pad_force: real
    """Sum over all taxels [N]."""


@struct
class ChainPadEquilibrium:
    """The same of a finger that is a chain."""

    skin: ChainRest
    hessian: mat66
    pad_force: real


@wp.func
def inverse_of(m: mat44):
    """The inverse of a symmetric positive definite matrix."""
    return wp.inverse(m)


@wp.func
def inverse_of(m: mat66):  # noqa: F811 (an overload)
    """The same by elimination, without pivots."""
    left = mat66(m)
    found = mat66()
    for k in range(_SIX):
        found[k, k] = ONE
    for k in range(_SIX):
        share = ONE / left[k, k]
        for c in range(_SIX):
            left[k, c] = left[k, c] * share
            found[k, c] = found[k, c] * share
        for r in range(_SIX):
            if r != k:
                by = left[r, k]
                for c in range(_SIX):
                    left[r, c] = left[r, c] - by * left[k, c]
                    found[r, c] = found[r, c] - by * found[k, c]
    return found


@wp.func
def on_skin(skin: Equilibrium):
    """A finger whose pads are not pressed."""
    rest = PadEquilibrium()
    rest.skin = skin
    rest.hessian = wp.inverse(rest.skin.compliance)
    return rest


@wp.func
def on_skin(skin: ChainRest):  # noqa: F811
    """The same of a chain."""
    rest = ChainPadEquilibrium()
    rest.skin = skin
    rest.hessian = inverse_of(rest.skin.compliance)
    return rest


@wp.func
def in_the_air(q: vec4):
    """A finger without contact, to start from; its Hessian is not known."""
    rest = PadEquilibrium()
    rest.skin = free_equilibrium(q)
    return rest


@wp.func
def in_the_air(q: vec6):  # noqa: F811
    """The same of a chain."""
    rest = ChainPadEquilibrium()
    rest.skin = free_chain(q)
    return rest


@wp.func
def servo_curve(hand: Hand, way: vec4):
    """The curvature of the servos' energy along `way`."""
    return hand.stiffness * wp.dot(way, way)


@wp.func
def servo_curve(hand: Chain, way: vec6):  # noqa: F811
    """The same of a chain."""
    return wp.dot(wp.cw_mul(hand.stiffness, way), way)


@wp.func(inline=False)
def pad_energy(
    scene: Scene, body: int, hand: Any, pad: Pad, turns: wp.array[vec2], base: wp.transformd,
    command: Any, q: Any, last: Any, samples: int, near_bits: wp.array2d[int], cull: int
):
    """Energy, gradient and Gauss-Newton Hessian at joints `q`; `base` is in the body's frame.

    `last` and `samples` are passed to `finger_energy`. `near_bits` (link, block) has a bit for each
    taxel that may press; with `cull` the bits are recomputed, otherwise they must be valid at `q`.
    """
    rest = on_skin(finger_energy(scene, body, hand, base, command, q, last, samples))
    f = posed(hand, base, q)
    for link in range(3):
        if pad.on[link] != 0:
            at = pad_link(hand, pad, f, link)
            near = int(1)
            if cull == 1 and not pad_is_near(scene, body, pad, at):
                near = int(0)
            for block in range(16):
                bits = near_bits[link, block]
                if cull == 1:
                    bits = int(0)
                    if near == 1:
                        bits = rows_near(scene, body, pad, at, block, turns)
                seen = int(bits)
                if bits != 0:
                    for i in range(4):
                        if (bits & (15 << (4 * i))) != 0:
                            row = taxel_row(pad, at, 4 * (block // 4) + i, turns)
                            for j in range(4):
                                bit = 1 << (4 * i + j)
                                if (bits & bit) != 0:
                                    x = taxel_place(pad, at, row, 4 * (block % 4) + j, turns)
                                    d = body_table_distance(scene, body, x)
                                    if d < ZERO:
                                        g = body_table_distance_grad(scene, body, x)
                                        jt = pad_moves(hand, f, at, x, vec3(g[0], g[1], g[2]))
                                        spring = taxel_spring(pad, -g[3])
                                        rest.skin.energy += spring[1]
                                        rest.skin.pressed += spring[1]
                                        rest.skin.gradient -= jt * spring[0]
                                        rest.pad_force += spring[0]
                                        rest.hessian += wp.outer(jt, jt) * spring[2]
                                    elif d >= CULLING_MARGIN:
                                        seen = seen ^ bit
                if cull == 1:
                    near_bits[link, block] = seen
    return rest


@wp.func
def _least_along(hand: Any, rest: Any, way: Any):
    """The step along `way`, in units of it, at which the energy should be least, seen from `rest`.

    Springs lose contact along the way, so that their force falls faster than a Newton step assumes:
    as (1 - r t)^n, with n and r from its first two derivatives (n is 2 while the same springs bear,
    3 for the shrinking patch of a round body). 0 without load, or where the load would not fall so.
    """
    servo_slope = wp.dot(rest.skin.drive, way)
    held = servo_curve(hand, way)
    energy = rest.skin.pressed
    slope = wp.dot(rest.skin.gradient, way) - servo_slope
    curve = wp.dot(way, rest.hessian * way) - held
    if energy <= ZERO or slope >= ZERO or energy * curve >= _STEEPEST * slope * slope:
        return ZERO
    n = ONE / (ONE - energy * curve / (slope * slope))
    r = -slope / (n * energy)
    t = -(servo_slope + slope) / (held + curve)
    for _newton in range(3):
        left = wp.max(ONE - r * t, _LEFT)
        power = wp.pow(left, n - TWO)
        t -= (servo_slope + held * t + slope * power * left) / (held + curve * power)
    return t


@wp.func(inline=False)
def pad_equilibrium(
    scene: Scene, body: int, hand: Any, pad: Pad, turns: wp.array[vec2], base: wp.transformd,
    command: Any, start: Any, near_bits: wp.array2d[int]
):
    """The equilibrium for a command, from `start`; the energy never rises.

    Newton steps. The first, from where springs bear, is lengthened as they lose contact, and a last
    step too small to need another is taken without evaluation. `near_bits` is valid at the result.
    """
    rest = in_the_air(start)
    culled_at = start * ONE
    step = start - start
    scale = real(1.0)
    shortened = int(0)
    lengthened = int(0)
    for k in range(_ITERATIONS):
        q = rest.skin.q + step * scale
        cull = int(1)
        if k > 0 and culling_holds(pad, hand, culled_at, q):
            cull = int(0)
        else:
            culled_at = q
        trial = pad_energy(scene, body, hand, pad, turns, base, command, q, rest.skin,
                                wp.where(k == 0, LINK_SAMPLES, 0), near_bits, cull)
        if k == 0 or trial.skin.energy < rest.skin.energy:
            rest = trial
            step = -(inverse_of(rest.hessian) * rest.skin.gradient)
            scale = real(1.0)
            if lengthened == 0:
                scale = wp.clamp(_least_along(hand, rest, step), ONE, _LONGEST)
                lengthened = int(scale > ONE)
            if shortened > 0 and rest.pad_force == ZERO and wp.max(rest.skin.depth) <= ZERO:
                scale = HALF  # nothing bears: the whole step goes where the last one failed
            shortened = int(0)
            if largest_magnitude(rest.skin.gradient) < _GRADIENT:
                break
            if largest_magnitude(rest.skin.gradient) < _LAST_GRADIENT and scale == ONE and (
                    culling_holds(pad, hand, culled_at, rest.skin.q + step)):
                rest.skin.q += step
                break
        else:
            shortened += 1
            back = _least_along(hand, trial, step * -scale)
            scale *= ONE - wp.where(back > ZERO, wp.clamp(back, _LEAST_BACK, _MOST_BACK), HALF)
            if shortened >= _SHORTENED:
                break
    if not culling_holds(pad, hand, culled_at, rest.skin.q):
        rest = pad_energy(scene, body, hand, pad, turns, base, command, rest.skin.q, rest.skin,
                               0, near_bits, 1)
    return rest
