"""What a user would take instead, doing the same work: the peers of `warpgrasp bench --peers`.

They need the optional group `peers` (`pip install '.[peers]'` in the clone). A row's `of` is the
peer's setting; every closing is of the hand straight above the small cylinder, as `peer_closing`
says.
"""

from collections.abc import Callable
from math import hypot
from typing import Any

import numpy as np

from sweeps.bench.measure import SEED, Workload
from sweeps.bench.peer_closing import COMMANDS_RAD, COUNT, HAND_POSE, ours, rest_tips
from warpgrasp.parameters import ContactTable, HandTable, PadTable

HAND = HandTable()
ROLLOUT_S = 1.5


def mujoco_rollout(of: str, batch: int) -> Workload:
    """MuJoCo's batched rollout on as many threads as there are; `of`: a step of 2, 4 or 8 ms.

    The exported hand's servos follow the path for 1.5 s (750 steps of 2 ms). `tip_error_mm` is the
    largest distance of its fingertips, held at a command that presses, from where we have them.
    """
    import os

    from sweeps.validate.comparison import engine
    from warpgrasp.export.convex_solids import object_solids
    from warpgrasp.export.mjcf import mjcf_text
    from warpgrasp.export.robot_tree import hand_tree
    from warpgrasp.objects.catalogue import body_from_name

    mujoco, rollout = engine("mujoco"), engine("mujoco.rollout")

    threads = int(os.environ.get("WARPGRASP_THREADS", "1"))
    text = mjcf_text(hand_tree(HAND, PadTable(), place=tuple(HAND_POSE)),
                     object_solids(body_from_name("small_cylinder")), limits=False)
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = float(of) * 1e-3
    steps = round(ROLLOUT_S / model.opt.timestep)
    at = np.linspace(0, COUNT - 1, steps).round().astype(int)
    control = np.tile(COMMANDS_RAD[0][:, at].transpose(1, 0, 2).reshape(steps, 16), (batch, 1, 1))
    datas = [mujoco.MjData(model) for _ in range(threads)]
    state = np.zeros((batch, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    data = datas[0]
    data.qpos[:] = COMMANDS_RAD[0, :, 0].ravel()
    mujoco.mj_getState(model, data, state[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    state[:] = state[0]

    def call() -> int:
        rollout.rollout(model, datas, state, control)
        return 4 * batch

    pressing, expected = rest_tips()
    hold = np.tile(COMMANDS_RAD[0][:, np.minimum(at, pressing)].transpose(1, 0, 2).reshape(
        steps, 16), (1, 1, 1))
    ended, _ = rollout.rollout(model, datas[:1], state[:1], hold)
    data.qpos[:] = ended[0, -1, 1:1 + model.nq]
    mujoco.mj_kinematics(model, data)
    names = [link.name for link in hand_tree(HAND, PadTable()) if link.name.endswith("distal")]
    distal = [model.body(name).id for name in names]
    tips = data.xpos[distal] + HAND.link_length_m[2] * data.xmat[distal].reshape(-1, 3, 3)[:, :, 2]
    error = float(np.linalg.norm(tips - expected, axis=1).max() * 1e3)
    return Workload("closings", call, {"steps": steps, "threads_used": threads,
                                   "tip_error_mm": round(error, 3)})


def same_closing(of: str, batch: int) -> Workload:
    """Our kernel on the peers' closing: `of` names nothing."""
    call, _ = ours(batch)
    return Workload("closings", call)


def numba_closing(of: str, batch: int) -> Workload:
    """The same closing in numba; `of`: `every` command looked at, or `skip` by the distance."""
    from sweeps.bench.peer_numba import numba_closings

    call, stops = numba_closings(batch, skip=of == "skip")
    return Workload("closings", call, _agreement(stops))


def jax_closing(of: str, batch: int) -> Workload:
    """The same closing in JAX, every command looked at: `of` names nothing."""
    from sweeps.bench.peer_jax import jax_closings

    call, stops = jax_closings(batch)
    return Workload("closings", call, _agreement(stops))


def _agreement(stops: Callable[[], np.ndarray]) -> dict[str, int]:
    """Largest difference of the steps at which the four fingers stop from ours."""
    _, expected = ours(1)
    return {"steps_off": int(np.abs(stops() - expected()).max())}


def scipy_fits(of: str, batch: int) -> Workload:
    """scipy's least_squares from the same starts, on the very same compiled residuals."""
    import jax
    from scipy.optimize import least_squares

    from fit.prepare import prepare
    from fit.superquadric.descent import begin_starts
    from fit.superquadric.parameter_vector import Form
    from fit.superquadric.record import SuperquadricOptions
    from fit.superquadric.residuals import residual_vector
    from sweeps.bench.measure import bodies_touched

    options = {"superquadric11": SuperquadricOptions(),
               "superquadric13": SuperquadricOptions(taper=True)}[of]
    _, sets = next(iter(prepare(bodies_touched(batch)[1], None, table_z=0.0).buckets()))
    form = Form(options.taper, options.bend, "volume_distance" if options.taper else "solina",
                "none")
    lanes, theta = begin_starts(sets, form, options)
    starts = theta.reshape(-1, theta.shape[-1])[:batch * theta.shape[1]]
    value = jax.jit(lambda t, lane: residual_vector(t, lane, form))

    def call() -> int:
        with jax.enable_x64(True):
            for row, start in enumerate(starts):
                lane = jax.tree.map(lambda leaf, row=row: leaf[row], lanes)
                least_squares(lambda t, lane=lane: np.asarray(value(t, lane)), start, max_nfev=80)
        return batch

    return Workload("fits", call)


def sklearn_free_forms(of: str, batch: int) -> Workload:
    """scikit-learn's Gaussian process on the very rows of our free forms of a mug: `of` is `known`,
    with our hyperparameters, or `search`, where it looks for amplitude and length scale from its
    own start, which ours do not need. `off_mm`: largest difference of the distances at the touches
    from ours, of `known` alone."""
    from importlib import import_module

    from fit.implicit.known import known_slopes
    from strategies.recovery.free_contacts import BODY
    from sweeps.validate.bodies.free_forms import SETS, fitted_to, shape, touches

    points, normals = touches(shape("mug-1"), np.random.default_rng(SEED))
    fits = fitted_to(points, normals)
    count = points.shape[1]
    target = np.repeat([-BODY.mean_m, BODY.offset_m - BODY.mean_m], count)
    known = of == "known"
    theirs = import_module("sklearn.gaussian_process")

    def fitted(row: int) -> Any:
        constant, matern = theirs.kernels.ConstantKernel, theirs.kernels.Matern
        kernel = constant() * matern(nu=1.5)
        if known:
            kernel = constant(fits.amplitude_m[row]**2) * matern(fits.length_m[row], nu=1.5)
        return theirs.GaussianProcessRegressor(
            kernel, alpha=fits.noise_m2[row], optimizer=None if known else "fmin_l_bfgs_b",
        ).fit(fits.points_m[row], target)

    def call() -> int:
        for n in range(batch):
            fitted(n % SETS)
        return batch

    ours_m, _ = known_slopes(fits, 0, BODY, points[0])
    off_m = np.abs(fitted(0).predict(points[0]) + BODY.mean_m - ours_m).max()
    return Workload("free forms", call, {"off_mm": round(float(off_m) * 1e3, 6)} if known else {})


def trimesh_distances(of: str, batch: int) -> Workload:
    """Signed distances to a mesh of 5,120 faces: trimesh's proximity, or `of` ours, baked."""
    import trimesh

    from sweeps.bench.measure import mesh_body
    from warpgrasp.geometry.body import distance_to_bodies, scene_of

    points = np.random.default_rng(0).uniform([-0.05, -0.05, 0.0], [0.05, 0.05, 0.13], (batch, 3))
    mesh = trimesh.creation.icosphere(subdivisions=4)
    mesh.apply_scale([0.030, 0.040, 0.060])
    scene = scene_of([mesh_body()], "cpu") if of == "ours" else None

    def call() -> int:
        if scene is None:
            trimesh.proximity.signed_distance(mesh, points - [0, 0, 0.06])
        else:
            distance_to_bodies(scene, np.zeros(1, int), points[:, None])
        return batch

    return Workload("distances", call)


def mujoco_scipy_episode(of: str, batch: int) -> Workload:
    """The loop a researcher would write: 48 closings in MuJoCo, a 13-parameter fit by scipy.

    `of` is a strategy of six poses on the block. Fingertips are taken as contacts. Scores are left
    out: the comparison is in its favour.
    """
    from scipy.optimize import least_squares

    from strategies.poses.hand_poses import waypoint_poses
    from strategies.poses.waypoints import BoundingCylinder
    from strategies.procedures.containment import padded_commands
    from strategies.ready_made import STRATEGIES
    from sweeps.validate.mujoco_hand import MujocoHand
    from warpgrasp.export.convex_solids import object_solids
    from warpgrasp.objects.catalogue import body_from_name

    body = body_from_name("block")
    strategy = STRATEGIES[of]
    radius = hypot(body.high_m[0], body.high_m[1])
    prior = BoundingCylinder(np.zeros(1), np.zeros(1), np.array([radius]),
                            np.array([body.high_m[2]]))
    poses = waypoint_poses(strategy.waypoints, prior, HAND, np.zeros(1, np.uint64))[0]
    commands, count = padded_commands(strategy.closings)
    hand = MujocoHand(object_solids(body), HAND, ContactTable.none())

    def body_residuals(p: np.ndarray, points: np.ndarray) -> np.ndarray:
        size, e, taper = np.exp(p[:3]), 0.1 + 1.9 / (1 + np.exp(-p[3:5])), np.tanh(p[11:13])
        x = (points - p[5:8]) @ _turn(p[8:11])
        x[:, :2] /= 1 + taper * x[:, 2:] / size[2]
        u = np.maximum(np.abs(x / size), 1e-9)
        f = ((u[:, 0] ** (2 / e[1]) + u[:, 1] ** (2 / e[1])) ** (e[1] / e[0])
             + u[:, 2] ** (2 / e[0]))
        return np.sqrt(size.prod()) * (f ** e[0] - 1)

    def call() -> int:
        for _ in range(batch):
            tips = []
            for pose in poses:
                hand.place(pose)
                for path, steps in zip(commands, count, strict=True):
                    if not hand.touches(path[:, 0]):
                        for found in hand.close(path[:, :steps], [6.0]):
                            tips += [found[0].tip_m] if found[0] is not None else []
            points = np.array(tips).reshape(-1, 3)
            if len(points) < 8:
                continue
            half = np.log(np.maximum(np.ptp(points, axis=0) / 2, 0.01))
            for axis in range(6):
                start = np.concatenate([np.roll(half, axis), np.zeros(2), points.mean(0),
                                        [0, 0, 0.3 * (axis // 3)], np.zeros(2)])
                least_squares(body_residuals, start, args=(points,), max_nfev=80)
        return batch

    return Workload("episodes", call, {"closings": int(4 * len(poses) * len(count))})


def _turn(v: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(v).as_matrix()


PEERS: dict[str, Callable[[str, int], Workload]] = {row.__name__: row for row in (
    mujoco_rollout, same_closing, numba_closing, jax_closing, scipy_fits,
    sklearn_free_forms, trimesh_distances, mujoco_scipy_episode)}
