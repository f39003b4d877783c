"""Exploration by grasping as a Gymnasium vector environment, for learning where to touch next.

An action is the next hand pose of every world; the reward is by how many millimetres the error of
the shape believed falls. An extra: `pip install 'warpgrasp[gym]'`. Importing this module registers
`warpgrasp/Grasp-v0` for `gymnasium.make_vec` and, one world at a time, `gymnasium.make`.
"""

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from fit.fit_status import FitStatus
from strategies.poses.closing_paths import CLOSING_PATHS
from strategies.poses.hand_poses import pose_about
from strategies.poses.waypoints import Placement
from strategies.procedures.containment import explore_by_containment
from strategies.recovery.choose_model import or_prior, prior_superquadric
from strategies.recovery.evidence import (
    Evidence,
    TouchedLinks,
    evidence_from_grasps,
    joined_evidence,
    joined_links,
    touched_links,
)
from strategies.recovery.fit_contacts import recover_bodies
from strategies.recovery.plausibility import FEWEST_CONTACTS, plausible
from sweeps.episode.columns import superquadric_parameters
from sweeps.episode.episodes import place_objects
from sweeps.episode.given_prior import draw_prior
from sweeps.episode.scores import score_superquadrics
from warpgrasp.core.random import counter_key
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, FitTable, HandTable, ObjectTable, SensorTable
from warpgrasp.robot import Grasps, Robot, Truth

PARAMETERS = 16
BOUND = 10.0


