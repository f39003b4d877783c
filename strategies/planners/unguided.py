"""The plain strategies beside the adaptive ones: the same candidates, in an order that nothing felt
changes.

Nobody looks at the body on the way. So it is fitted but twice, after half of the budget and at its
end (`from_strategy`), and as many poses are asked for at once. (Of a body that was refined and one
from new starts the nearer to the touches stays: without the first, chamfer distances are some 2 %
larger.)
"""

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from strategies.planners.probes import Grasp, Probe
from strategies.planners.register import planner
from strategies.poses.hand_outline import outline_of
from strategies.recovery.belief import Belief
from warpgrasp.core.random import counter_key, counter_uniform

HALF = 2
"""The first poses are one in so many of what the budget has room for."""


class Unguided(ABC):
    """Base of these planners: candidates about the prior, in an order known from the start."""

    def __init__(self) -> None:
        self.at_once: int | None = 1
        """Poses a step; None: as many as are sure to be within the budget of touches, or at first
        within half of it."""
        self._poses = np.zeros((0, 0, 7))
        """Hand poses of each world, in turn, (world, place, 7)."""
        self._many = self._taken = np.zeros(0, int)
        """How many of them the arm reaches, and how many were taken, (world,)."""

    def __call__(self, belief: Belief) -> list[Probe]:
        """The next poses in every world that has any left."""
        if not len(self._taken):
            self._begin(belief)
        left = np.where(belief.active, np.minimum(self._many - self._taken, self._room(belief)), 0)
        places = np.arange(max(left.max(initial=0), 1))
        wanted = places < left[:, None]
        at = np.minimum(self._taken[:, None] + places, self._poses.shape[1] - 1)
        self._taken += left
        return [Grasp(np.take_along_axis(self._poses, at[..., None], 1), wanted)]

    def _begin(self, belief: Belief) -> None:
        from strategies.planners.candidates import candidate_poses  # with it kernels of foresight

        poses, reachable = candidate_poses(belief, about="prior")
        turn = self.order(belief, poses, reachable)
        self._poses = np.take_along_axis(poses, turn[..., None], 1)
        self._many, self._taken = reachable.sum(1), np.zeros(belief.worlds, int)

    def _room(self, belief: Belief) -> np.ndarray | int:
        """Poses that are asked for at once, of each world or of all."""
        if self.at_once is not None:
            return self.at_once
        if belief.touches_left is None:
            return self._poses.shape[1]
        each = outline_of(belief.hand).fingers * len(belief.closings)
        return -(-belief.touches_left // (each if self._taken.any() else HALF * each))

    @abstractmethod
    def order(self, belief: Belief, poses: np.ndarray, reachable: np.ndarray) -> np.ndarray:
        """Numbers of all candidates in turn, (world, place); those that the arm does not reach come
        last."""


@planner("random", "a pose at random among the candidates about the prior")
class RandomPose(Unguided):
    """A pose at random."""

    def order(self, belief: Belief, poses: np.ndarray, reachable: np.ndarray) -> np.ndarray:
        """By a draw a place and candidate, so that orders agree with those of single steps."""
        candidate = np.arange(poses.shape[1])

        def drawn(place: int, taken: np.ndarray) -> np.ndarray:
            return counter_uniform(counter_key(belief.seed[:, None], place, candidate))

        return _greedy(drawn, reachable)


@planner("even", "the pose farthest from all poses taken, about the prior")
class EvenPoses(Unguided):
    """Farthest-point order (Gonzalez 1985) over the places of the hand and its approach."""

    def order(self, belief: Belief, poses: np.ndarray, reachable: np.ndarray) -> np.ndarray:
        """By the distance to the nearest pose taken; 0.1 m counts as much as one radian."""
        apart = _apart(poses)

        return _greedy(lambda place, taken: _nearest(apart, taken), reachable)


def far_from_taken(poses: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """How far each pose is from the nearest of those taken, (world, candidate); 1 where none is."""
    return _nearest(_apart(poses), taken)


def _nearest(apart: np.ndarray, taken: np.ndarray) -> np.ndarray:
    near = np.where(taken[:, None], apart, np.inf).min(-1)
    return np.where(np.isfinite(near), near, 1.0)


def _greedy(gain: Callable[[int, np.ndarray], np.ndarray], reachable: np.ndarray) -> np.ndarray:
    """All candidates, each the one of the greatest gain, given its place and those taken before."""
    taken = np.zeros(reachable.shape, bool)
    order = np.empty_like(reachable, int)
    every = np.arange(len(order))
    for place in range(reachable.shape[1]):
        # What is out of reach comes after all that is not.
        worth = np.where(reachable, gain(place, taken), -1.0)
        order[:, place] = np.where(taken, -np.inf, worth).argmax(1)
        taken[every, order[:, place]] = True
    return order


def _apart(poses: np.ndarray) -> np.ndarray:
    """Distances between a world's poses, (world, candidate, candidate)."""
    x, y, z, w = np.moveaxis(poses[..., 3:], -1, 0)
    approach = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], -1)
    side = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], -1)
    place = np.concatenate([poses[..., :3] / 0.1, approach, 0.5 * side], -1)
    return np.linalg.norm(place[:, :, None] - place[:, None], axis=-1)
