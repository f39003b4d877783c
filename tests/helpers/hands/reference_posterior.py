"""Where a force that explains torques acts, written out in NumPy from the definition.

A place of a finger's skin weighs its area, times how fast it went outwards by the command's last
step, times the likelihood of the torques at the best size of a force there; next to nothing where
another capsule of its link covers it. With friction the force leans as it does at a middle of the
link, where it lies within nine tenths of the cone, or slides on the edge of that: give or take a
tenth of the coefficient each way, and two tenths along its way if it slides. Where the link goes
nowhere it leans in any direction, by half of it.
The places are the midpoints of the kernels' grid.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from warpgrasp.closing.contact_places_kernel import ALONG, AROUND, CAP, LEANS


@dataclass(frozen=True)
class Skin:
    """The skin of one capsule [m]: its axis (2, 3), its radius, the side that it closes towards."""

    link: int
    ends: np.ndarray
    radius: float
    palmar: np.ndarray
    lever: Callable[[np.ndarray], np.ndarray]
    """How points (place, 3) of the link move as each joint turns [m/rad], (place, joint, 3)."""
    caps: tuple[float, ...] = ()
    """1 for the round end on the palmar half, -1 for that on the other."""


@dataclass(frozen=True)
class Posterior:
    """Mean (3,) [m], covariance (3, 3) of the places alone, outward normal of what is touched (3,)
    and the probability of each link (link,)."""

    mean: np.ndarray
    covariance: np.ndarray
    normal: np.ndarray
    link_weight: np.ndarray


def affine_lever(lever: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """The lever of many points by that of one (3,), (joint, 3): it changes evenly with the place.
    """
    still = lever(np.zeros(3))
    slopes = np.array([lever(axis) - still for axis in np.eye(3)])
    return lambda points: still + np.einsum("pi,ijk->pjk", points, slopes)


def segment_distance(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Distances of points (place, 3) from a segment [m]."""
    line = end - start
    share = np.clip((points - start) @ line / (line @ line), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * line, axis=-1)


