"""Pads against scipy's integral of the foundation, and MuJoCo's distances under each taxel."""

from typing import Any

import numpy as np
from scipy.integrate import simpson

from sweeps.validate.comparison import Comparison, engine
from sweeps.validate.reference_finger import FingerEnergy
from warpgrasp.export.convex_solids import object_solids
from warpgrasp.export.mjcf import mjcf_text
from warpgrasp.geometry.body import Body, Part, scene_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.parameters import TAXELS, HandTable, PadTable
from warpgrasp.touch.pad import read_pads

HAND, PADS = HandTable(), PadTable()
FINGER, PRESSES = 1, 6
_SAMPLES = 401  # each way, of the integral
INTEGRAL, TAXEL_N = 0.02, 1e-6
"""Sum over taxels against the integral (256 samples of a rounded load), relative; one taxel [N]."""
_AREA_M2 = PADS.width_m * PADS.length_m


def compare_pads() -> list[Comparison]:
    """A distal pad pressed on a ball, a block and a cylinder by up to 1.5 mm."""
    mujoco = engine("mujoco")
    rows = []
    for body in (_ball(), _block(), _cylinder()):
        poses, force = _presses(body)
        whole = np.array([_integral(body, pose) for pose in poses])
        total = force.sum((1, 2))
        rows.append(Comparison(
            "pads", f"{body.name}: load of {len(poses)} presses, taxels against the integral", "N",
            float(total.mean()), float(whole.mean()),
            float(np.abs(total - whole).max() / whole.max()), INTEGRAL, "relative to the largest"))
        each = _springs(np.array([-_closed_form(body, _taxel_places(p)) for p in poses[:3]]))
        rows.append(Comparison("pads", f"{body.name}: one taxel, geometry written out anew", "N",
                               float(force[:3].max()), float(each.max()),
                               float(np.abs(force[:3] - each).max()), TAXEL_N))
        theirs = _in_mujoco(mujoco, body, poses[:3])
        rows.append(Comparison("pads", f"{body.name}: one taxel, MuJoCo's distance", "N",
                               float(force[:3].max()), float(theirs.max()),
                               float(np.abs(force[:3] - theirs).max()), 1e-3,
                               "MuJoCo's search stops at a micrometre, 1 mN"))
    return rows


