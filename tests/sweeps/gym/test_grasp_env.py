"""The environment against Gymnasium's own checks. It has one for single environments only; what a
vector environment promises beside that is checked here from its documentation."""

import runpy
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from places import ROOT

from fit.superquadric.geometry import Superquadric
from strategies.planners.probes import Probe
from strategies.planners.register import planner
from strategies.poses.hand_outline import outline_of
from strategies.poses.waypoints import BoundingBox
from strategies.recovery.belief import Belief
from strategies.recovery.misfit import touch_misfit
from strategies.strategy import Strategy
from sweeps.episode.columns import model_columns
from sweeps.episode.episodes import run_episodes
from sweeps.spec.cell import Cell
from warpgrasp.core.random import counter_key
from warpgrasp.parameters import ContactTable, ErrorTable, ScoreTable, SensorTable

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector.utils import batch_space  # noqa: E402
from gymnasium.wrappers.vector import RecordEpisodeStatistics  # noqa: E402

from sweeps.gym import GraspEnv, GraspVectorEnv  # noqa: E402
from sweeps.gym.actions import probes_of  # noqa: E402
from sweeps.gym.observations import observe  # noqa: E402

Rows = dict[str, np.ndarray]


def test_one_world_passes_gymnasiums_check() -> None:
    check_env(gymnasium.make("warpgrasp/Grasp-v0", probes=2, closings=("curl40",)).unwrapped)


def test_many_worlds_keep_the_vector_contract() -> None:
    worlds = gymnasium.make_vec("warpgrasp/Grasp-v0", num_envs=3, probes=2, closings=("curl40",))
    assert worlds.observation_space == batch_space(worlds.single_observation_space, 3)
    assert worlds.action_space == batch_space(worlds.single_action_space, 3)
    counted = RecordEpisodeStatistics(worlds)
    first, info = counted.reset(seed=5)
    prior = info["chamfer_mm"]
    assert first in worlds.observation_space
    worlds.action_space.seed(2)
    actions = [worlds.action_space.sample() for _ in range(2)]
    seen, total = [], np.zeros(3)
    for number, action in enumerate(actions):
        observation, reward, terminated, truncated, info = counted.step(action)
        assert observation in worlds.observation_space
        assert reward.shape == terminated.shape == truncated.shape == (3,)
        assert (terminated.dtype, truncated.dtype) == (bool, bool)
        assert not terminated.any()
        assert truncated.all() == truncated.any() == (number == 1)
        seen.append(observation.copy())
        total += reward
    assert total == pytest.approx(prior - info["chamfer_mm"])  # rewards are the error's reduction
    assert info["episode"]["r"] == pytest.approx(total)
    fresh, reward, _, truncated, _ = counted.step(actions[0])  # the next step resets
    assert not reward.any()
    assert not truncated.any()
    assert (fresh != first).any()
    again, _ = worlds.reset(seed=5)
    assert (again == first).all()
    for action, before in zip(actions, seen, strict=True):
        assert (worlds.step(action)[0] == before).all()


def test_a_body_that_bends_within_ten_centimetres_is_told_as_it_is() -> None:
    """Its curvature was cut to 10 per metre, as other numbers are."""
    world = GraspVectorEnv(1, probes=1, closings=("curl40",))
    plain, _ = world.reset(seed=1)
    body = world._run.recovered.superquadric
    bent = body._replace(bend=np.array([[40.0, 0.5]])) if isinstance(body, Superquadric) else (
        replace(body, bend=np.array([[40.0, 0.5]])))
    seen = observe(world._run.belief, replace(world._run.recovered, superquadric=bent), 0.0,
                   world._slots)
    changed = np.flatnonzero(seen[0] != plain[0])
    assert seen[0, changed].tolist() == [40.0, 0.5]
    assert world.single_observation_space.contains(seen[0])


def test_worlds_do_not_depend_on_their_neighbours() -> None:
    """The first two of four worlds are those of two."""
    few, many = (GraspVectorEnv(n, probes=1, closings=("curl40",)) for n in (2, 4))
    action = np.random.default_rng(1).uniform(-1, 1, (4, 4))
    assert (few.reset(seed=3)[0] == many.reset(seed=3)[0][:2]).all()
    assert (few.step(action[:2])[0] == many.step(action)[0][:2]).all()


