"""Which of the known objects was felt: each is laid on the touches, and the best one must fit.

The known bodies stand upright, so three numbers place one: x, y and its turn about the vertical.
They are found by Gauss-Newton on the distances of the touches to its surface, from several turns
(verification of a hypothesis after Grimson and Lozano-Perez 1984, with the distance field in place
of face bounds). A body taller than what was felt leaves its top untouched: the height counts too.
"None of these" is what fits worse than touches of a known body do.
"""

from dataclasses import dataclass

import numpy as np

from strategies.belief import Belief
from strategies.recovered import Recovered, Shape
from strategies.upright import stand_upright
from warpgrasp.body import Body, distance_to_bodies, scene_of
from warpgrasp.body_names import BODY_NAMES
from warpgrasp.catalogue import body_from_name

NONE = "none of these"
TURNS = 12
ITERATIONS = 8
CAP = 3.0
"""Deviations beyond which a touch says no more against a body: one bad touch decides nothing."""
MODEL_SIGMA_M = 0.0015
"""Added to a touch's own spread: what estimates leave out [est]."""
TOP_SIGMA_M = 0.006
"""How well the height of what was felt is known [est]."""
TOP_CAP = 6.0
"""The same for the height, which is one number and decides more."""
EFFECTIVE = 0.25
"""Independent touches of all: neighbours err together [est]."""
NONE_SQUARE = 2.2
"""Mean squared deviation, capped, from which touches speak against a body [est]."""


@dataclass(frozen=True)
class Ranking:
    """How well each known body explains what was felt. Shapes (world, body)."""

    names: tuple[str, ...]
    square: np.ndarray
    """Mean squared deviation of the touches, each at most `CAP` squared, with the height's."""
    probability: np.ndarray
    """Of each body, and last of none of them: (world, body + 1); rows sum to one."""