def sideways(out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (place, 3) along a surface whose normals are `out`."""
    one = np.cross(out, np.eye(3)[np.abs(out).argmin(-1)])
    one /= np.linalg.norm(one, axis=-1)[:, None]
    return one, np.cross(out, one)


def leaning(lever: np.ndarray, out: np.ndarray, step: np.ndarray, ease: np.ndarray, cone: float
            ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How forces (place, 3) lean, as shares of their push, on places whose motion a radian is
    `lever`: those that take back all of the motion asked for, if they lie within the cone, else
    those on its edge that leave a motion their own way. Found by bisection of how far each newton
    lets a place slide. Also which stick, and which go nowhere along the surface."""
    asked = np.einsum("pjk,j->pk", lever, step)
    yields = np.einsum("pjk,j,pjl->pkl", lever, ease, lever)
    frame = np.stack([out, *sideways(out)], axis=1)
    asked = np.einsum("pik,pk->pi", frame, asked)
    yields = np.einsum("pik,pkl,pjl->pij", frame, yields, frame)
    size = np.trace(yields[:, 1:, 1:], axis1=1, axis2=2)
    own = yields[:, 0, 0] + 1e-14 * size + 1e-300
    tilt = yields[:, 0, 1:] / own[:, None]
    slides = asked[:, 1:] - tilt * asked[:, :1]
    still = np.linalg.norm(slides, axis=-1) < 1e-9
    left = yields[:, 1:, 1:] - yields[:, 1:, :1] * tilt[:, None]

    def force(slip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (a, b), (_, c) = left.transpose(1, 2, 0) + np.eye(2)[..., None] * (slip + 1e-7 * size)
        along = np.stack([c * slides[:, 0] - b * slides[:, 1], a * slides[:, 1] - b * slides[:, 0]],
                         -1) / np.maximum(a * c - b * b, 1e-300)[:, None]
        return along, asked[:, 0] / own - (tilt * along).sum(-1)

    along, push = force(np.zeros(len(out)))
    stuck = (np.linalg.norm(along, axis=-1) <= cone * push) & (asked[:, 0] > 0.0)
    share = along / np.where(stuck, push, 1.0)[:, None]
    low, high = np.log(1e-9 * size + 1e-300), np.log(1e9 * size + 1e-300)
    for _ in range(60):
        middle = (low + high) / 2
        along, push = force(np.exp(middle))
        over = np.linalg.norm(along, axis=-1) > cone * push
        low, high = np.where(over, middle, low), np.where(over, high, middle)
    edge = np.where((asked[:, 0] > 0.0)[:, None], along, slides)
    edge = cone * edge / np.maximum(np.linalg.norm(edge, axis=-1), 1e-300)[:, None]
    share = np.where(still[:, None], 0.0, np.where(stuck[:, None], share, edge))
    return np.einsum("pi,pik->pk", share, frame[:, 1:]), stuck, still


def posterior(
    skins: Sequence[Skin], torque: np.ndarray, sigma: np.ndarray, friction: float, links: int,
    step: np.ndarray, stiffness: np.ndarray, least: float = 1e-300,
) -> Posterior:
    """Of torques (joint,) with their deviations [N m], after a step of the command [rad], with the
    servos' stiffness [N m/rad]; the square of those of a newton counts as `least`, in units of
    deviations, where it is less."""
    turned = np.linalg.norm(step)
    held = sigma > 1e100
    step, ease = np.where(held, 0.0, step), np.where(held, 0.0, 1.0 / stiffness)
    turn = np.pi * ((np.arange(AROUND) + 0.5) / AROUND - 0.5)
    up = np.pi / 2 * (np.arange(CAP) + 0.5) / CAP
    lean = np.arange(LEANS - 1) * 2 * np.pi / (LEANS - 1)
    far = np.sqrt(2 * LEANS / (LEANS - 1))  # a deviation of one each way, with the middle
    leans = np.concatenate([[[0.0, 0.0]], far * np.stack([np.cos(lean), np.sin(lean)], 1)])
    if friction == 0.0:
        leans = leans[:1]
    places, ways, weights, gains, numbers = [], [], [], [], []

    def note(skin: Skin, axis: np.ndarray, out: np.ndarray, along: np.ndarray, area: np.ndarray,
             middle: np.ndarray) -> None:
        skin_m = axis + skin.radius * out
        force = np.repeat(out[:, None], len(leans), axis=1)
        if friction:
            mean, stuck, still = leaning(skin.lever(middle + skin.radius * out), out, step, ease,
                                         0.9 * friction)
            far = np.linalg.norm(mean, axis=-1)[:, None]
            ahead = np.where(far > 0.0, mean / np.maximum(far, 1e-300), along)
            spread = friction * np.where(still, 0.5, 0.1)[:, None, None]
            longer = np.where(stuck | still, 1.0, 2.0)[:, None, None]
            force = force + mean[:, None] + spread * (
                longer * leans[:, :1] * ahead[:, None]
                + leans[:, 1:] * np.cross(out, ahead)[:, None])
        by = np.einsum("pjk,plk->plj", skin.lever(skin_m), force) / sigma
        push = np.maximum(by @ (torque / sigma), 0.0)
        gains.append(push**2 / np.maximum((by**2).sum(-1), least))
        places.append(skin_m)
        ways.append(out)
        swept = np.maximum(np.einsum("pjk,pk,j->p", skin.lever(skin_m), out, step), 1e-3 * turned)
        for other in skins:
            if other is not skin and other.link == skin.link:
                swept[segment_distance(skin_m, *other.ends) < other.radius] *= 1e-6
        weights.append(area * swept)
        numbers.append(np.full(len(out), skin.link))

    for skin in skins:
        start, end = skin.ends
        long = np.linalg.norm(end - start)
        u = (end - start) / long
        side = np.cross(u, skin.palmar)
        out = np.cos(turn)[:, None] * skin.palmar + np.sin(turn)[:, None] * side
        share = (np.arange(ALONG) + 0.5) / ALONG
        each = np.repeat(out, ALONG, axis=0)
        cell = np.pi * skin.radius / AROUND
        note(skin, np.tile(start + share[:, None] * (end - start), (AROUND, 1)), each,
             np.broadcast_to(u, each.shape), np.full(len(each), cell * long / ALONG),
             np.broadcast_to((start + end) / 2, each.shape))
        for half in skin.caps:
            each, rise = np.repeat(half * out, CAP, axis=0), np.tile(up, AROUND)[:, None]
            note(skin, np.broadcast_to(end, each.shape), each * np.cos(rise) + u * np.sin(rise),
                 u * np.cos(rise) - each * np.sin(rise),
                 cell * np.cos(rise)[:, 0] * np.pi / 2 * skin.radius / CAP,
                 np.broadcast_to(end, each.shape))
    gain = np.concatenate(gains)
    weight = (np.concatenate(weights)[:, None] * np.exp((gain - gain.max()) / 2)).sum(1)
    weight /= weight.sum()
    at, number = np.concatenate(places), np.concatenate(numbers)
    mean = weight @ at
    normal = -weight @ np.concatenate(ways)
    return Posterior(mean, (weight[:, None] * (at - mean)).T @ (at - mean),
                     normal / np.linalg.norm(normal),
                     np.array([weight[number == n].sum() for n in range(links)]))