def test_a_world_with_a_seed_of_its_own_is_as_alone() -> None:
    worlds, alone = (GraspVectorEnv(n, probes=1, closings=("curl40",)) for n in (3, 1))
    action = np.random.default_rng(1).uniform(-1, 1, (3, 4))
    seen = [worlds.reset(seed=[5, 6, 5])[0], *(worlds.step(action)[0] for _ in range(2))]
    one = [alone.reset(seed=6)[0], *(alone.step(action[1:2])[0] for _ in range(2))]
    for many, single in zip(seen, one, strict=True):  # the last is the next episode's first
        assert (many[1] == single[0]).all()
    assert (seen[0][0] == seen[0][2]).all()
    assert (worlds.reset(seed=7)[0][0] == alone.reset(seed=7)[0][0]).all()


PROBES = 4
SENSITIVE: dict[str, dict[str, Any]] = {"sensors": {"tendon_threshold_N": 4.0}}


def sweep_and_environment(
    settings: dict[str, dict[str, Any]] = SENSITIVE, **tables: Any
) -> tuple[Rows, GraspVectorEnv, dict[str, Any]]:
    """Rows of six episodes near the side, and an environment that made the same probes: so many
    that no new starts are due at the last. `tables` are those of the sweep that `settings` mean."""
    actions = np.random.default_rng(4).uniform(-0.3, 0.3, (PROBES, 6, 4))
    cell = Cell(Strategy("same", call="same_actions", closings=("curl40", "base_then_curl")),
                {"name": "block"}, "block", seed=9,
                **(tables or {"sensors": SensorTable(tendon_threshold_N=4.0)}))

    def same_actions(belief: Belief) -> list[Probe]:
        return (probes_of(actions[belief.step], ("containment",), belief, cell)
                if belief.step < PROBES else [])

    planner("same_actions")(lambda: same_actions)
    rows = run_episodes(cell, np.arange(6), "cpu")
    worlds = GraspVectorEnv(6, objects="block", probes=PROBES, settings=settings)
    body = worlds._made_with.bodies[0]
    worlds._drawn_keys = lambda seed: counter_key(  # type: ignore[method-assign]
        9, int(body.content[:15], 16), np.arange(6))
    worlds.reset(seed=1)
    infos = [worlds.step(action)[-1] for action in actions]
    return rows, worlds, infos[-1]


def assert_the_same(rows: Rows, worlds: GraspVectorEnv, info: dict[str, Any]) -> None:
    """Scores, status and recovered body of the environment are those of the rows."""
    assert (info["chamfer_mm"] == rows["chamfer_mm"]).all()
    assert (info["status"] == rows["status"]).all()
    assert (info["touches"] == rows["touches"]).all()
    assert not worlds._run.fitted.rough.any()  # both end with `finish`
    for name, column in model_columns(worlds._run.belief, worlds._run.recovered).items():
        if column.dtype.kind != "O":  # but for contours, which are lists
            assert np.array_equal(column, rows[name], equal_nan=column.dtype.kind == "f"), name


@pytest.fixture(scope="module")
def plain() -> tuple[Rows, GraspVectorEnv, dict[str, Any]]:
    """Rows and an environment, as they are without more ado."""
    return sweep_and_environment()


def test_an_episode_here_is_the_sweeps_row_of_the_same_probes(
    plain: tuple[Rows, GraspVectorEnv, dict[str, Any]]
) -> None:
    """Noise, recovered body and score are those of `run_episodes`."""
    assert_the_same(*plain)


def test_every_table_of_an_episode_counts_here_as_in_a_sweep() -> None:
    """Each of these alone changes the rows: calibration, friction, and the points of scores."""
    rows, worlds, info = sweep_and_environment(
        {"errors": {"scale": 0.0}, "contact": {"friction": 0.0}, "scores": {"samples": "dense"}},
        errors=ErrorTable(scale=0.0), contact=ContactTable(friction=0.0),
        scores=ScoreTable(samples="dense"))
    assert_the_same(rows, worlds, info)
    errors = worlds._run.robot.errors
    assert not any(getattr(errors, f.name) for f in fields(errors) if f.name != "scale")


