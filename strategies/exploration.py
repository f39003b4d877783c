"""The loop of an episode, for a whole batch: ask the planner, probe, gather evidence, fit.

    belief → strategy → probes → guarded moves → evidence → fits → belief → ...

until the strategy asks for no more probes or the budget or the number of steps is used up. A
strategy that fails (raises, answers with the wrong shape, with NaN, or with a pose through the
table) ends the episode in the worlds concerned; earlier contacts still count.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from fit.arrays import row_sums, rows_of, with_rows
from fit.fit_status import is_fitted
from fit.superquadric.record import SuperquadricFit
from strategies.contacts.finger_touch import TouchedLinks, joined_links, no_links, touched_links
from strategies.exploration_record import Exploration, Procedure
from strategies.planners.from_strategy import Budget, within_budget
from strategies.planners.guarded_call import guarded_call
from strategies.planners.probes import (
    CrossFaces,
    FollowContour,
    Grasp,
    Probe,
    listed,
    misfits,
    wanted_of,
)
from strategies.planners.register import Foreseeing, Planner, fault_text, place_of
from strategies.poses.hand_outline import outline_of
from strategies.poses.waypoints import BoundingCylinder, check_prior
from strategies.procedures.containment import check_closings, explore_by_containment
from strategies.procedures.contour_follower import explore_contour
from strategies.procedures.contour_record import ContourExploration
from strategies.procedures.contour_shape import Profile, later_profile, profile_of, with_profiles
from strategies.procedures.planar_explorer import explore_plane
from strategies.procedures.planar_faces import Face, planes_of
from strategies.procedures.planar_record import PlanarExploration
from strategies.procedures.possible import NotPossible, check_possible, fault_status
from strategies.recovery.belief import Belief, read_only
from strategies.recovery.choose_model import (
    Recovered,
    Shape,
    choose_body,
    or_prior,
    revolution_of,
)
from strategies.recovery.complete_contour import whole_profile
from strategies.recovery.contact_verdict import refuted
from strategies.recovery.evidence import (
    CONTOUR_TOUCHES,
    FACE_TOUCHES,
    Evidence,
    evidence_from_grasps,
    evidence_from_touches,
    joined_evidence,
    no_evidence,
)
from strategies.recovery.misfit import UNBELIEVED_M, touch_misfit
from strategies.recovery.plausibility import (
    FEWEST_CONTACTS,
    plausible,
    swept,
    within_reach,
)
from strategies.recovery.refit_policy import finished, newly_felt, refitted, straightened, unfitted
from warpgrasp.core.array_checks import check_array
from warpgrasp.motion_cost import was_made
from warpgrasp.parameters import FitTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Grasps, Robot

_ROUNDED = 1e-9
"""By which the length of a quaternion may be off 1."""
_SAFE_POSE = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
_BY_WORLD = ("prior", "seed", "felt", "links", "news", "active", "faulty", "ended", "steps",
             "stopped", "fault", "faces", "profile", "whole", "touches", "time", "path", "fitted",
             "shape", "believed", "agrees")


def explore(
    robot: Robot, planner: Planner, prior: BoundingCylinder, seed: np.ndarray, *, table: FitTable,
    closings: tuple[str, ...], budget: Budget | None = None,
    observe: Callable[[Belief, Recovered], None] | None = None, oracle: Foreseeing | None = None,
    fits_on_way: bool = True,
) -> Exploration:
    """Run one episode in every world.

    `seed` (world,) uint64 is the strategy's own; `table` says what the fits go by; `closings` are
    the paths of grasps that name none. `observe` is shown the belief after every fit. `oracle` is
    the planner, if it is one that may foresee: what it is handed leads to the truth. Without
    `fits_on_way` bodies are fitted after the first step and at the end.

    Raises TypeError for a planner that cannot be called and for seeds that are no whole numbers,
    ValueError for priors and seeds that are not one a world, for priors that are not finite or have
    sizes of 0 or less, and for closing paths that the hand has not."""
    if not callable(planner):
        raise TypeError(f"planner: is {type(planner).__name__}; should be a function of a Belief, "
                        "such as `planner_of` makes of a Strategy")
    check_array("seed", seed, "whole numbers", "world", world=robot.worlds)
    check_array("prior.x_m", prior.x_m, "numbers", "world", world=robot.worlds)
    check_prior(prior)
    check_closings(closings, robot.hand)
    run = RunningExploration(robot, prior, seed, table, closings, budget or Budget(), fits_on_way)
    if oracle is not None:
        oracle.foresee = run.imagine
    while run.active.any():
        before = run.step
        if not run.take_step(planner):
            break
        if observe is not None and run.step > before and not run.news:
            observe(run.belief, run.recovered)
    if run.finish() and observe is not None:
        observe(run.belief, run.recovered)
    return run.result()


class RunningExploration:
    """An episode of each world under way, taken step by step.

    `belief` is what the robot believes, `recovered` what would be scored if it ended now.
    """

    def __init__(self, robot: Robot, prior: BoundingCylinder, seed: np.ndarray, table: FitTable,
                 closings: tuple[str, ...], budget: Budget, fits_on_way: bool = True) -> None:
        worlds = robot.worlds
        self.robot, self.prior, self.seed, self.table = robot, prior, seed, table
        self.closings, self.budget, self.fits_on_way = closings, budget, fits_on_way
        radius = outline_of(robot.hand).skin_m
        self.intrinsic = robot.sensors.contact_estimator == "intrinsic"
        self.felt = no_evidence(worlds, radius)
        self.links = no_links(worlds, 0, robot.hand)
        self.news: tuple[tuple[Evidence, TouchedLinks], ...] = ()  # felt since the last fit
        self.slots = 0
        self.contour = np.zeros(0, int)  # slots of touches along a contour
        self.procedures: list[Procedure] = []
        self.closings_made = self.step = 0
        self.active = np.ones(worlds, bool)
        self.faulty, self.ended = np.zeros(worlds, bool), np.zeros(worlds, bool)
        self.steps, self.stopped = np.zeros(worlds, int), np.zeros(worlds, bool)
        self.fault = np.full(worlds, "", object)
        self.faces: tuple[Face, ...] = ()
        self.profile: Profile | None = None  # as followed
        self.whole: Profile | None = None  # and completed by all else that was felt
        self.touches, self.shape = np.zeros(worlds, int), np.zeros(worlds, int)
        self.time, self.path = np.zeros(worlds), np.zeros(worlds)
        self.fitted = unfitted(self.felt)
        self.believed = self.agrees = np.zeros(worlds, bool)
        """Worlds whose fit is good enough to go on by, and those whose body nothing contradicts."""
        self._conclude(np.arange(worlds))

    def take_step(self, planner: Planner) -> bool:
        """Ask once and carry out the answer; False if no probe of it can be made."""
        try:
            with guarded_call():
                probes = listed(planner(self.belief))
            wanted = [wanted_of(probe, self.robot.worlds, self.robot.hand) for probe in probes]
        except NotPossible as error:
            self._blame(np.ones(self.robot.worlds, bool), str(error))
            return False
        except Exception as error:  # whatever a user's strategy may raise
            self.ended |= self.active
            self._blame(np.ones(self.robot.worlds, bool), fault_text(planner, error))
            return False
        stopped = np.zeros(self.robot.worlds, bool)
        if self.budget.steps is not None:
            spent = self.active & (self.steps >= self.budget.steps)
            for mask in wanted:
                stopped |= spent & mask.any(1)
            self.stopped |= stopped
            self.active &= ~stopped
        changed = np.zeros(self.robot.worlds, bool)
        for probe, mask in zip(probes, wanted, strict=True):
            mask = self._sound(probe, mask & self.active[:, None], planner)
            if not mask.any() or not self._possible(probe, mask):
                continue
            changed |= mask.any(1)
            if isinstance(probe, Grasp):
                self._grasp(probe, mask)
            elif isinstance(probe, CrossFaces):
                self._cross(probe, mask)
            else:
                self._follow(probe, mask[:, 0])
        if changed.any():
            self.step += 1
            self.steps += changed
            if self.fits_on_way or self.step == 1:
                self._refit(np.flatnonzero(changed))
            else:
                self.belief = read_only(replace(self.belief, step=self.step, **self._spent()))
            self.active &= within_budget(self.budget, self.belief)
            self.belief = self.belief.with_active(read_only(self.active.copy()))
        return bool((changed | stopped).any())

    def finish(self) -> bool:
        """Fit from new starts what was refined since, or never fitted; False if there is none."""
        late = len(self.news) > 0
        if late:
            self._refit(np.arange(self.robot.worlds))
        links = self.links if self.intrinsic else None
        self.fitted, rows = finished(self.fitted, self.felt, links, self.table)
        self._conclude(rows)
        self.fitted, more = straightened(self.fitted, self.felt, links, self.prior,
                                         self.recovered.shape == Shape.PRIOR, self.table)
        self._conclude(more)
        return late or len(rows) + len(more) > 0

    def result(self) -> Exploration:
        """The episodes as far as they have come."""
        return Exploration(tuple(self.procedures), self.belief, self.recovered, self.status(),
                           self.fault, self.stopped, self.felt, self.ended)

    def imagine(self, probe: Grasp, rows: np.ndarray) -> Recovered:
        """What would be recovered in the worlds `rows` (row,), which may name a world more than
        once, each after a grasp of its own, noise and all; nothing of it is kept."""
        copied = copy(self)
        for name in _BY_WORLD:
            setattr(copied, name, rows_of(getattr(self, name), rows))
        copied.robot, copied.procedures = self.robot.rehearsing(rows), []
        mask = wanted_of(probe, len(rows), self.robot.hand) & copied.active[:, None]
        copied._grasp(probe, mask)
        # As of the step it would be: that says which bodies get new starts.
        copied.step, copied.steps = self.step + 1, copied.steps + mask.any(1)
        copied._refit(np.flatnonzero(mask.any(1)))
        return copied.recovered

    def _sound(self, probe: Probe, mask: np.ndarray, planner: Planner) -> np.ndarray:
        """The probes that can be made; a world asked for one that cannot is done."""
        for found, what in misfits(probe):
            found = np.asarray(found & mask)
            for world in np.flatnonzero(found.any(1)):
                number, shown = int(found[world].argmax()), ""
                if isinstance(probe, Grasp):
                    shown = ": " + np.array2string(np.asarray(probe.hand_pose)[world, number],
                                                   precision=3, max_line_width=400)
                # Without the world's number: a row may be run beside others, or alone.
                self._blame(np.arange(len(mask)) == world,
                            f"{place_of(planner)}: {what}: probe {number}{shown}")
            mask = mask & ~np.asarray(found.any(1))[:, None]
        return mask

    def _possible(self, probe: Probe, mask: np.ndarray) -> bool:
        """Whether the hand can do it; worlds that ask for what it cannot are done."""
        if isinstance(probe, Grasp):
            return True
        try:
            check_possible("planar" if isinstance(probe, CrossFaces) else "contour",
                           self.robot.hand, self.robot.pads)
        except NotPossible as error:
            self._blame(np.asarray(mask.any(1)), str(error))
            return False
        return True

    def _blame(self, worlds: np.ndarray, text: str) -> None:
        at_fault = worlds & self.active
        self.fault[at_fault] = text
        self.faulty |= at_fault
        self.active &= ~worlds

    def _grasp(self, probe: Grasp, mask: np.ndarray) -> None:
        pose = np.where(mask[..., None], np.asarray(probe.hand_pose, float), _SAFE_POSE)
        # Rounded quaternions turn as their numbers say; the others keep their bits.
        length = np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
        pose[..., 3:] /= np.where(np.abs(length - 1.0) > _ROUNDED, length, 1.0)
        closings, room = probe.closings or self.closings, self._touches_left()
        if self.budget.robot_time_s is not None and self.budget.time_each_pose:
            # Poses that would begin too late are known once all were tried on a copy.
            time_s = _time_of(explore_by_containment(self.robot.rehearsing(), pose, mask, closings,
                                                     room, probe.fingers))
            mask = mask & (self.time[:, None] + np.cumsum(time_s, axis=1) - time_s
                           < self.budget.robot_time_s)
        grasps = explore_by_containment(self.robot, pose, mask, closings, room, probe.fingers)
        mask = grasps.moves.status[:, :, 0] != ProbeStatus.NOT_TRIED
        radius = outline_of(self.robot.hand).skin_m
        links = touched_links(grasps, self.robot.hand, self.robot.contact)
        evidence = evidence_from_grasps(grasps, radius)
        self._add(evidence, links)
        self.touches += was_made(grasps.closing.status).sum((1, 2, 3))
        self.time += row_sums(_time_of(grasps))
        self.path += row_sums(np.where(mask, grasps.moves.path_m, 0.0))
        self.procedures.append(Procedure("containment", self.step, grasps, np.asarray(mask.any(1)),
                                         evidence.mask.shape[1], self.closings_made, pose))
        self.closings_made += 1

    def _touches_left(self) -> np.ndarray | None:
        """How many more touches the budget allows, (world,); None where it does not say."""
        return None if self.budget.touches is None else self.budget.touches - self.touches

    def _cross(self, probe: CrossFaces, mask: np.ndarray) -> None:
        point, normal = np.asarray(probe.point_m, float), np.asarray(probe.normal, float)
        for face in range(mask.shape[1]):
            if not mask[:, face].any():
                continue
            found = explore_plane(self.robot, point[:, face], normal[:, face],
                                  wanted=mask[:, face], options=probe.options)
            self._touched("planar", found, mask[:, face], FACE_TOUCHES)
            self.faces = *self.faces, planes_of(found)

    def _follow(self, probe: FollowContour, wanted: np.ndarray) -> None:
        found = explore_contour(self.robot, probe.axis, wanted=wanted, options=probe.options)
        own = np.arange(self.slots, self.slots + CONTOUR_TOUCHES)
        self._touched("contour", found, wanted, CONTOUR_TOUCHES)
        self.contour = np.concatenate([self.contour, own])
        profile = profile_of(found, refine=probe.refine)
        self.profile = profile if self.profile is None else later_profile(self.profile, profile)

    def _touched(self, name: str, found: PlanarExploration | ContourExploration,
                 wanted: np.ndarray, slots: int) -> None:
        worlds = self.robot.worlds
        missed = found.missed if self.table.free_tips else None
        self._add(*evidence_from_touches(found.touches, missed, worlds, slots, self.felt,
                                         self.robot.hand))
        self.touches += found.touch_count
        self.time += found.time_s
        self.path += found.path_m
        self.procedures.append(Procedure(name, self.step, found, wanted, slots))

    def _add(self, evidence: Evidence, links: TouchedLinks) -> None:
        self.news = *self.news, (evidence, links)
        self.slots += evidence.mask.shape[1]

    def _refit(self, rows: np.ndarray) -> None:
        """Bodies of those of the worlds `rows` that felt something new, and what is concluded."""
        self.felt = joined_evidence(self.felt, *(evidence for evidence, _ in self.news))
        self.links = joined_links(self.links, *(links for _, links in self.news))
        new = newly_felt([evidence for evidence, _ in self.news], self.robot.worlds)
        self.news = ()
        links = self.links if self.intrinsic else None
        self.fitted = refitted(self.fitted, self.felt, links, rows[new[rows]], self.steps,
                               self.believed, self.profile, self.table)
        self._conclude(rows)

    @property
    def fits(self) -> SuperquadricFit:
        """The superquadrics last fitted."""
        return self.fitted.fits

    def _conclude(self, rows: np.ndarray) -> None:
        """What is believed now; only `rows` felt something new, the others' bodies stay."""
        if len(rows) == 0:
            return
        placed, prior = rows_of(self.fitted.placed, rows), rows_of(self.prior, rows)
        near = touch_misfit(self.fits[rows], placed) < UNBELIEVED_M
        fitted = ((placed.mask.sum(1) >= FEWEST_CONTACTS) & near
                  & within_reach(self.fits[rows], prior))
        body = or_prior(self.fits[rows], prior, fitted)
        profile = None
        if self.profile is not None:
            profile = whole_profile(rows_of(self.profile, rows), placed, self.contour, prior)
            before = self.profile if self.whole is None else self.whole
            self.whole = with_profiles(before, rows, profile)
        all_felt = replace(placed, free_m=self.felt.free_m[rows],
                           free_mask=self.felt.free_mask[rows])
        chosen = choose_body(fitted, body, profile, all_felt, self.contour, prior, self.table)
        self.shape = with_rows(self.shape, rows, chosen.shape)
        # What is contradicted may lead to where it is felt to be wrong, but it is no result.
        # Evidence that the fit may not use is not used to judge it either.
        agrees = (plausible(body, prior, table_plane=self.table.table_plane)
                  & ~refuted(chosen, placed))
        if self.table.free_space:
            agrees &= ~swept(body, all_felt)
        self.believed = with_rows(self.believed, rows, fitted)
        self.agrees = with_rows(self.agrees, rows, agrees)
        whole = or_prior(self.fits, self.prior, self.believed)
        turned = None if self.whole is None else revolution_of(self.whole)
        denied = (self.shape == Shape.SUPERQUADRIC) & ~self.agrees
        self.recovered = Recovered(
            np.where(denied, Shape.PRIOR, self.shape),
            or_prior(whole, self.prior, ~denied), turned)
        self.belief = read_only(Belief(
            self.step, self.active.copy(), self.prior, self.seed, self.robot.arm,
            self.robot.hand, self.robot.sensors, self.closings, self.fitted.placed, self.fits,
            self.believed, whole, self.faces, self.whole, self.shape, links=self.links,
            errors=self.robot.errors, fit=self.table, unplaced=self.felt, **self._spent()))

    def _spent(self) -> dict[str, Any]:
        """What the belief says of touches, time and path."""
        return {"touches": self.touches.copy(), "time_s": self.time.copy(),
                "path_m": self.path.copy(), "touches_left": self._touches_left()}

    def status(self) -> np.ndarray:
        """How each world ended."""
        known = self.recovered.shape > 0
        enough = self.fitted.placed.mask.sum(1) >= FEWEST_CONTACTS
        good = is_fitted(self.fits.status)
        return np.where(self.faulty, fault_status(self.fault), np.where(
            known, "ok", np.where(~enough, "too_few_contacts", np.where(
                good, "fit_implausible", "fit_failed"))))


def _time_of(grasps: Grasps) -> np.ndarray:
    """Time of each hand pose, 0 where it was not tried, (world, probe) [s]."""
    return np.where(grasps.moves.status[:, :, 0] != ProbeStatus.NOT_TRIED, grasps.time_s, 0.0)
