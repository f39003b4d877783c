"""Tactile pads: where taxels are, what they bear, what the converter reads.

A pad of 16 x 16 taxels lies on the palmar face of a link, bent with it across, the distal one also
over the fingertip. A taxel bears k * depth, depth being how far its place lies inside body or table
by the true signed distance (elastic foundation). Rows run along the link towards the tip, columns
along the flexion axis.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.chain.chain_hand import ChainHand
from warpgrasp.chain.chain_pads import pad_places
from warpgrasp.core.array_checks import check_poses, check_range
from warpgrasp.core.dtypes import real, transform, vec2, vec4
from warpgrasp.core.kernel_launch import ShapeError, launch
from warpgrasp.core.struct_array import record_type, repeated
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.calibration import Calibration
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, LINK_COUNT, hand_of
from warpgrasp.parameters import TAXELS, HandTable, PadTable
from warpgrasp.touch.pad_culling import BLOCKS
from warpgrasp.touch.pad_kernel import ChainPad, Pad, _pads_kernel

TURNS = 40
"""Rows of `pad_turns` a pad."""


def pad_of(table: PadTable, hand: HandTable) -> Pad:
    """The kernels' pad. Raises ValueError for a pad that does not fit its links, or whose
    readings no force changes."""
    if wrong := table.misfit(hand):
        raise ValueError(wrong)
    pad = _pad(table)
    pad.on = wp.vec3i(int(table.proximal), int(table.middle), int(table.distal))
    return pad


def _pad(table: PadTable) -> Pad:
    """A finger's pads, none of them on."""
    if wrong := table.insensitive():
        raise ValueError(wrong)
    pad = Pad()
    pad.width, pad.length, pad.wrap = table.width_m, table.length_m, table.wrap_rad
    pad.thickness, pad.stiffness = table.thickness_m, table.stiffness_N_m
    pad.flat = table.flat_stiffness_N_m
    pad.law = int(table.law != "exponential")
    pad.rest_ohm, pad.least_ohm = table.rest_ohm, table.least_ohm
    pad.force_scale, pad.newton_ohm, pad.power = table.force_scale_N, table.newton_ohm, table.power
    pad.reference_ohm, pad.floor = table.reference_ohm, table.floor_N
    pad.saturation, pad.gain_spread = table.saturation_N, table.gain_spread
    pad.repeatability, pad.noise = table.repeatability, table.noise_counts
    pad.dead, pad.threshold = table.dead_fraction, table.threshold_counts
    pad.yield_angle = table.yield_rad
    pad.false_touch = table.false_touch_probability()
    pad.gain = wp.vec3d(1.0, 1.0, 1.0)
    return pad


@lru_cache(maxsize=8)
def true_pads(table: PadTable, hand: HandTable, errors: Calibration, device: str) -> wp.array:
    """The true pads as kernels take them, (world or 1, finger 4)."""
    rows = repeated(pad_of(table, hand), Pad, (errors.worlds, FINGER_COUNT))
    rows["shift"], rows["gain"] = errors.pad_shift_m, errors.pad_gain
    return wp.array(rows, dtype=Pad, device=device)


@lru_cache(maxsize=32)
def chain_pads(hand: ChainHand, finger: int, table: PadTable, device: str) -> tuple[Pad, wp.array]:
    """The pads of a finger that is a chain as they are believed, and their rows, (pad 3,), which
    are to be kept as long; `table` has the hand's own size (`own_pads`)."""
    pad, places = _pad(table), pad_places(hand, finger, table)
    names = [joint.name for joint in hand.model.fingers[finger].joints]
    rows = np.zeros(LINK_COUNT, record_type(ChainPad))
    for row, place in zip(rows, places, strict=False):
        row["joint"] = names.index(place.joint)
        row["start"], row["end"], row["out"] = place.start, place.end, place.out
        row["radius"], row["bends"] = place.radius, place.joint == names[-1]
    pad.on = wp.vec3i(*(int(n < len(places)) for n in range(LINK_COUNT)))
    kept = wp.array(rows, dtype=ChainPad, device=device)
    address: Any = kept.ptr
    pad.places = address
    return pad, kept


@lru_cache(maxsize=32)
def true_chain_pads(
    hand: ChainHand, table: PadTable, errors: Calibration, device: str
) -> tuple[wp.array, Any]:
    """The true pads of all fingers, (world or 1, finger), and what is to be kept as long.

    A link's length stretches the place of its pad as all that stands in its frame.
    """
    worlds = errors.worlds
    believed = [chain_pads(hand, f, table, "cpu") for f in range(hand.fingers)]
    rows = np.zeros((worlds, hand.fingers), record_type(Pad))
    places = np.zeros((worlds, hand.fingers, LINK_COUNT), record_type(ChainPad))
    world = np.arange(worlds)[:, None]
    for f, (pad, own) in enumerate(believed):
        rows[:, f], places[:, f] = repeated(pad, Pad, (1,)), own.numpy()
        joint = places["joint"][:, f]
        stretch = 1.0 + errors.link_length_share[world, f, joint]
        places["start"][:, f] *= stretch[..., None]
        places["end"][:, f] *= stretch[..., None]
        rows["shift"][:, f] = errors.pad_shift_m[world, f, joint]
        rows["gain"][:, f] = errors.pad_gain[world, f, joint]
    kept = wp.array(places, dtype=ChainPad, device=device)
    address: Any = kept.ptr
    stride: Any = kept.strides[1]
    number = np.arange(rows.size, dtype=np.uint64).reshape(rows.shape)
    rows["places"] = np.uint64(address) + number * np.uint64(stride)
    return wp.array(rows, dtype=Pad, device=device), kept