@pytest.mark.parametrize(("fingers", "slots"), [(3, 64), (4, 64), (5, 80), (6, 96)])
def test_there_is_a_slot_for_every_finger(fingers: int, slots: int,
                                          monkeypatch: pytest.MonkeyPatch) -> None:
    """Hands of three and four fingers are observed alike."""
    monkeypatch.setattr(
        "sweeps.gym.grasp_env.outline_of",
        lambda hand: replace(outline_of(hand), fingers=fingers), raising=False)
    assert GraspVectorEnv(1, probes=8)._slots == slots


def test_a_body_far_from_its_touches_is_rewarded_no_more_than_in_a_sweep(
    monkeypatch: pytest.MonkeyPatch, plain: tuple[Rows, GraspVectorEnv, dict[str, Any]]
) -> None:
    """Where the distance to its own touches decides that a body is not believed, both score the
    prior. Bodies 6 mm away are rare: the bound is lowered until one of these is rejected."""
    rows, worlds, _ = plain
    run = worlds._run
    rejected = np.flatnonzero(run.believed)[:1]
    away = touch_misfit(run.fits, run.fitted.placed)
    assert len(rejected) == 1
    monkeypatch.setattr("strategies.exploration.UNBELIEVED_M", 0.99 * away[rejected[0]])
    strict, worlds, info = sweep_and_environment()
    assert_the_same(strict, worlds, info)
    assert (rows["status"][rejected], strict["status"][rejected]) == ("ok", "fit_implausible")
    assert (strict["chamfer_mm"][rejected] == strict["prior_chamfer_mm"][rejected]).all()
    assert (strict["chamfer_mm"][rejected] != rows["chamfer_mm"][rejected]).all()


def test_objects_are_mixed_and_meshes_taken(tmp_path: Path) -> None:
    mesh = tmp_path / "slab.stl"
    trimesh.creation.box((60, 40, 90)).export(mesh)
    worlds = GraspVectorEnv(12, objects=["block", "wine_bottle", {
        "mesh": str(mesh), "units": "mm"}], probes=1, closings=("curl40",))
    _, info = worlds.reset(seed=2)
    assert set(info["object"]) == {"block", "wine_bottle", "slab"}
    alone = GraspVectorEnv(4, objects=["block", "wine_bottle", {
        "mesh": str(mesh), "units": "mm"}], probes=1, closings=("curl40",))
    assert list(alone.reset(seed=2)[1]["object"]) == list(info["object"][:4])
    action = worlds.action_space.sample()
    assert (worlds.step(action)[0][:4] == alone.step(action[:4])[0]).all()


def test_pads_cross_faces_and_follow_contours() -> None:
    worlds = GraspVectorEnv(3, objects="block", probes=3,
                            procedures=("containment", "planar", "contour"))
    worlds.reset(seed=3)
    grasp = np.tile([0.1, -0.2, 0.0, 0.0, -1.0], (3, 1))
    worlds.step(grasp)
    mixed = grasp.copy()
    mixed[1, 4], mixed[2, 4] = 0.0, 1.0  # one goes on with a face, one with the contour
    seen, *_ = worlds.step(mixed)
    names = [[p.name for p in worlds._run.procedures if p.took_part[w]] for w in range(3)]
    assert names == [["containment"] * 2, ["containment", "planar"], ["containment", "contour"]]
    assert seen in worlds.observation_space
    contacts = seen[:, -worlds._slots * 5:].reshape(3, -1, 5)
    felt = worlds._run.belief.evidence
    assert (contacts[..., 0].sum(1) == felt.mask.sum(1)).all()
    assert (contacts[..., 1].sum(1) == (felt.by_pad & felt.mask).sum(1)).all()
    assert contacts[1:, :, 1].any(1).all()
    prior = worlds._run.belief.prior
    for world, mask in enumerate(felt.mask):
        foot = [prior.x_m[world], prior.y_m[world], 0.0]
        assert contacts[world, :mask.sum(), 2:] == pytest.approx(felt.points_m[world, mask] - foot)


