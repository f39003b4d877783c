"""What `warpgrasp bench` measures of this package: one function a row, `(of, batch) -> Work`.

    python -m sweeps.bench_rows ROW OF BATCH [--quick]      prints one JSON line
"""

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sweeps.bench_measure import Work, measure

SEED = 7
_POINTS = 60
_BODIES = 256
"""Made at a time: more would take memory that a row would tell as its own."""


def mesh_body():
    """A baked mesh: an ellipsoid of 5,120 faces, 60 x 80 x 120 mm."""
    import trimesh

    from warpgrasp.mesh_intake import body_from_mesh

    mesh = trimesh.creation.icosphere(subdivisions=4)
    mesh.apply_scale([0.030, 0.040, 0.060])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ellipsoid.ply"
        mesh.export(path)
        return body_from_mesh(path, units="m")


def body_of(name: str):
    """A catalogue object, or `mesh`."""
    from warpgrasp.catalogue import body_from_name

    return mesh_body() if name == "mesh" else body_from_name(name)


def closings(of: str, batch: int) -> Work:
    """Finger closings of `rim12-ring12` (24 poses, two paths): `batch` slots or a few more."""
    from strategies.catalogue import STRATEGIES
    from strategies.containment import padded_commands
    from strategies.waypoint_poses import waypoint_poses
    from sweeps.episodes import place_objects, tell_cylinder
    from warpgrasp.arm_hand import ArmState, move_hand
    from warpgrasp.body import scene_of
    from warpgrasp.closing import close_fingers
    from warpgrasp.counter_random import counter_key_host
    from warpgrasp.parameters import ArmTable, HandTable, ObjectTable, SensorTable

    strategy, hand, body = STRATEGIES["rim12-ring12"], HandTable(), body_of(of)
    commands, count = padded_commands(strategy.closings)
    worlds = -(-batch // 192)
    key = counter_key_host(SEED, np.arange(worlds))
    pose = place_objects(ObjectTable(), key)
    told = tell_cylinder(body, pose, 0.01, key)
    poses = waypoint_poses(strategy.waypoints, told, hand, key)
    scene, which = scene_of([body], "cpu"), np.zeros(1, int)
    moves, actual = move_hand(scene, which, pose, ArmTable(), hand, key, ArmState.home(worlds),
                              poses, np.ones(poses.shape[:2], bool), commands, device="cpu")

    def call() -> int:
        felt, _ = close_fingers(scene, which, pose, hand, SensorTable(), key, moves.status, actual,
                                commands, count)
        return int(np.isfinite(felt.q_rad[..., 0]).sum())

    return Work("closings", call)


def touches(of: str, batch: int) -> Work:
    """Guarded lines of 1 mm intervals that end on a pad of 16 x 16 taxels."""
    from strategies.postures import POKE_RAD, poking_pose
    from warpgrasp.parameters import ArmTable, HandTable, SensorTable
    from warpgrasp.robot import Robot, Truth
    from warpgrasp.status import ProbeStatus

    rng, inward = np.random.default_rng(SEED), np.array([1.0, 0.0, 0.0])
    body = body_of(of)
    key = np.arange(batch).astype(np.uint64)

    def robot() -> Robot:
        truth = Truth(np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (batch, 1)))
        return Robot([body], np.zeros(1, int), truth, key, ArmTable(), HandTable(), SensorTable())

    first = robot()
    gap, side, height = rng.uniform([0.005, -0.02, 0.03], [0.03, 0.02, 0.09], (batch, 3)).T
    pose = np.stack([poking_pose(first.hand, first.pads, np.array([x, y, z]), inward,
                                 np.array([0.0, 0.0, -1.0]))
                     for x, y, z in zip(0.45 + body.low_m[0] - gap, side, height, strict=True)])

    def call() -> int:
        touch = robot().guarded_line(np.arange(batch), pose, np.tile(inward, (batch, 1)),
                                     interval_m=0.001, steps=60, finger=0, commands_rad=POKE_RAD)
        return int((touch.status == ProbeStatus.CONTACT).sum())

    return Work("touches", call)


def bodies_touched(n: int):
    """Random upright superquadrics, and 60 touches with 1 mm noise on each, (n, 60, 3) [m]."""
    from fit.rows import rows_of
    from fit.superquadric_shape import superquadric, superquadric_areas

    rng = np.random.default_rng(SEED)
    size, yaw = rng.uniform(0.02, 0.06, (n, 3)), rng.uniform(-np.pi, np.pi, n)
    place = np.stack([np.full(n, 0.45), np.zeros(n), size[:, 2]], 1)
    turn = np.stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)], 1)
    body = superquadric(size, rng.uniform(0.1, 1.0, (n, 2)), place, turn, np.zeros((n, 2)),
                        np.zeros((n, 2)))
    chosen = []
    for first in range(0, n, _BODIES):
        surface, area = superquadric_areas(rows_of(body, slice(first, first + _BODIES)), 1500)
        weight = area * (surface[..., 2] > 0.2 * size[first:first + _BODIES, None, 2])
        chosen += [p[rng.choice(len(p), _POINTS, p=w / w.sum())]
                   for p, w in zip(surface, weight, strict=True)]
    chosen = np.stack(chosen)
    return body, chosen + 1e-3 * rng.standard_normal(chosen.shape)


def fits(of: str, batch: int) -> Work:
    """Fits of 60 points, all starts included: superquadrics by parameters, plane, revolution."""
    from fit.plane import fit_plane
    from fit.revolution import fit_revolution
    from fit.superquadric import SuperquadricOptions, fit_superquadric

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

    return Work("fits", call)


def metrics(of: str, batch: int) -> Work:
    """All scores of recovered superquadrics against a true body."""
    from sweeps.metrics import score_superquadrics

    body, _ = bodies_touched(batch)
    true, pose = body_of(of), np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (batch, 1))

    def call() -> int:
        score_superquadrics(body, true, pose)
        return batch

    return Work("scores", call)


def episodes(of: str, batch: int) -> Work:
    """Whole episodes of a shipped strategy: closings, fits, scores, rows written to disk."""
    from strategies.catalogue import STRATEGIES
    from sweeps.cell import Cell
    from sweeps.episodes import run_episodes
    from sweeps.unit_file import write_unit

    cell = Cell(STRATEGIES[of], {"name": "block"}, "block", seed=SEED)
    folder = tempfile.mkdtemp()
    extra: dict[str, str | int] = {"object": "block"}
    done = 0

    def call() -> int:
        nonlocal done
        path = Path(folder) / "unit.parquet"
        write_unit(path, "bench", run_episodes(cell, np.arange(done, done + batch), "cpu"))
        extra["bytes_per_episode"] = round(path.stat().st_size / batch)
        path.unlink()
        done += batch
        return batch

    return Work("episodes", call, extra)


ROWS: dict[str, Callable[[str, int], Work]] = {
    row.__name__: row for row in (closings, touches, fits, metrics, episodes)}


def main(arguments: list[str]) -> None:
    """Measure one row and print it."""
    from sweeps import bench_peers
    from sweeps.quiet import start_warp

    start_warp()
    row, of, batch = arguments[:3]
    rows = ROWS | bench_peers.PEERS
    work = rows[row](of, int(batch))
    measured = measure(work, quick="--quick" in arguments)
    print(json.dumps({"row": row, "of": of, "batch": int(batch), **measured}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
