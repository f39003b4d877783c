"""Where a finger rests when its pads bear too: the energy of `finger_rest` plus the pads' springs.

    E(q) = E_servo,skin(q) + sum over taxels 1/2 k max(0, -phi(x_taxel(q)))^2

Pads stand proud of the skin, so they yield first and the skin behind them takes over.
"""

import warp as wp

from warpgrasp.finger_rest import Rest, link_direction, link_start, rest_energy, table_jacobian
from warpgrasp.real import HALF, ZERO, mat44, real, vec3, vec4
from warpgrasp.scene import Scene, body_distance_grad, stand_distance, stand_distance_grad
from warpgrasp.tactile_pad import Pad, block_near, pad_near, pad_place
from warpgrasp.utah_mit_hand import Hand, finger_jacobian, finger_pose

_ITERATIONS = wp.constant(30)
_HALVINGS = wp.constant(12)
_GRADIENT = wp.constant(real(1e-7))  # [N m]: some 1e-6 N at the tip


@wp.struct
class PadRest:
    """A finger at rest: skin and servos (energy and gradient include the pads), curvature, load."""

    skin: Rest
    hessian: mat44
    pad_force: real
    """Sum over all taxels [N]."""


@wp.func
def pad_rest_energy(
    scene: Scene, body: int, hand: Hand, pad: Pad, base: wp.transformd, command: vec4, q: vec4
):
    """Energy, gradient and Gauss-Newton Hessian at joints `q`; `base` in the body's frame."""
    rest = PadRest()
    rest.skin = rest_energy(scene, body, hand, base, command, q)
    k = hand.stiffness
    h = mat44(k, ZERO, ZERO, ZERO, ZERO, k, ZERO, ZERO, ZERO, ZERO, k, ZERO, ZERO, ZERO, ZERO, k)
    f = finger_pose(hand, base, q)
    for link in range(3):
        if rest.skin.depth[link] > ZERO:
            x = link_start(f, link) + link_direction(f, link) * rest.skin.along[link]
            g = body_distance_grad(scene, body, x)
            j = finger_jacobian(f, link, x, vec3(g[0], g[1], g[2]))
            h += wp.outer(j, j) * hand.skin
        if rest.skin.table[link] > ZERO:
            low = table_jacobian(f, link, hand.link_length[link])
            h += wp.outer(low, low) * hand.skin
        if pad.on[link] != 0 and pad_near(scene, body, pad, hand, f, link):
            for block in range(16):
                if block_near(scene, body, pad, hand, f, link, block):
                    for cell in range(16):
                        row = real(4 * (block // 4) + cell // 4)
                        column = real(4 * (block % 4) + cell % 4)
                        place = pad_place(pad, hand, f, link, row, column)
                        if stand_distance(scene, body, place.x) < ZERO:
                            taxel = stand_distance_grad(scene, body, place.x)
                            jt = finger_jacobian(f, link, place.x,
                                                 vec3(taxel[0], taxel[1], taxel[2]))
                            load = -taxel[3] * pad.stiffness
                            rest.skin.energy -= HALF * load * taxel[3]
                            rest.skin.gradient -= jt * load
                            rest.pad_force += load
                            h += wp.outer(jt, jt) * pad.stiffness
    rest.hessian = h
    return rest


@wp.func
def pad_rest(
    scene: Scene, body: int, hand: Hand, pad: Pad, base: wp.transformd, command: vec4, start: vec4
):
    """The rest configuration for a command, descending from `start`; the energy never rises."""
    rest = pad_rest_energy(scene, body, hand, pad, base, command, start)
    for _ in range(_ITERATIONS):
        worst = wp.max(wp.max(wp.abs(rest.skin.gradient[0]), wp.abs(rest.skin.gradient[1])),
                       wp.max(wp.abs(rest.skin.gradient[2]), wp.abs(rest.skin.gradient[3])))
        if worst < _GRADIENT:
            break
        step = -(wp.inverse(rest.hessian) * rest.skin.gradient)
        scale = real(1.0)
        descended = int(0)
        for _h in range(_HALVINGS):
            trial = pad_rest_energy(scene, body, hand, pad, base, command,
                                    rest.skin.q + step * scale)
            if trial.skin.energy < rest.skin.energy:
                rest = trial
                descended = int(1)
                break
            scale = scale * HALF
        if descended == 0:
            break
    return rest