def pad_surface(pose: np.ndarray, along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Places of the straight finger's distal pad: `along` [m] from its start, `across` its middle.

    Shapes broadcast; the result has one more axis of 3.
    """
    energy = FingerEnergy(_NOTHING, HAND, pose, FINGER)
    places, axes = energy.chain(np.zeros(4))
    up, side = (places[3] - places[2]) / HAND.link_length_m[2], axes[3]
    palmar = np.cross(side, up)
    radius = HAND.link_radius_m + PADS.thickness_m
    turn = (across / radius)[..., None]
    straight = PADS.length_m - PADS.wrap_rad * radius
    bend = np.maximum(along - straight, 0.0)[..., None] / radius
    foot = places[3] + up * np.minimum(along - straight, 0.0)[..., None]
    out = palmar * np.cos(bend) + up * np.sin(bend)
    return foot + radius * (out * np.cos(turn) + side * np.sin(turn))


def _taxel_places(pose: np.ndarray) -> np.ndarray:
    number = np.arange(TAXELS) + 0.5
    along, across = np.meshgrid(number * PADS.length_m / TAXELS,
                                (number - TAXELS / 2) * PADS.width_m / TAXELS, indexing="ij")
    return pad_surface(pose, along, across)


def _closed_form(body: Body, p: np.ndarray) -> np.ndarray:
    part = body.parts[0]
    r, _, h = part.size_m
    if part.shape == Shape.SPHERE:
        return np.linalg.norm(p - [0.0, 0.0, r], axis=-1) - r
    q = np.abs(p - [0.0, 0.0, h / 2]) - np.asarray(part.size_m) / 2
    if part.shape == Shape.CYLINDER:
        q = np.stack([np.hypot(p[..., 0], p[..., 1]) - r, q[..., 2]], -1)
    return np.linalg.norm(np.maximum(q, 0.0), axis=-1) + np.minimum(q.max(-1), 0.0)


def _springs(depth_m: np.ndarray) -> np.ndarray:
    """Force of taxels [N]: to the pad's thickness, and beyond it pressed flat."""
    depth = np.maximum(depth_m, 0.0)
    past = np.maximum(depth - PADS.thickness_m, 0.0)
    return PADS.stiffness_N_m * (depth - past) + PADS.flat_stiffness_N_m * past


def _integral(body: Body, pose: np.ndarray) -> float:
    """Load of the whole pad [N]: force a unit of area, over the pad."""
    along = np.linspace(0.0, PADS.length_m, _SAMPLES)
    across = np.linspace(-PADS.width_m / 2, PADS.width_m / 2, _SAMPLES)
    places = pad_surface(pose, *np.meshgrid(along, across, indexing="ij"))
    force = _springs(-_closed_form(body, places))
    return float(TAXELS**2 / _AREA_M2 * simpson(simpson(force, across), along))


def _presses(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Hand poses whose straight middle finger presses its pad on the body, and taxel forces."""
    rng = np.random.default_rng(4)
    poses = []
    for depth in np.linspace(0.0003, 0.0015, PRESSES):
        poses.append(_press(body, depth, rng))
    places = np.array(poses)
    n = len(places)
    images = read_pads(scene_of([body], "cpu"), np.zeros(1, int),
                       np.tile([0, 0, 0, 0, 0, 0, 1.0], (n, 1)), HAND, PADS,
                       np.arange(n, dtype=np.uint64), places, np.zeros((n, 4, 4)))
    return places, images.force_N[:, FINGER, 2]


def _press(body: Body, depth: float, rng: np.random.Generator) -> np.ndarray:
    """A hand, pointing down, moved along its palmar direction until the pad is in by `depth`."""
    height = body.high_m[2] * rng.uniform(0.45, 0.6)
    reach = HAND.abduction_offset_m + sum(HAND.link_length_m) - rng.uniform(0.002, 0.015)
    yaw = rng.uniform(-0.1, 0.1)
    # The fingers' palmar side faces +x of the hand, and the hand points down: quaternion (1,0,0,0)
    # turned about z; the body's near side is at low x.
    turn = np.array([np.cos(yaw / 2), np.sin(yaw / 2), 0.0, 0.0])
    low, high = -0.2, 0.05
    pose = np.array([0.0, 0.0, height + reach, *turn])
    along = np.linspace(0.0, PADS.length_m, 60)
    for _ in range(40):
        pose[0] = 0.5 * (low + high) + HAND.palm_gap_m / 2
        inside = -_closed_form(body, pad_surface(pose, along, np.zeros(60))).min()
        low, high = (low, 0.5 * (low + high)) if inside > depth else (0.5 * (low + high), high)
    return pose


def _in_mujoco(mujoco: Any, body: Body, poses: np.ndarray) -> np.ndarray:
    """Forces by MuJoCo's signed distance from a tiny ball at each taxel to the body."""
    ball = 1e-4
    text = mjcf_text([], object_solids(body), table=False).replace(
        "<worldbody>", '<worldbody><body name="taxel" mocap="true"><geom name="taxel" '
        f'type="sphere" size="{ball}"/></body>')
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.ccd_tolerance, model.opt.ccd_iterations = 1e-9, 200
    data = mujoco.MjData(model)
    taxel, solid = model.geom("taxel").id, model.geom("object_0").id
    force = np.zeros((len(poses), TAXELS, TAXELS))
    segment = np.zeros(6)
    places = np.array([_taxel_places(pose) for pose in poses])
    for k, row, column in np.ndindex(force.shape):
        data.mocap_pos[0] = places[k, row, column]
        mujoco.mj_kinematics(model, data)
        gap = mujoco.mj_geomDistance(model, data, taxel, solid, 1.0, segment) + ball
        force[k, row, column] = _springs(np.array(-gap))
    return force


_NOTHING = Body("nothing", (Part(Shape.SPHERE, size_m=(0.01, 0.0, 0.0)),), (0.0, 0.0, 0.0),
                (0.0, 0.0, 0.0))  # a finger's chain needs no body


def _ball() -> Body:
    return Body("ball", (Part(Shape.SPHERE, size_m=(0.03, 0.0, 0.0)),), (-0.03, -0.03, 0.0),
                (0.03, 0.03, 0.06))


def _block() -> Body:
    return Body("block", (Part(Shape.BLOCK, size_m=(0.06, 0.08, 0.12)),), (-0.03, -0.04, 0.0),
                (0.03, 0.04, 0.12))


def _cylinder() -> Body:
    return Body("cylinder", (Part(Shape.CYLINDER, size_m=(0.02, 0.0, 0.09)),), (-0.02, -0.02, 0.0),
                (0.02, 0.02, 0.09))