class GraspVectorEnv(VectorEnv):
    """Worlds in lock-step, each with its own pose and noise of one object.

    An action, shape (world, 4) in [-1, 1], aims the hand at the prior cylinder: azimuth (half turns
    from the side that faces the robot), tilt (-1 from above, 1 from the side), roll (half turns)
    and the height aimed at (-1 its foot, 1 its top). The hand then closes along every path of
    `closings`. An observation holds the prior cylinder (4: x, y, radius, height [m]), the body
    believed (16, as in a sweep's rows), contacts and probes so far as shares, and the last probe's
    contacts in the prior cylinder's frame, (path, finger) x (felt, x, y, z [m]).
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}

    def __init__(self, num_envs: int = 16, object_name: str = "block", probes: int = 8,
                 closings: tuple[str, ...] = ("curl40", "base_then_curl"),
                 device: str = "cpu") -> None:
        """`probes` are an episode's budget. Raises BodyError for an unknown object, ValueError for
        another argument that cannot be used.
        """
        for name, count in (("num_envs", num_envs), ("probes", probes)):
            if not isinstance(count, int | np.integer) or count < 1:
                raise ValueError(f"{name}: is {count!r}; should be a whole number from 1 on")
        if not closings or not set(closings) <= set(CLOSING_PATHS):
            raise ValueError(f"closings: are {closings!r}; should be some of "
                             f"{', '.join(CLOSING_PATHS)}")
        self.num_envs = num_envs
        self.render_mode = None
        self._body = body_from_name(object_name)
        self._probes, self._closings, self._device = probes, closings, device
        size = 4 + PARAMETERS + 2 + 4 * 4 * len(closings)
        self.single_observation_space = spaces.Box(-BOUND, BOUND, (size,), np.float64)
        self.single_action_space = spaces.Box(-1.0, 1.0, (4,), np.float64)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._over = False
        self._each: list[np.random.Generator] = []  # of every world, where each has its own seed

    def reset(self, *, seed: int | Sequence[int | None] | None = None,
              options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """New objects' poses and noise, drawn from `seed` where it is given.

        With a seed for each world, a world is what it would be alone. Raises ValueError where they
        are not as many as the worlds.
        """
        key = self._drawn_keys(seed)
        pose = place_objects(ObjectTable(), key)
        self._prior = draw_prior(self._body, pose, ObjectTable(), key)
        self._robot = Robot([self._body], np.zeros(1, int), Truth(pose), key, ArmTable(),
                            HandTable(), SensorTable(), device=self._device)
        self._pose, self._made, self._over = pose, 0, False
        self._evidence: Evidence | None = None
        self._links: TouchedLinks | None = None
        self._last = np.zeros((self.num_envs, 4 * 4 * len(self._closings)))
        self._believe()
        return self._observation(), self._info()

    def _drawn_keys(self, seed: int | Sequence[int | None] | None) -> np.ndarray:
        """Every world's key: all of one generator, or of each world's own."""
        if isinstance(seed, Sequence | np.ndarray):
            if len(seed) != self.num_envs:
                raise ValueError(f"seed: {len(seed)} seeds; should be one number, or one for each "
                                 f"of {self.num_envs} worlds")
            self._each = [np_random(None if one is None else int(one))[0] for one in seed]
        elif seed is not None:
            super().reset(seed=seed)
            self._each = []
        generators = self._each or [self.np_random]
        worlds = np.arange(self.num_envs // len(generators))
        return np.concatenate([counter_key(int(generator.integers(2**62)), 0, worlds)
                               for generator in generators])

    def step(self, actions: np.ndarray) -> tuple[
            np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One more grasp in every world; after the last of the budget, the next step resets.

        Actions beyond [-1, 1] are cut to it. Raises ValueError for those of another shape, or that
        are not finite.
        """
        actions = np.asarray(actions, float)
        if actions.shape != (self.num_envs, 4) or not np.isfinite(actions).all():
            raise ValueError(f"actions: shape {actions.shape}; should be finite numbers of shape "
                             f"({self.num_envs}, 4)")
        nothing = np.zeros(self.num_envs, bool)
        if self._over:
            observation, info = self.reset()
            return observation, np.zeros(self.num_envs), nothing, nothing.copy(), info
        before = self._error_mm
        grasps = explore_by_containment(
            self._robot, self._pose_of(actions),
            np.ones((self.num_envs, 1), bool), self._closings)
        self._gather(grasps)
        self._made += 1
        self._believe()
        self._over = self._made >= self._probes
        return (self._observation(), before - self._error_mm, nothing,
                np.full(self.num_envs, self._over), self._info())

    def _pose_of(self, actions: np.ndarray) -> np.ndarray:
        a = np.clip(actions, -1.0, 1.0)
        usual = Placement()
        return pose_about(
            self._prior, np.pi * a[:, :1], np.pi / 4 * (a[:, 1:2] + 1), np.pi * a[:, 2:3],
            (a[:, 3:4] + 1) / 2, 0.0, usual.palm_clearance_m, usual.clearance_per_radius,
            HandTable())

    def _gather(self, grasps: Grasps) -> None:
        radius = HandTable().link_radius_m
        new, links = evidence_from_grasps(grasps, radius), touched_links(grasps, radius)
        self._evidence = new if self._evidence is None else joined_evidence(self._evidence, new)
        self._links = links if self._links is None else joined_links(self._links, links)
        prior = np.stack([self._prior.x_m, self._prior.y_m, np.zeros(self.num_envs)], axis=1)
        points = np.where(new.mask[..., None], new.points_m - prior[:, None], 0.0)
        self._last = np.concatenate([new.mask[..., None], points], axis=-1).reshape(
            self.num_envs, -1)

    def _believe(self) -> None:
        """The body believed from all contacts, and its error, which only the reward contains."""
        if self._evidence is None:
            self._recovered = prior_superquadric(self._prior)
        else:
            fits, placed = recover_bodies(self._evidence, self._links, FitTable())
            good = ((placed.mask.sum(axis=1) >= FEWEST_CONTACTS)
                    & np.isin(fits.status, (FitStatus.converged, FitStatus.not_converged))
                    & plausible(fits, self._prior))
            self._recovered = or_prior(fits, self._prior, good)
        scores = score_superquadrics(self._recovered, self._body, self._pose, device=self._device)
        self._error_mm = scores.chamfer_m * 1e3

    def _observation(self) -> np.ndarray:
        prior, felt = self._prior, self._evidence
        slots = 4 * len(self._closings) * self._probes
        count = np.zeros(self.num_envs) if felt is None else felt.mask.sum(axis=1) / slots
        parts = [np.stack([prior.x_m, prior.y_m, prior.radius_m, prior.height_m], axis=1),
                 np.stack(list(superquadric_parameters(self._recovered).values()), axis=1),
                 np.stack([count, np.full(self.num_envs, self._made / self._probes)], axis=1),
                 self._last]
        return np.clip(np.concatenate(parts, axis=1), -BOUND, BOUND)

    def _info(self) -> dict[str, Any]:
        return {"chamfer_mm": self._error_mm.copy(), "_chamfer_mm": np.ones(self.num_envs, bool)}


class GraspEnv(gymnasium.Env):
    """One world of `GraspVectorEnv`, for what wants a single environment."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # type: ignore[misc]

    def __init__(self, **settings: Any) -> None:
        """`settings` as of `GraspVectorEnv`, without `num_envs`."""
        self._many = GraspVectorEnv(1, **settings)
        self.observation_space = self._many.single_observation_space
        self.action_space = self._many.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[
            np.ndarray, dict[str, Any]]:
        """As of `GraspVectorEnv`, of its one world."""
        super().reset(seed=seed)
        observation, info = self._many.reset(seed=int(self.np_random.integers(2**62)))
        return observation[0], {"chamfer_mm": float(info["chamfer_mm"][0])}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """As of `GraspVectorEnv`, of its one world; reset it after the end."""
        observation, reward, _, over, info = self._many.step(np.asarray(action, float)[None])
        return (observation[0], float(reward[0]), False, bool(over[0]),
                {"chamfer_mm": float(info["chamfer_mm"][0])})


gymnasium.register("warpgrasp/Grasp-v0", entry_point=GraspEnv,
                   vector_entry_point=GraspVectorEnv)  # type: ignore