class Recognizer:
    """Known bodies, ready to be compared with what was felt."""

    def __init__(self, bodies: dict[str, Body], *, device: str = "cpu") -> None:
        """`bodies` stand on z = 0 of their own frames; names are the answers."""
        if not bodies:
            raise ValueError("bodies: empty; give at least one known body")
        self.bodies, self.device = bodies, device
        self.scene = scene_of(list(bodies.values()), device)
        self.turns = [TURNS if _has_sides(body, device) else 1 for body in bodies.values()]

    def ranking(self, belief: Belief, recovered: Recovered) -> Ranking:
        """Each known body against each world's touches."""
        evidence = belief.evidence
        stands = stand_upright(recovered.superquadric)
        centre, top = stands.centre_m[:, :2].copy(), stands.top_m.copy()
        turned = recovered.shape == Shape.REVOLUTION
        if recovered.revolution is not None and turned.any():
            body = recovered.revolution
            highest = np.where(np.isfinite(body.height_m), body.height_m, -np.inf).max(1)
            centre[turned] = body.foot_m[turned, :2]
            top[turned] = (body.foot_m[:, 2] + highest * body.axis[:, 2])[turned]
        mask = evidence.mask
        trace = np.trace(evidence.covariance_m2, axis1=-2, axis2=-1)
        normal = np.nan_to_num(evidence.normals)
        along = np.einsum("wpi,wpij,wpj->wp", normal, evidence.covariance_m2, normal)
        sigma = np.sqrt(np.where(along > 0, along, trace / 3) + MODEL_SIGMA_M**2)
        square = np.stack([
            self._square(number, evidence.points_m, mask, sigma, centre)
            + np.minimum(np.abs(top - body.high_m[2]) / TOP_SIGMA_M, TOP_CAP) ** 2
            / np.maximum(EFFECTIVE * mask.sum(1), 1.0)
            for number, body in enumerate(self.bodies.values())], 1)
        count = EFFECTIVE * mask.sum(1, keepdims=True)
        log = -0.5 * count * np.concatenate(
            [square, np.full((len(square), 1), NONE_SQUARE)], axis=1)
        log[:, :-1] -= np.log(len(self.bodies))
        weight = np.exp(log - log.max(1, keepdims=True))
        return Ranking(tuple(self.bodies), square, weight / weight.sum(1, keepdims=True))

    def names(self, belief: Belief, recovered: Recovered) -> np.ndarray:
        """The likeliest answer of each world, "" where no body was recovered, str (world,)."""
        if not (recovered.shape != Shape.TOLD_CYLINDER).any():
            return np.full(belief.worlds, "", object)
        found = self.ranking(belief, recovered)
        answers = np.array([*found.names, NONE], object)[found.probability.argmax(1)]
        return np.where(recovered.shape == Shape.TOLD_CYLINDER, "", answers)

    def _square(self, number: int, points: np.ndarray, mask: np.ndarray, sigma: np.ndarray,
                centre: np.ndarray) -> np.ndarray:
        """Mean capped square of one body's best placement, (world,)."""
        turns = self.turns[number]
        worlds = len(points)
        pose = np.repeat(np.concatenate([centre, np.zeros((worlds, 1))], 1), turns, axis=0)
        pose[:, 2] = np.tile(2 * np.pi * np.arange(turns) / turns, worlds)
        p, m, s = (np.repeat(v, turns, axis=0) for v in (points, mask, sigma))
        for _ in range(ITERATIONS):
            distance, slope = self._distance(number, pose, p)
            r = distance / s
            weight = np.where(m, 1.0 / (1.0 + (r / CAP) ** 2) ** 2, 0.0) / s**2
            jtj = np.einsum("wp,wpi,wpj->wij", weight, slope, slope)
            jtj += np.eye(3) * np.array([1.0, 1.0, 1e-4]) * 10.0
            step = np.linalg.solve(jtj, np.einsum("wp,wpi,wp->wi", weight, slope,
                                                  distance)[..., None])[..., 0]
            step[:, 2] = 0.0 if turns == 1 else np.clip(step[:, 2], -0.3, 0.3)
            pose = pose - np.clip(step, -0.3, 0.3)
        distance, _ = self._distance(number, pose, p)
        square = np.minimum((distance / s) ** 2, CAP**2) * m
        mean = square.sum(1) / np.maximum(m.sum(1), 1)
        return mean.reshape(worlds, turns).min(1)

    def _distance(self, number: int, pose: np.ndarray, points: np.ndarray) -> tuple[
            np.ndarray, np.ndarray]:
        """Distances of points to a body at poses (x, y, turn), and their slopes in the three."""
        c, s = np.cos(pose[:, 2])[:, None], np.sin(pose[:, 2])[:, None]
        dx, dy = points[..., 0] - pose[:, :1], points[..., 1] - pose[:, 1:2]
        local = np.stack([c * dx + s * dy, c * dy - s * dx, points[..., 2]], -1)
        distance, gradient = distance_to_bodies(self.scene, np.array([number]), local,
                                                device=self.device)
        gx, gy = gradient[..., 0], gradient[..., 1]
        slope = np.stack([-(c * gx - s * gy), -(s * gx + c * gy),
                          gx * local[..., 1] - gy * local[..., 0]], -1)
        return distance, np.nan_to_num(slope)


def recognizer(names: tuple[str, ...] = (), *, device: str = "cpu") -> Recognizer:
    """A recognizer of catalogue objects, all of them where none is named."""
    return Recognizer({name: body_from_name(name) for name in names or tuple(BODY_NAMES)},
                      device=device)


def _has_sides(body: Body, device: str) -> bool:
    """Whether a turn about the vertical changes the body."""
    high = np.asarray(body.high_m)
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rings = [np.stack([r * high[0] * np.cos(angle), r * high[0] * np.sin(angle),
                       np.full(24, z * high[2])], 1) for r in (0.4, 0.8, 1.1)
             for z in (0.2, 0.5, 0.8)]
    distance, _ = distance_to_bodies(scene_of([body], device), np.zeros(1, int),
                                     np.concatenate(rings)[None], device=device)
    return bool(np.ptp(distance.reshape(len(rings), 24), axis=1).max() > 1e-6)
