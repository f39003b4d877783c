"""Strategies for objects of any shape: they spend touches where the object may still be.

They keep an occupancy grid (`strategies.foresight`) instead of a fitted body, and at each step
make a free form of the contacts. They draw hand poses about the prior and about what was felt, and
take the one or few whose fingers are expected to touch what is known
least: each touch is worth what it would tell where it is made, if it is made, and those of other
poses nearby count less then (greedy, Nemhauser, Wolsey and Fisher 1978).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from strategies.foresight.aimed_poses import draw_aimed_poses
from strategies.foresight.hand_samples import HandSamples, reached_place, samples_of_hand
from strategies.foresight.occupancy import Occupancy, Prospect, begin_occupancy
from strategies.foresight.process_occupancy import occupancy_by_process
from strategies.planners.probes import Grasp, Probe
from strategies.planners.register import planner, whole_option
from strategies.poses.hand_outline import outline_of
from strategies.procedures.touches import TABLE_MARGIN_M
from strategies.recovery.belief import Belief
from strategies.recovery.free_contacts import BODY, believed_freely
from warpgrasp.mechanism.arm_reach import pose_reachable

CANDIDATES = 16384
"""Poses drawn at each step; three times as many find no more."""
LOOKED_AT = 256
"""Of them, those that a first look finds best: the arm's reach and all of the hand are asked only
of these."""
UNSURE_M = 0.006
"""A contact whose standard deviation is this counts half [est]."""
IN_TURN, MATCHED = "in-turn", "matched"
PRICE = 0.55
"""Where the budget limits touches, a finger closes only if it is expected to find this share of
what the best finger of all would: one that stays open costs no touch [est]."""


@dataclass(frozen=True)
class _Asked:
    """Grasps along one closing path."""

    closing: int
    """Number of the path."""
    pose: np.ndarray
    """(world, pose, 7)."""
    wanted: np.ndarray
    """(world, pose)."""
    closes: np.ndarray
    """Which fingers close, (world, pose, finger)."""
    promise: np.ndarray
    """What the first pose is expected to bring, (world,)."""


@planner("any-object", "where an object of any shape may be and is known least, by what was felt")
class AnyObject:
    """Greedy expected worth of touches, each counted beside those before it."""

    def __init__(self, poses: int = 4, candidates: int = CANDIDATES, paths: str = IN_TURN) -> None:
        """`poses` a step, chosen of so many `candidates`; `paths` says which closing path the
        hand takes, and so how wide it opens: all in turn, or in each world the one that is expected
        to bring most there ("matched"). Raises ValueError."""
        self.poses = whole_option("poses", poses, 1, 16)
        self.candidates = whole_option("candidates", candidates, self.poses, 65536)
        if paths not in (IN_TURN, MATCHED):
            raise ValueError(f"paths is {paths!r}; should be {IN_TURN!r} or {MATCHED!r}")
        self.matched = paths == MATCHED
        self.grid: Occupancy | None = None
        self.asked: list[_Asked] = []
        self.slots = 0
        """Contacts in the evidence before what was last asked for."""
        self.step = 0
        self.over: np.ndarray | None = None
        """Worlds of which nothing was wanted once: alone, their episodes would have ended."""

    def __call__(self, belief: Belief) -> list[Probe]:
        """The next poses of every world that is active."""
        samples = [samples_of_hand(belief.hand, (name,)) for name in belief.closings]
        grid = self.grid or begin_occupancy(belief.prior, outline_of(belief.hand).skin_m)
        self.grid = grid
        for asked, first in _made(self.asked, self.slots, belief):
            self._learn(belief, samples[asked.closing], grid, asked, first)
        over = np.zeros(belief.worlds, bool) if self.over is None else self.over
        active = belief.active & ~over
        seen, worth = self._looks(belief, grid, active)
        looked_at = range(len(samples)) if self.matched else (self.step % len(samples),)
        found = [self._best_of_path(belief, samples[path], path, seen, worth, active)
                 for path in looked_at]
        most = np.argmax([asked.promise for asked in found], axis=0)
        found = [replace(asked, wanted=asked.wanted & (most == number)[:, None])
                 for number, asked in enumerate(found)]
        self.over = over | (active & ~np.any([asked.wanted.any(1) for asked in found], axis=0))
        self.asked = [asked for asked in found if asked.wanted.any()]
        self.slots = belief.evidence.mask.shape[1]
        self.step += 1
        return [Grasp(asked.pose, asked.wanted, (belief.closings[asked.closing],), asked.closes)
                for asked in self.asked]

    def _best_of_path(self, belief: Belief, samples: HandSamples, closing: int, seen: Occupancy,
                      worth: np.ndarray, active: np.ndarray) -> _Asked:
        """The best poses for one closing path, whose hand is `samples`."""
        evidence, outline = belief.evidence, outline_of(belief.hand)
        lowest = TABLE_MARGIN_M + 0.5 * outline.skin_m
        poses = draw_aimed_poses(belief.seed, self.step, self.candidates, belief.prior,
                                 evidence.points_m, evidence.mask, samples, outline.reach_m)
        price = 0.0 if belief.touches_left is None else PRICE
        poses = self._best_looking(poses, price, active, lambda some, wanted: seen.foresee(
            samples.thinned.open_m, samples.thinned.swept[0], some, wanted, worth, lowest,
            closely=False))
        free = pose_reachable(belief.arm, belief.hand, poses) & active[:, None]
        found = seen.foresee(samples.open_m, samples.swept[0], poses, free, worth, lowest)
        chosen, wanted, closes, promise = _greedy(
            np.where(free[..., None], found.gain, 0.0), found.place_m, self.poses, price)
        return _Asked(closing, np.take_along_axis(poses, chosen[..., None], 1), wanted, closes,
                      promise)

    def _looks(self, belief: Belief, grid: Occupancy, active: np.ndarray
               ) -> tuple[Occupancy, np.ndarray]:
        """Where the object may be, and what a touch in each cell is worth, (world, cells), of the
        worlds that are `active`."""
        return _seen_freely(belief, grid, active, pooled=True)

    @staticmethod
    def _best_looking(poses: np.ndarray, price: float, active: np.ndarray,
                      look: Callable[[np.ndarray, np.ndarray], Prospect]) -> np.ndarray:
        """Of poses (world, candidate, 7) those from which a first look expects most, in the order
        in which they were drawn."""
        if poses.shape[1] <= LOOKED_AT:
            return poses
        wanted = np.repeat(active[:, None], poses.shape[1], 1)
        gain = _of_pose(look(poses, wanted).gain, price)
        best = np.argpartition(-gain, LOOKED_AT - 1, axis=1)[:, :LOOKED_AT]
        return np.take_along_axis(poses, np.sort(best, axis=1)[..., None], 1)

    @staticmethod
    def _learn(belief: Belief, samples: HandSamples, grid: Occupancy, asked: _Asked, first: int
               ) -> None:
        """What grasps whose contacts begin with slot `first` have told of the cells."""
        evidence, swept = belief.evidence, samples.swept[0]
        worlds, poses = asked.wanted.shape
        fingers = len(swept.met)
        new = slice(first, first + fingers * poses)
        q = belief.links.q_rad[:, new].reshape(worlds, poses, fingers, -1)
        closed = asked.wanted[..., None] & (q != 0.0).any(-1)  # nothing is read of what was barred
        grid.learn_barred(samples.open_m, asked.pose,
                          asked.wanted & ~closed.any(2) & belief.active[:, None])
        mask = evidence.mask[:, new]
        normal = np.nan_to_num(evidence.normals[:, new])
        spread = np.sqrt(np.trace(evidence.covariance_m2[:, new], axis1=2, axis2=3))
        sure = np.isfinite(evidence.contradiction[:, new]) & (np.abs(normal).sum(-1) > 0.0)
        weight = np.where(mask & sure, 1.0 / (1.0 + (spread / UNSURE_M) ** 2), 0.0)
        grid.learn_touches(evidence.points_m[:, new], normal, weight)
        last = reached_place(swept, np.arange(fingers), q)
        # Where a finger touched, its last places are those of the contact itself.
        last = np.where(mask.reshape(closed.shape), last - 1, last + 1)
        until = np.where(closed, np.clip(last, 0, swept.balls_m.shape[1]), 0)
        grid.learn_swept(samples.open_m, swept, asked.pose, closed.any(2), until)


class FreeFormSearch(AnyObject):
    """The same by the free form alone, where it tells anything."""

    def _looks(self, belief: Belief, grid: Occupancy, active: np.ndarray
               ) -> tuple[Occupancy, np.ndarray]:
        return _seen_freely(belief, grid, active, pooled=False)


def _seen_freely(belief: Belief, grid: Occupancy, active: np.ndarray, *, pooled: bool
                 ) -> tuple[Occupancy, np.ndarray]:
    rows = np.flatnonzero(active)
    return occupancy_by_process(grid, believed_freely(belief, rows), rows, BODY, pooled=pooled)


def _made(asked: list[_Asked], first: int, belief: Belief) -> Iterator[tuple[_Asked, int]]:
    """Of grasps those that were made, and the first slot of each, from slot `first` on. Not made
    are those of worlds alone that ended before."""
    left = sum(each.closes[0].size for each in asked) - (belief.evidence.mask.shape[1] - first)
    for each in asked:
        if left > 0 and not (each.wanted.any(1) & belief.active).any():
            left -= each.closes[0].size
            continue
        yield each, first
        first += each.closes[0].size


def _beyond(gain: np.ndarray, price: float) -> np.ndarray:
    """What touches gain beyond their price, a share of the most of all (world, pose, finger)."""
    return gain - price * gain.max((1, 2), keepdims=True)


def _of_pose(gain: np.ndarray, price: float) -> np.ndarray:
    """The same of poses, (world, pose): fingers that would gain less stay open."""
    left = _beyond(gain, price)
    np.maximum(left, 0.0, out=left)
    return reduce(np.add, np.moveaxis(left, 2, 0))  # a fifth of the time of `sum` over few


def _greedy(gain: np.ndarray, place_m: np.ndarray, poses: int, price: float
            ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The best candidates, each counted beside those before it: their numbers (world, pose),
    whether anything is expected of them, which fingers are to close (world, pose, finger), and what
    all fingers that close in the first are expected to bring (world,)."""
    rows = np.arange(len(gain))
    left = gain.copy()
    chosen, wanted, closes, promise = [], [], [], np.zeros(len(gain))
    for number in range(poses):
        total = _of_pose(left, price)
        best = total.argmax(1)
        if number == 0:
            promise = np.where(_beyond(left, price) >= 0.0, left, 0.0)[rows, best].sum(1)
        chosen.append(best)
        wanted.append(total[rows, best] > 0.0)
        closes.append(_beyond(left, price)[rows, best] >= 0.0)
        there = place_m[rows, best]
        likely = np.minimum(gain[rows, best] * 4.0, 1.0)
        apart = np.linalg.norm(place_m[:, :, :, None] - there[:, None, None], axis=-1)
        covered = likely[:, None, None] * np.clip(1.0 - apart / 0.02, 0.0, 1.0)
        left = left * (1.0 - covered.max(-1))
        left[rows, best] = 0.0
    return np.stack(chosen, 1), np.stack(wanted, 1), np.stack(closes, 1), promise
