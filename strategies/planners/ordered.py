"""The planner of strategies given in advance: procedures in their order, `decide` among them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fit.arrays import rows_of
from strategies.planners.next_procedure import (
    Next,
    contour_to_follow,
    decide,
    faces_to_cross,
    flat_topped,
    top_to_cross,
)
from strategies.planners.probes import CrossFaces, FollowContour, Grasp, Probe, wanted_of
from strategies.poses.hand_poses import waypoint_poses
from strategies.procedures.options import ContourTable, DecideTable, PlanarTable
from strategies.recovery.belief import Belief
from strategies.strategy import Strategy

if TYPE_CHECKING:
    from strategies.procedures.stereo_axis import StereoAxis


def axis_unseen(planner: object, worlds: int) -> np.ndarray:
    """In which worlds cameras were to see an axis and did not, bool (world,): an upright one stands
    for it there."""
    if isinstance(planner, OrderedPlanner) and planner.seen is not None:
        return ~planner.seen.found
    return np.zeros(worlds, bool)


class OrderedPlanner:
    """Carries out `Strategy.order`; what each step wants depends on the body believed by then."""

    def __init__(self, strategy: Strategy, planar: PlanarTable, contour: ContourTable,
                 decide_by: DecideTable, seen: "StereoAxis | None" = None,
                 waypoints: Sequence[tuple[Sequence[object], int]] = ()) -> None:
        """`seen` is the axis that the cameras saw, where `contour.axis` asks for it; `waypoints`
        are the families of so many worlds each, in turn, where they are not the strategy's."""
        self.strategy, self.seen, self.waypoints = strategy, seen, waypoints
        self.planar, self.contour, self.decide_by = planar, contour, decide_by
        self.parts: list[tuple[str, np.ndarray | None]] | None = None
        self.crossing = np.zeros(0, bool)
        """Worlds that were sent to cross a face, (world,)."""
        self.last: Next | None = None
        """What worlds were sent to do in the last step."""
        self.chosen = ""
        """Of the last `decide`, for a figure or a test: which procedure in which world."""

    def __call__(self, belief: Belief) -> list[Probe]:
        """The probes of the next step that wants anything."""
        if self.parts is None:
            self.parts = self._parts(belief)
            self.crossing = np.zeros(belief.worlds, bool)
        while self.parts:
            name, poses = self.parts.pop(0)
            probes = self._probes(name, poses, belief)
            self._note(probes, belief)
            if any(p.wanted is None or p.wanted.any() for p in probes):
                return probes
        return []

    def _note(self, probes: list[Probe], belief: Belief) -> None:
        """Remember which worlds these send to faces, and which to a contour."""
        crossed, followed = np.zeros((2, belief.worlds), bool)
        for probe in probes:
            wanted = wanted_of(probe, belief.worlds, belief.hand).any(1)
            crossed |= wanted & isinstance(probe, CrossFaces)
            followed |= wanted & isinstance(probe, FollowContour)
        self.crossing |= crossed
        self.last = Next(crossed & ~followed, followed)  # a contour's end is crossed with it

    def _parts(self, belief: Belief) -> list[tuple[str, np.ndarray | None]]:
        """The order, each containment with its poses, cut where a fit is wanted between: after each
        pose where the budget looks at the volume."""
        strategy = self.strategy
        poses = self._poses(belief)
        times = max(strategy.order.count("containment"), 1)
        shares = iter(np.array_split(poses, times, axis=1))
        parts: list[tuple[str, np.ndarray | None]] = []
        for name in strategy.order:
            if name != "containment":
                parts.append((name, None))
                continue
            share = next(shares)
            every = 1 if strategy.volume_ratio is not None else max(share.shape[1], 1)
            step = strategy.refit_every or every
            parts += [("containment", share[:, k:k + step])
                      for k in range(0, share.shape[1], step)]
        return parts

    def _poses(self, belief: Belief) -> np.ndarray:
        """Hand poses of every world, (world, probe, 7)."""
        if not self.waypoints:
            return waypoint_poses(self.strategy.waypoints, belief.prior, belief.hand, belief.seed)
        ends = np.cumsum([count for _, count in self.waypoints])
        return np.concatenate([
            waypoint_poses(families, rows_of(belief.prior, slice(end - count, end)), belief.hand,
                           belief.seed[end - count:end])
            for (families, count), end in zip(self.waypoints, ends, strict=True)])

    def _probes(self, name: str, poses: np.ndarray | None, belief: Belief) -> list[Probe]:
        everywhere = np.ones(belief.worlds, bool)
        if name == "containment":
            assert poses is not None
            return [Grasp(poses)]
        if name == "planar":
            return [faces_to_cross(belief, self.planar, everywhere & belief.active)]
        if name == "contour":
            return [contour_to_follow(belief, self.contour, belief.active, self.seen)]
        blocky, round_ = decide(belief, self.decide_by, self.last)
        probes: list[Probe] = [
            faces_to_cross(belief, self.planar, blocky & belief.active),
            contour_to_follow(belief, self.contour, round_ & belief.active, self.seen)]
        if self.decide_by.ends:
            ended = belief.active & belief.fitted & ~self.crossing
            flat = round_ & ended & flat_topped(belief, self.decide_by)
            top = top_to_cross(belief, self.planar, flat)
            probes.append(CrossFaces(top.point_m, top.normal, top.wanted, top.options))
        return probes
