"""Recognition by exact bodies: each known one is laid on the touches, and the best one must fit.

That is more than a robot would know; it shows what the touches could tell. The bodies stand
upright, so three numbers place one: x, y and its turn about the vertical. They are found by
Gauss-Newton on the distances of the touches to its surface, from several turns (verification of a
hypothesis after Grimson and Lozano-Perez 1984, with the distance field in place of face bounds). A
body taller than what was felt leaves its top untouched: the height counts too. "None of these" is
what fits worse than touches of a known body do.
"""

from dataclasses import dataclass

import numpy as np

from strategies.recognition.answers import ALIGNMENT, NONE, Recognition, no_answer
from strategies.recognition.pose_alignment import placed_squares
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.upright import stand_upright
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.objects.catalogue_names import BODY_NAMES

TURNS = 12
"""Of a whole turn, from which a body with sides is laid down."""
SAME_M = 1e-6
"""Bodies whose distances differ by no more are the same."""
MODEL_SIGMA_M = 0.0015
"""Added to a touch's own spread: what estimates leave out [est]."""
TOP_SIGMA_M = 0.006
"""How well the height of what was felt is known [est]."""
TOP_CAP = 6.0
"""Cap of the height's deviation, as `pose_alignment_kernel.CAP` of a touch's: the height is one
number and decides more."""
EFFECTIVE = 0.25
"""Independent touches of all: neighbours err together [est]."""
NONE_SQUARE = 2.2
"""Mean squared capped deviation from which touches contradict a body [est]."""


@dataclass(frozen=True)
class Ranking:
    """How well each known body explains what was felt. Shapes (world, body)."""

    names: tuple[str, ...]
    square: np.ndarray
    """Mean squared deviation of the touches, each at most `pose_alignment_kernel.CAP` squared, with
    the height's."""
    probability: np.ndarray
    """Of each body, and last of none of them: (world, body + 1); rows sum to one. Before anything
    is felt none has a half, as `NONE_SQUARE` was chosen, and the bodies share the other."""


class Recognizer:
    """Known bodies, ready to be compared with what was felt."""

    def __init__(self, bodies: dict[str, Body], *, device: str = "cpu") -> None:
        """`bodies` stand on z = 0 of their own frames; names are the answers."""
        if not bodies:
            raise ValueError("bodies: empty; give at least one known body")
        self.bodies, self.device = bodies, device
        self.scene = scene_of(list(bodies.values()), device)
        self.turns = [_turns(body, device) for body in bodies.values()]

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
        count = EFFECTIVE * mask.sum(1, keepdims=True)
        heights = np.array([body.high_m[2] for body in self.bodies.values()])
        square = placed_squares(self.scene, self.turns, evidence.points_m, mask, sigma, centre,
                                device=self.device)
        square += (np.minimum(np.abs(top[:, None] - heights) / TOP_SIGMA_M, TOP_CAP) ** 2
                   / np.maximum(count, 1.0))
        log = -0.5 * count * np.concatenate(
            [square, np.full((len(square), 1), NONE_SQUARE)], axis=1)
        log[:, :-1] -= np.log(len(self.bodies))
        weight = np.exp(log - log.max(1, keepdims=True))
        return Ranking(tuple(self.bodies), square, weight / weight.sum(1, keepdims=True))

    def recognize(self, belief: Belief, recovered: Recovered) -> Recognition:
        """The likeliest answer of each world, "" where no body was recovered."""
        there = recovered.shape != Shape.PRIOR
        if not there.any():
            return no_answer(len(there))
        found = self.ranking(belief, recovered)
        answers = np.array([*found.names, NONE], object)[found.probability.argmax(1)]
        return Recognition(np.where(there, answers, ""), np.where(there, ALIGNMENT, ""),
                           np.where(there, found.probability.max(1), np.nan))


def recognizer(*, device: str = "cpu") -> Recognizer:
    """A recognizer of all catalogue objects."""
    return Recognizer({name: body_from_name(name) for name in BODY_NAMES}, device=device)


def _turns(body: Body, device: str) -> np.ndarray:
    """Turns [rad] to lay a body down from: those of a whole turn that do not give the same body."""
    high = np.asarray(body.high_m)
    angle = 2 * np.pi * np.arange(2 * TURNS) / (2 * TURNS)
    rings = [np.stack([r * high[0] * np.cos(angle), r * high[0] * np.sin(angle),
                       np.full(len(angle), z * high[2])], 1) for r in (0.4, 0.8, 1.1)
             for z in (0.2, 0.5, 0.8)]
    distance, _ = distance_to_bodies(scene_of([body], device), np.zeros(1, int),
                                     np.concatenate(rings)[None], device=device)
    distance = distance.reshape(len(rings), len(angle))
    if np.ptp(distance, axis=1).max() <= SAME_M:
        return np.zeros(1)
    starts = 2 * np.pi * np.arange(TURNS) / TURNS
    for fold in (4, 2):
        if np.abs(distance - np.roll(distance, len(angle) // fold, axis=1)).max() <= SAME_M:
            return starts[: TURNS // fold]
    return starts
