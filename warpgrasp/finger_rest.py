"""Where a finger rests: the least energy of its joint servos and its skin against rigid things.

Newton steps on the Gauss-Newton Hessian of `finger_energy` with backtracking: E never rises. A link
keeps to the valley of the distance it lies in. Where it stops is looked at closely, see
`finger_crease`.
"""

import warp as wp

from warpgrasp.finger_energy import Rest, finger_energy, worst_of
from warpgrasp.real import HALF, real, vec4
from warpgrasp.scene import Scene
from warpgrasp.utah_mit_hand import Hand

_ITERATIONS = wp.constant(30)
_HALVINGS = wp.constant(12)
_GRADIENT = wp.constant(real(1e-6))  # [N m]; 0.2 mN on a tendon, a 300th of the converter's step


@wp.func
def finger_rest(
    scene: Scene, body: int, hand: Hand, base: wp.transformd, command: vec4, start: vec4,
    last: Rest, samples: int
):
    """The rest configuration for a command, descending from `start`; `base` in the body's frame.

    Valleys are chosen at the start, with `samples` compared, and followed from there.
    """
    rest = last
    step = start - last.q
    scale = real(1.0)
    halvings = int(0)
    for k in range(_ITERATIONS):
        trial = finger_energy(scene, body, hand, base, command, rest.q + step * scale, rest,
                              wp.where(k == 0, samples, 0))
        halvings += 1
        scale = scale * HALF
        if k == 0 or trial.energy < rest.energy:
            rest = trial
            halvings = int(0)
            scale = real(1.0)
            step = -(rest.compliance * rest.gradient)
        if worst_of(rest.gradient) < _GRADIENT or halvings >= _HALVINGS:
            break
    return rest
