"""What `warpgrasp bench` measures of this package: one function a row, `(of, batch) -> Workload`.

    python -m sweeps.bench.rows ROW OF BATCH [--device cuda:0] [--quick]      prints one JSON line

Rows of kernels, `ON_DEVICES`, take a device too.
"""

import gc
import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sweeps.bench.measure import SEED, Workload, bodies_touched, measure, mesh_body


def body_of(name: str):
    """A catalogue object, or `mesh`."""
    from warpgrasp.objects.catalogue import body_from_name

    return mesh_body() if name == "mesh" else body_from_name(name)


def closings(of: str, batch: int, device: str = "cpu") -> Workload:
    """Finger closings of `rim12-ring12` (24 poses, two paths): `batch` slots or a few more, of
    robots with the errors of calibration that episodes draw."""
    from strategies.poses.hand_poses import waypoint_poses
    from strategies.procedures.containment import padded_commands
    from strategies.ready_made import STRATEGIES
    from sweeps.episode.episodes import place_objects
    from sweeps.episode.given_prior import draw_prior
    from warpgrasp.closing.closing import close_fingers
    from warpgrasp.core.random import counter_key
    from warpgrasp.geometry.body import scene_of
    from warpgrasp.mechanism.arm_motion import ArmState, move_hand
    from warpgrasp.mechanism.calibration import draw_calibration
    from warpgrasp.parameters import ArmTable, ErrorTable, HandTable, ObjectTable, SensorTable

    strategy, hand, body = STRATEGIES["rim12-ring12"], HandTable(), body_of(of)
    commands, count = padded_commands(strategy.closings)
    worlds = -(-batch // 192)
    key = counter_key(SEED, np.arange(worlds))
    pose = place_objects(ObjectTable(), key)
    prior = draw_prior(body, pose, ObjectTable(), key)
    poses = waypoint_poses(strategy.waypoints, prior, hand, key)
    scene, which = scene_of([body], device), np.zeros(1, int)
    moves, actual = move_hand(scene, which, pose, ArmTable(), hand, key, ArmState.home(worlds),
                              poses, np.ones(poses.shape[:2], bool), commands, device=device)
    errors = draw_calibration(ErrorTable(), key)

    def call() -> int:
        felt, _ = close_fingers(scene, which, pose, hand, SensorTable(), key, moves.status, actual,
                                commands, count, errors=errors, device=device)
        return int(np.isfinite(felt.q_rad[..., 0]).sum())

    return Workload("closings", call)


def touches(of: str, batch: int, device: str = "cpu") -> Workload:
    """Guarded lines of 1 mm intervals that end on a pad of 16 x 16 taxels, of robots that make one
    after the other."""
    from strategies.poses.postures import poking_pose
    from strategies.procedures.possible import extended_of
    from warpgrasp.parameters import ArmTable, HandTable, SensorTable
    from warpgrasp.probe_status import ProbeStatus
    from warpgrasp.robot import Robot, Truth

    rng, inward = np.random.default_rng(SEED), np.array([1.0, 0.0, 0.0])
    body = body_of(of)
    truth = Truth(np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (batch, 1)))
    robot = Robot([body], np.zeros(1, int), truth, np.arange(batch).astype(np.uint64), ArmTable(),
                  HandTable(), SensorTable(), device=device)
    gap, side, height = rng.uniform([0.005, -0.02, 0.03], [0.03, 0.02, 0.09], (batch, 3)).T
    one = extended_of(robot.hand, robot.pads)
    pose = np.stack([poking_pose(one, np.array([x, y, z]), inward, np.array([0.0, 0.0, -1.0]))
                     for x, y, z in zip(0.45 + body.low_m[0] - gap, side, height, strict=True)])

    def call() -> int:
        touch = robot.guarded_line(np.arange(batch), pose, np.tile(inward, (batch, 1)),
                                   interval_m=0.001, steps=60, finger=one.finger,
                                   commands_rad=one.commands_rad)
        return int((touch.status == ProbeStatus.CONTACT).sum())

    return Workload("touches", call)


