"""A hand of chains backs off before its palm or its open fingers strike the prior."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.poses.hand_outline import outline_of
from strategies.poses.hand_poses import PRIOR_CLEARANCE_M, waypoint_poses
from strategies.poses.waypoints import BoundingBox, BoundingCylinder, Ring
from strategies.ready_made import AROUND, CLOSE, RIM
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_model import Capsule
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.parameters import HandTable

BULGE_M = 0.05


def bulging(folder: Path) -> HandTable:
    """An Allegro hand with a ball on its palm, that reaches ahead of its frame's origin."""
    model = hand_named("allegro")
    turn = Rotation.from_quat(model.grasp_frame[3:])
    at = np.array(model.grasp_frame[:3]) + turn.apply([-0.038, 0.012, BULGE_M - 0.02])
    ball = Capsule(tuple(at), tuple(at), 0.02)  # type: ignore[arg-type]
    file = folder / "bulging.toml"
    file.write_text(hand_text(replace(model, palm=(*model.palm, ball))))
    return HandTable(kind=str(file))


def priors(worlds: int = 6) -> BoundingCylinder:
    rng = np.random.default_rng(4)
    return BoundingCylinder(rng.uniform(0.4, 0.5, worlds), rng.uniform(-0.1, 0.1, worlds),
                            rng.uniform(0.02, 0.05, worlds), rng.uniform(0.06, 0.2, worlds))


def gaps(table: HandTable, prior: BoundingCylinder, poses: np.ndarray) -> np.ndarray:
    """From palm and open fingers to upright cylinders [m], (world, pose), by points on the skin of
    a cylinder's outline rather than by its formula."""
    outline = outline_of(table)
    assert len(outline.solid_m)
    found = np.empty(poses.shape[:2])
    turns = np.linspace(0.0, 2 * np.pi, 90, endpoint=False)
    for w in range(prior.worlds):
        r, h = prior.radius_m[w], prior.height_m[w]
        inner = np.linspace(0.0, 1.0, 8)
        disc = (inner[:, None] * r)[..., None] * np.stack([np.cos(turns), np.sin(turns)], -1)
        parts = [np.concatenate([disc.reshape(-1, 2), np.full((disc.size // 2, 1), z)], 1)
                 for z in (0.0, h)]
        wall = np.stack([np.cos(turns), np.sin(turns)], -1) * r
        parts += [np.concatenate([wall, np.full((len(wall), 1), z)], 1)
                  for z in np.linspace(0.0, h, 24)]
        skin = np.concatenate(parts) + [prior.x_m[w], prior.y_m[w], 0.0]
        for p, pose in enumerate(poses[w]):
            solid = Rotation.from_quat(pose[3:]).apply(outline.solid_m) + pose[:3]
            off = np.linalg.norm(solid[:, None] - skin[None], axis=-1).min(1)
            within = ((np.hypot(*(solid[:, :2] - [prior.x_m[w], prior.y_m[w]]).T) < r)
                      & (solid[:, 2] > 0) & (solid[:, 2] < h))
            found[w, p] = (np.where(within, -off, off) - outline.solid_radius_m).min()
    return found


def poses_of(table: HandTable, prior: BoundingCylinder, families=(AROUND, CLOSE)) -> np.ndarray:
    return waypoint_poses(families, prior, table, np.arange(prior.worlds, dtype=np.uint64))


def test_a_palm_that_bulges_keeps_off_the_prior(tmp_path: Path) -> None:
    table, prior = bulging(tmp_path), priors()
    near = poses_of(table, prior)
    assert gaps(table, prior, near).min() > PRIOR_CLEARANCE_M - 0.004
    # Along the approach alone, and no farther than it must.
    plain = poses_of(HandTable(kind="allegro"), prior)
    back = near - plain
    moved = np.linalg.norm(back[..., :3], axis=-1)
    assert (moved > 1e-3).mean() > 0.3
    approach = Rotation.from_quat(near[..., 3:].reshape(-1, 4)).apply([0.0, 0.0, 1.0])
    along = (back[..., :3].reshape(-1, 3) * -approach).sum(1)
    np.testing.assert_allclose(along, moved.ravel(), atol=1e-9)
    late = gaps(table, prior, near)[moved > 1e-3]
    assert np.median(late) < PRIOR_CLEARANCE_M + 0.01


@pytest.mark.parametrize("kind", ["allegro", "leap", "barrett"])
def test_open_hands_that_ship_strike_no_prior(kind: str) -> None:
    table, prior = HandTable(kind=kind), priors()
    assert gaps(table, prior, poses_of(table, prior, (RIM, AROUND, CLOSE))).min() > 0.0


def test_a_hand_that_cannot_clear_the_prior_stays(tmp_path: Path) -> None:
    """Between fingers that are narrower than the prior there is no pose nearer than before it."""
    table = bulging(tmp_path)
    wide = BoundingCylinder(*(np.array([v]) for v in (0.45, 0.0, 0.3, 0.6)))
    ring = (Ring(count=6, tilt_rad=1.2, palm_clearance_m=-0.05, clearance_per_radius=0.0),)
    poses = poses_of(table, wide, ring)
    assert np.isfinite(poses).all()
    back = np.linalg.norm(poses - poses_of(HandTable(kind="allegro"), wide, ring), axis=-1)
    assert back.max() < 0.12


def test_a_box_prior_is_seen_from_where_the_hand_stands(tmp_path: Path) -> None:
    """Of a flat box seen from its end and from its side: hands keep off either."""
    table = bulging(tmp_path)
    box = BoundingBox(np.array([0.45]), np.array([0.0]), np.array([0.0825]), np.array([0.12]),
                      half_m=np.array([[0.08, 0.02]]), yaw_rad=np.array([0.4]))
    poses = poses_of(table, box)
    outline = outline_of(table)
    for pose in poses[0]:
        solid = Rotation.from_quat(pose[3:]).apply(outline.solid_m) + pose[:3]
        own = Rotation.from_euler("z", -0.4).apply(solid - [0.45, 0.0, 0.06])
        q = np.abs(own) - [0.08, 0.02, 0.06]
        gap = np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(1), 0.0)
        assert (gap - outline.solid_radius_m).min() > 0.0


def test_the_default_hand_stands_where_it_stood() -> None:
    """Its distances are such that it strikes nothing; and it has no chains to ask."""
    assert not len(outline_of(HandTable()).solid_m)