def test_a_box_is_told_by_its_sides_and_twice_its_yaw() -> None:
    """So that a box that is turned by half a turn is told alike."""
    worlds = GraspVectorEnv(4, probes=1, closings=("curl40",),
                            settings={"object": {"prior": "box"}})
    seen, _ = worlds.reset(seed=1)
    box = worlds._run.belief.prior
    assert isinstance(box, BoundingBox)
    assert np.array_equal(seen[:, 4:6], box.half_m)
    turned = np.arctan2(seen[:, 7], seen[:, 6]) / 2 - box.yaw_rad
    assert np.sin(turned) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("prior", ["silhouettes", "depth"])
def test_an_object_that_no_camera_sees_whole_is_told_as_in_a_sweep(prior: str) -> None:
    """The prior that was drawn stood for the one seen, without a word."""
    worlds = GraspVectorEnv(2, probes=1, settings={
        "object": {"prior": prior}, "stereo": {"field_of_view_deg": 3, "pixels": 16}})
    _, info = worlds.reset(seed=1)
    assert list(info["status"]) == ["strategy_failed"] * 2
    assert all(f"object.prior {prior}: the object is not seen whole" in note
               for note in info["note"])
    _, info = GraspVectorEnv(2, probes=1).reset(seed=1)
    assert list(info["note"]) == [""] * 2


def test_pictures_are_of_every_world() -> None:
    worlds = gymnasium.make_vec("warpgrasp/Grasp-v0", num_envs=2, probes=1,
                                render_mode="rgb_array")
    worlds.reset(seed=1)
    before = worlds.render()
    worlds.step(np.tile([0.1, -0.2, 0.0, 0.0], (2, 1)))
    after = worlds.render()
    assert len(before) == len(after) == 2
    for one, other in zip(before, after, strict=True):
        assert one.dtype == np.uint8
        assert one.shape == other.shape
        assert one.shape[2] == 3
        assert (one != other).any()
    assert GraspVectorEnv(1).render() is None


