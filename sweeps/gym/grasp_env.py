"""Worlds in lock-step as a Gymnasium vector environment, and one world as a single one."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from fit.arrays import joined, rows_of
from strategies.exploration import RunningExploration
from strategies.planners.from_strategy import Budget
from strategies.poses.hand_outline import outline_of
from strategies.procedures.possible import fault_status
from sweeps.episode.episodes import place_objects
from sweeps.episode.given_prior import SEEN, draw_prior, seen_prior
from sweeps.episode.scores import SAMPLES, Scorer, Scores
from sweeps.gym.actions import PROCEDURES, action_size, probes_of
from sweeps.gym.observations import contact_slots, observation_bounds, observe
from sweeps.gym.settings import read_settings
from sweeps.output import devices
from warpgrasp.core.random import Purpose, counter_key, counter_uniform
from warpgrasp.robot import Robot, Truth

RENDER_MODES = ("rgb_array",)


class GraspVectorEnv(VectorEnv):
    """Worlds in lock-step, each with an object, a pose and noise of its own.

    An action is a row of numbers in [-1, 1] a world. The first four aim the hand at the prior:
    azimuth (half turns from the side that faces the robot), tilt (-1 from above, 1 from the side),
    roll (half turns) and the height aimed at (-1 its foot, 1 its top). With several `procedures`
    a fifth says which: its range is shared out among them in order. `containment` closes the hand
    there along every path of `closings`; `planar` crosses the face of the body believed that looks
    most that way; `contour` follows the contour about the body believed.

    An observation is a row of numbers a world: the prior (x, y, radius, height [m]; of a box half
    its length and width and the cosine and sine of twice its yaw, else 0); the body recovered (16,
    as in a sweep's rows); whether that is the prior, a superquadric or a surface of revolution;
    contacts, those of pads, and probes so far as shares of the most there can be; then all
    contacts so far, the earliest first: felt, by a pad, x, y, z [m] from the prior's foot, and 0
    where there is none yet. Numbers are within 10, but for a body's bend, within 100 per metre.

    The reward is by how many millimetres the chamfer distance of the recovered body falls. That
    body and its score are those of a sweep: the same probes with the same noise give the same row.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": list(RENDER_MODES),
        "render_fps": 2}

    def __init__(
        self, num_envs: int = 16, objects: Any = "block", probes: int = 8,
        procedures: Sequence[str] = ("containment",),
        closings: Sequence[str] = ("curl40", "base_then_curl"),
        settings: Mapping[str, Any] | None = None, render_mode: str | None = None,
        device: str = "cpu",
    ) -> None:
        """`objects` is one entry of a spec's `objects` or a list of them, of which every episode
        draws one: a name, or a table such as `{"mesh": "mug.stl", "units": "cm"}`. `settings` are
        a spec's tables, such as `{"sensors": {"tendon_threshold_N": 4}}`. `probes` are an
        episode's budget. Raises ValueError for what cannot be used.
        """
        for name, count in (("num_envs", num_envs), ("probes", probes)):
            if not _is_whole(count) or count < 1:
                raise ValueError(f"{name}: is {count!r}; should be a whole number from 1 on")
        if isinstance(procedures, str) or not procedures or not set(procedures) <= set(PROCEDURES):
            raise ValueError(f"procedures: are {procedures!r}; should be some of "
                             f"{', '.join(PROCEDURES)}")
        if isinstance(closings, str) or not closings:
            raise ValueError(f"closings: are {closings!r}; should be names such as "
                             "(\"curl40\",)")
        self._made_with = read_settings(objects, settings, procedures, closings)
        if render_mode not in (None, *RENDER_MODES):
            raise ValueError(f"render_mode: is {render_mode!r}; should be one of None, "
                             f"{', '.join(RENDER_MODES)}")
        if device not in (here := devices()):
            raise ValueError(f"device: there is no {device!r} here; there are: {', '.join(here)}")
        self.num_envs, self.render_mode = num_envs, render_mode
        self._probes, self._device = probes, device
        self._procedures, self._closings = tuple(procedures), tuple(closings)
        fingers = outline_of(self._made_with.cell.hand).fingers
        self._slots = contact_slots(self._procedures, len(self._closings), probes, fingers)
        bounds = observation_bounds(self._slots)
        self.single_observation_space = spaces.Box(-bounds, bounds, dtype=np.float64)
        self.single_action_space = spaces.Box(-1.0, 1.0, (action_size(self._procedures),),
                                              np.float64)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._begun = self._over = False
        self._each: list[np.random.Generator] = []  # of every world, where each has its own seed

    def reset(self, *, seed: int | Sequence[int | None] | None = None,
              options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """New objects, poses and noise, drawn from `seed` where it is given.

        With a seed for each world, a world is what it would be alone; one seed is that of the first
        world. There are no `options`: all worlds begin together, so that also `reset_mask` is
        refused. Raises ValueError for these, for seeds that are no whole numbers from 0 on, and
        where they are not as many as the worlds.
        """
        if options:
            raise ValueError(f"options: has {', '.join(map(str, options))}; should be left out: "
                             "there are none, and all worlds begin together")
        key = self._drawn_keys(seed)
        cell, bodies = self._made_with.cell, self._made_with.bodies
        draw = counter_uniform(counter_key(key, int(Purpose.OBJECT)))
        self._which = np.minimum((draw * len(bodies)).astype(int), len(bodies) - 1)
        self._truth = Truth(place_objects(cell.placement, key))
        robot = Robot(bodies, self._which, self._truth, key, cell.arm, cell.hand, cell.sensors,
                      pads=cell.pads, errors=cell.errors, contact=cell.contact, true=cell.true,
                      device=self._device)
        prior = self._merged([
            draw_prior(body, self._truth.body_pose[mine], cell.placement, key[mine])
            for body, mine in self._worlds_of()])
        self._unseen = np.full(self.num_envs, "", object)
        if cell.placement.prior in SEEN:
            prior, self._unseen = seen_prior(robot, prior, cell.stereo, cell.placement.prior)
        self._run = RunningExploration(
            robot, prior, counter_key(key, int(Purpose.STRATEGY)), cell.fit, self._closings,
            Budget(steps=None))
        self._made, self._begun, self._over = 0, True, False
        self._chamfer_mm = self._score()
        return self._observation(), self._info()

    def _worlds_of(self) -> list[tuple[Any, np.ndarray]]:
        """Each body that stands somewhere, with its worlds."""
        mine = [np.flatnonzero(self._which == n) for n in range(len(self._made_with.bodies))]
        return [(body, rows) for body, rows in zip(self._made_with.bodies, mine, strict=True)
                if len(rows)]

    def _merged(self, records: list[Any]) -> Any:
        """Records of the worlds of `_worlds_of`, joined in the order of the worlds."""
        order = np.concatenate([rows for _, rows in self._worlds_of()])
        return rows_of(joined(records), np.argsort(order))

    def _score(self) -> np.ndarray:
        """Chamfer distances of what is recovered [mm], (world,)."""
        samples = SAMPLES[self._made_with.cell.scores.samples]
        scores: Scores = self._merged([
            Scorer([body], np.zeros(len(rows), int), self._truth.body_pose[rows],
                   self._device, samples).score(rows_of(self._run.recovered, rows))
            for body, rows in self._worlds_of()])
        return scores.chamfer_m * 1e3

    def _drawn_keys(self, seed: int | Sequence[int | None] | None) -> np.ndarray:
        """Every world's key: all of one generator, or of each world's own."""
        if isinstance(seed, Sequence | np.ndarray):
            if len(seed) != self.num_envs:
                raise ValueError(f"seed: {len(seed)} seeds; should be one number, or one for each "
                                 f"of {self.num_envs} worlds")
            self._each = [np_random(_checked_seed(one))[0] for one in seed]
        elif seed is not None:
            super().reset(seed=_checked_seed(seed))
            self._each = []
        generators = self._each or [self.np_random]
        worlds = np.arange(self.num_envs // len(generators))
        return np.concatenate([counter_key(int(generator.integers(2**62)), 0, worlds)
                               for generator in generators])

    def step(self, actions: np.ndarray) -> tuple[
            np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One more probe in every world; after the last of the budget, the next step resets.

        Actions beyond [-1, 1] are cut to it. Raises ValueError for those of another shape, or that
        are not finite, ResetNeeded before the first reset.
        """
        if not self._begun:
            raise ResetNeeded("step: the episode has not begun; call reset first")
        actions = np.asarray(actions, float)
        shape = self.action_space.shape
        if actions.shape != shape or not np.isfinite(actions).all():
            raise ValueError(f"actions: shape {actions.shape}; should be finite numbers of shape "
                             f"{shape}")
        nothing = np.zeros(self.num_envs, bool)
        if self._over:
            observation, info = self.reset()
            return observation, np.zeros(self.num_envs), nothing, nothing.copy(), info
        before = self._chamfer_mm
        self._run.take_step(lambda belief: probes_of(
            actions, self._procedures, belief, self._made_with.cell))
        self._made += 1
        self._over = self._made >= self._probes
        if self._over:
            self._run.finish()
        self._chamfer_mm = self._score()
        return (self._observation(), before - self._chamfer_mm, nothing,
                np.full(self.num_envs, self._over), self._info())

    def render(self) -> tuple[Any, ...] | None:
        """A picture of every world, uint8 (row, column, 3) each; None without a render mode."""
        if self.render_mode is None:
            return None
        if not self._begun:
            raise ResetNeeded("render: the episode has not begun; call reset first")
        from sweeps.gym.pictures import picture

        return tuple(picture(self._run.belief, self._run.recovered,
                             self._made_with.bodies[self._which[world]], self._truth.body_pose,
                             world) for world in range(self.num_envs))

    def _observation(self) -> np.ndarray:
        return observe(self._run.belief, self._run.recovered, self._made / self._probes,
                       self._slots)

    def _info(self) -> dict[str, Any]:
        """What only the one who scores knows, how each episode stands as in a sweep's row, and what
        is at fault where it failed."""
        names = np.array(self._made_with.names, object)[self._which]
        fault = np.where(self._unseen != "", self._unseen, self._run.fault)
        status = np.where(fault != "", fault_status(fault), self._run.status())
        known = {"chamfer_mm": self._chamfer_mm.copy(), "object": names,
                 "status": status, "note": fault, "touches": self._run.belief.touches.copy(),
                 "robot_time_s": self._run.belief.time_s.copy()}
        return known | {f"_{name}": np.ones(self.num_envs, bool) for name in known}


class GraspEnv(gymnasium.Env):
    """One world of `GraspVectorEnv`, for what wants a single environment."""

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": list(RENDER_MODES), "render_fps": 2}

    def __init__(self, render_mode: str | None = None, **settings: Any) -> None:
        """`settings` as of `GraspVectorEnv`, without `num_envs`."""
        self._many = GraspVectorEnv(1, render_mode=render_mode, **settings)
        self.render_mode = render_mode
        self.observation_space = self._many.single_observation_space
        self.action_space = self._many.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[
            np.ndarray, dict[str, Any]]:
        """As of `GraspVectorEnv`, of its one world: with a seed the first of any number of worlds
        that have this seed."""
        super().reset(seed=_checked_seed(seed))
        observation, info = self._many.reset(seed=seed, options=options)
        return observation[0], _alone(info)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """As of `GraspVectorEnv`, of its one world; reset it after the end."""
        observation, reward, _, over, info = self._many.step(np.asarray(action, float)[None])
        return observation[0], float(reward[0]), False, bool(over[0]), _alone(info)

    def render(self) -> Any:
        """The picture of its one world, or None."""
        drawn = self._many.render()
        return None if drawn is None else drawn[0]


def _is_whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _checked_seed(seed: Any) -> int | None:
    if seed is not None and (not _is_whole(seed) or seed < 0):
        raise ValueError(f"seed: is {seed!r}; should be a whole number from 0 on")
    return None if seed is None else int(seed)


def _alone(info: dict[str, Any]) -> dict[str, Any]:
    return {name: values[0].item() if isinstance(values[0], np.generic) else values[0]
            for name, values in info.items() if not name.startswith("_")}


gymnasium.register("warpgrasp/Grasp-v0", entry_point=GraspEnv,
                   vector_entry_point=GraspVectorEnv)  # type: ignore