def fits(of: str, batch: int) -> Workload:
    """Fits of 60 points, all starts included: superquadrics by parameters, plane, revolution."""
    from fit.plane import fit_plane
    from fit.revolution.fit import fit_revolution
    from fit.superquadric.fit import fit_superquadric
    from fit.superquadric.record import SuperquadricOptions

    _, points = bodies_touched(batch)
    forms = {"superquadric11": {}, "superquadric13": {"taper": True},
             "superquadric15": {"taper": True, "bend": True}}

    def call() -> int:
        if of == "plane":
            fit_plane(points)
        elif of == "revolution":
            fit_revolution(points, table_z=0.0)
        else:
            fit_superquadric(points, table_z=0.0, options=SuperquadricOptions(**forms[of]))
        return batch

    return Workload("fits", call)


def free_forms(of: str, batch: int) -> Workload:
    """Free forms of a mug by 96 touches with normals: the `fit`, or fit, mesh and all `scores`."""
    from fit.implicit.mesh import implicit_meshes
    from strategies.recovery.free_contacts import BODY
    from sweeps.episode.mesh_scores import score_meshes
    from sweeps.validate.bodies.free_forms import SETS, fitted_to, shape, touches

    body = shape("mug-1")
    points, normals = (np.tile(v, (-(-batch // SETS), 1, 1))[:batch]
                       for v in touches(body, np.random.default_rng(SEED)))
    pose = np.tile([0, 0, 0, 0, 0, 0, 1.0], (batch, 1))

    def call() -> int:
        fits = fitted_to(points, normals)
        if of == "scores":
            score_meshes(implicit_meshes(fits, BODY.mean), body, pose)
        return batch

    return Workload("free forms", call)


def metrics(of: str, batch: int, device: str = "cpu") -> Workload:
    """All scores of recovered superquadrics against a true body."""
    from sweeps.episode.scores import score_superquadrics

    body, _ = bodies_touched(batch)
    true, pose = body_of(of), np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (batch, 1))

    def call() -> int:
        score_superquadrics(body, true, pose, device=device)
        return batch

    return Workload("scores", call)


def episodes(of: str, batch: int, device: str = "cpu") -> Workload:
    """Whole episodes of a shipped strategy: closings, fits, scores, rows written to disk."""
    from strategies.ready_made import STRATEGIES
    from sweeps.episode.episodes import run_episodes
    from sweeps.run.unit_file import write_unit
    from sweeps.spec.cell import Cell

    cell = Cell(STRATEGIES[of], {"name": "block"}, "block", seed=SEED)
    folder = tempfile.mkdtemp()
    extra: dict[str, str | int] = {"object": "block"}
    done = 0
    gc.freeze()  # as a worker of a sweep does

    def call() -> int:
        nonlocal done
        path = Path(folder) / "unit.parquet"
        write_unit(path, "bench", run_episodes(cell, np.arange(done, done + batch), device))
        extra["bytes_per_episode"] = round(path.stat().st_size / batch)
        path.unlink()
        done += batch
        return batch

    return Workload("episodes", call, extra)


ON_DEVICES: dict[str, Callable[[str, int, str], Workload]] = {
    row.__name__: row for row in (closings, touches, metrics, episodes)}
ROWS: dict[str, Callable[[str, int], Workload]] = {
    row.__name__: row for row in (closings, touches, fits, free_forms, metrics, episodes)}


def main(arguments: list[str]) -> None:
    """Measure one row and print it."""
    from sweeps.bench import peers as bench_peers
    from sweeps.output import init_warp

    init_warp()
    row, of, batch = arguments[:3]
    if "--device" in arguments:
        device = arguments[arguments.index("--device") + 1]
        work, where = ON_DEVICES[row](of, int(batch), device), {"device": device}
    else:
        work, where = (ROWS | bench_peers.PEERS)[row](of, int(batch)), {}
    measured = measure(work, quick="--quick" in arguments)
    print(json.dumps({"row": row, "of": of, "batch": int(batch), **where, **measured}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