@dataclass(frozen=True)
class PadImages:
    """One reading of all pads. Shapes start with (pose, finger 4, link 3, row 16, column 16)."""

    counts: np.ndarray
    """Converter counts, uint8; 0 where a link has no pad."""
    force_N: np.ndarray
    """True force on each taxel, for the scorer alone."""


def read_pads(
    scene: Scene,
    body: np.ndarray,
    body_pose: np.ndarray,
    hand: HandTable,
    pads: PadTable,
    key: np.ndarray,
    hand_pose: np.ndarray,
    q_rad: np.ndarray,
    *,
    reading: int = 0,
    device: str = "cpu",
) -> PadImages:
    """Read every pad of hands held still at given joints.

    `body` (pose or 1,), `body_pose` and true `hand_pose` (pose, 7) [m], quaternion xyzw, base
    frame; `q_rad` (pose, finger 4, 4); `key` (pose,) uint64, an episode's: its taxels keep their
    gains, `reading` numbers the readings. Raises ShapeError, and ValueError for a body that the
    scene has not, and for a pose that is no place and unit quaternion.
    """
    poses = len(hand_pose)
    for name, value, shape in (("body_pose", body_pose, (poses, 7)),
                               ("hand_pose", hand_pose, (poses, 7)),
                               ("q_rad", q_rad, (poses, FINGER_COUNT, 4))):
        if np.shape(value) != shape:
            raise ShapeError(f"{name}: of shape {np.shape(value)}; should be {shape}")
    check_poses("body_pose", np.asarray(body_pose))
    check_poses("hand_pose", np.asarray(hand_pose))
    check_range("body", body, 0, scene.bodies - 1)
    n = len(hand_pose)
    force = wp.zeros((n, FINGER_COUNT * LINK_COUNT, TAXELS, TAXELS), dtype=real, device=device)
    count = wp.zeros(force.shape, dtype=wp.uint8, device=device)
    launch(_pads_kernel, {"pose": n, "finger": FINGER_COUNT, "link": LINK_COUNT}, {
        "body": "pose?", "body_pose": "pose", "key": "pose", "hand_pose": "pose",
        "q": "pose finger", "force": "pose 12 16 16", "count": "pose 12 16 16"}, {
        "scene": scene, "body": wp.array(body, dtype=int, device=device),
        "body_pose": wp.array(body_pose, dtype=transform, device=device),
        "hand": hand_of(hand), "pad": pad_of(pads, hand),
        "key": wp.array(key, dtype=wp.uint64, device=device),
        "hand_pose": wp.array(hand_pose, dtype=transform, device=device),
        "q": wp.array(q_rad, dtype=vec4, device=device), "reading": reading,
        "force": force, "count": count}, device=device)
    shape = (n, FINGER_COUNT, LINK_COUNT, TAXELS, TAXELS)
    return PadImages(count.numpy().reshape(shape).copy(), force.numpy().reshape(shape).copy())


@lru_cache(maxsize=32)
def pad_turns(pads: PadTable, hand: HandTable, device: str) -> wp.array:
    """The parts of the taxels' places that do not depend on the finger, as (sin, cos) on a device.

    The turns of columns about a link's axis (`pad_column`), the bends of rows over the fingertip
    (`pad_bend`), then both for the middles of blocks. Kept for the next launch.
    """
    return wp.array(_turns(pads, hand.link_radius_m), dtype=vec2, device=device)


@lru_cache(maxsize=32)
def chain_pad_turns(pads: PadTable, hand: ChainHand, finger: int, device: str) -> wp.array:
    """The same of each pad of a chain, one after the other."""
    turns = [_turns(pads, place.radius) for place in pad_places(hand, finger, pads)]
    return wp.array(np.concatenate([*turns, np.zeros((LINK_COUNT * TURNS, 2))])[
        :LINK_COUNT * TURNS], dtype=vec2, device=device)


def _turns(pads: PadTable, link_radius_m: float) -> np.ndarray:
    radius = link_radius_m + pads.thickness_m
    straight = pads.length_m - pads.wrap_rad * radius
    taxel = np.arange(TAXELS) + 0.5
    middle = taxel.reshape(BLOCKS, -1).mean(1)

    def column(place: np.ndarray) -> np.ndarray:
        return (place / TAXELS - 0.5) * pads.width_m / radius

    def row(place: np.ndarray) -> np.ndarray:
        return (place * pads.length_m / TAXELS - straight) / radius

    angle = np.concatenate([column(taxel), row(taxel), column(middle), row(middle)])
    return np.stack([np.sin(angle), np.cos(angle)], 1)