@pytest.mark.parametrize(("settings", "says"), [
    ({"probes": 0}, "probes: is 0; should be"), ({"probes": -1}, "probes: is -1"),
    ({"num_envs": True}, "num_envs: is True"),
    ({"settings": {"recognition": {"models": "no.json"}}}, "'no.json' is not a file; looked for"),
    ({"num_envs": 0}, "num_envs: is 0"), ({"closings": ()}, "closings: .* should be names"),
    ({"closings": ("curl",)}, r"closings\[0\]: is 'curl'; .*there are: .*curl40"),
    ({"procedures": ("poke",)}, "procedures: .* should be some of containment, planar, contour"),
    ({"objects": "blok"}, r"objects\[0\]: no object 'blok'; did you mean block"),
    ({"objects": []}, "objects: is empty"), ({"render_mode": "human"}, "should be one of None"),
    ({"device": "cuda:99"}, "device: there is no 'cuda:99' here; there are: cpu"),
    ({"settings": {"sensor": {}}}, "settings.sensor: unknown table; did you mean sensors"),
    ({"settings": {"sensors": {"tendon_threshold": 4}}}, "did you mean tendon_threshold_N"),
    ({"settings": {"object": {"x_mm": 0.45}}}, "settings.object.x_mm: .*the arm itself stands"),
    ({"settings": {"arm": {"kind": "ur6e"}}}, r"settings.arm.kind: no arm 'ur6e'.*ur5e"),
    ({"settings": {"hand": {"kind": "allegra"}}}, "settings.hand.kind: no hand 'allegra'"),
    ({"settings": [1]}, r"settings: are \[1\]; should be tables such as"),
    ({"settings": {"hand": "allegra"}}, "settings.hand.kind: no hand 'allegra'"),
    ({"settings": {"fit": {"reconstruct": "chosen"}}}, "reconstruct: .* should be superquadric"),
    ({"settings": {"robot": {"swept": "truth"}}}, "settings.robot.swept: .*; should be both"),
    ({"settings": {"recognition": {"way": "faces"}}}, "settings.recognition.way: is for the rows"),
    ({"settings": {"decide": {"ends": False}}}, "settings.decide.ends: .*; should be left out"),
    ({"settings": {"hand": {"abduction_limit_deg": [9, -9]}}},
     "settings.hand.abduction_limit_deg: is 9, -9; the first should be below"),
    ({"settings": {"hand": "allegro", "sensors": {"tendon_threshold_N": 4}},
      "closings": ("together",)}, "settings.sensors.tendon_threshold_N: says nothing"),
    ({"settings": {"pads": {"distal": False}}, "procedures": ("planar",)},
     "settings.pads.distal: no pad on the distal links"),
])
def test_settings_that_cannot_be_used_are_refused(settings: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        GraspVectorEnv(**settings)


def test_actions_and_seeds_that_cannot_be_used_are_refused() -> None:
    worlds = GraspVectorEnv(2, probes=1, closings=("curl40",))
    with pytest.raises(ResetNeeded, match="call reset first"):
        worlds.step(np.zeros((2, 4)))
    with pytest.raises(ValueError, match="one for each of 2 worlds"):
        worlds.reset(seed=[1])
    worlds.reset(seed=1)
    for actions in (np.zeros((2, 3)), np.zeros((1, 4)), np.zeros(4), np.full((2, 4), np.nan)):
        with pytest.raises(ValueError, match=r"actions: .* should be .* \(2, 4\)"):
            worlds.step(actions)


@pytest.mark.parametrize(("words", "says"), [
    ({"seed": 1.5}, "seed: is 1.5; should be a whole number from 0 on"),
    ({"seed": True}, "seed: is True"), ({"seed": [1, 2.0]}, "seed: is 2.0"),
    ({"seed": [False, 2]}, "seed: is False"), ({"seed": ["1", 2]}, "seed: is '1'"),
    ({"seed": -1}, "seed: is -1"), ({"seed": [1, -1]}, "seed: is -1"),
    ({"options": {"reset_mask": np.array([True, False])}}, "options: has reset_mask; should be"),
    ({"options": {"nonsense": 1}}, "options: has nonsense"),
])
def test_what_reset_cannot_do_is_refused(words: dict[str, Any], says: str) -> None:
    worlds = GraspVectorEnv(2, probes=1, closings=("curl40",))
    first, _ = worlds.reset(seed=3, options={})
    with pytest.raises(ValueError, match=says):
        worlds.reset(**words)
    assert (worlds.reset(seed=np.int64(3))[0] == first).all()


def test_a_single_world_is_the_first_of_many_with_its_seed() -> None:
    alone = GraspEnv(probes=1, closings=("curl40",))
    many = GraspVectorEnv(2, probes=1, closings=("curl40",))
    for seed in (7, np.int64(8), [9, 1], None):  # without a seed both go on alike
        one = seed[0] if isinstance(seed, list) else seed
        if seed is None:
            alone.reset(seed=5)
            many.reset(seed=5)
        assert (alone.reset(seed=one)[0] == many.reset(seed=seed)[0][0]).all()
    with pytest.raises(ValueError, match=r"seed: is 1\.5"):
        alone.reset(seed=1.5)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="options: has nonsense"):
        alone.reset(options={"nonsense": 1})


def test_no_picture_before_the_first_reset() -> None:
    for worlds in (GraspVectorEnv(1, render_mode="rgb_array"), GraspEnv(render_mode="rgb_array")):
        with pytest.raises(ResetNeeded, match=r"render: .* call reset first"):
            worlds.render()


@pytest.mark.slow
def test_the_random_policy_runs(capsys: pytest.CaptureFixture[str]) -> None:
    left = runpy.run_path(str(ROOT / "examples" / "random_policy.py"))["main"](4, 3)
    assert np.isfinite(left)
    assert capsys.readouterr().out.count("reward") == 3
