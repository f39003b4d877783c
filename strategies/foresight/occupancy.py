"""Where an object may be, in cells, by its prior and by what has been felt of it.

A cell's value is the probability that a ball of a link's radius, centred in it, touches the object
(an occupancy grid, Elfes 1989, of the space in which links move). It begins with the prior, is
raised and lowered beside contacts as their normals say, is low where links have swept freely, and
rises where the open hand was barred. The numbers marked [est] are guesses of everyday objects.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy.special import ndtr

from strategies.foresight.hand_samples import SweptFingers
from strategies.foresight.occupancy_kernel import (
    barred_kernel,
    chance_kernel,
    learn_kernel,
    worth_kernel,
)
from strategies.foresight.prospect_kernel import foresee_kernel
from strategies.poses.waypoints import BoundingBox, BoundingCylinder
from strategies.procedures.depth_prior import SeenBox, believed_after
from warpgrasp.core.dtypes import real, transform, vec3
from warpgrasp.core.kernel_launch import launch

CELLS = (40, 40, 28)
"""Of every grid, along x, y, z."""
FINEST_M = 0.004
MARGIN_M = 0.025
"""Of the grid about the prior; objects outside are not looked for."""
PRIOR_SIGMA_M = 0.012
"""Of the prior's sides and top [est]."""
AT_RIM, AT_AXIS = 0.03, 0.80
"""Probability of an object at the prior's rim and at its axis [est]."""
NEAR_M = 0.010
"""What a contact covers."""
WORTH_REACH_M = 0.036
_SHAPES = {"corner": "world", "cell": "world", "contact": "world contact", "normal":
           "world contact", "weight": "world contact", "felt": "world contact", "free":
           "world free", "free_count": "world", "hit": "world cells", "cap": "world cells",
           "worth": "world cells", "chance": "world cells", "open_ball": "open", "hand_pose":
           "world pose", "barred": "world pose", "swept_ball": "finger place ball", "feels":
           "finger ball", "met": "finger", "meets": "finger", "wanted": "world pose", "gain":
           "world pose finger", "place": "world pose finger", "stopped": "world pose finger"}


@dataclass(frozen=True)
class Prospect:
    """What poses are expected to bring. Shapes start with (world, pose)."""

    barred: np.ndarray
    """Probability that the open hand strikes something."""
    gain: np.ndarray
    """Expected worth of each finger's touch, from 0 to 1, (..., finger)."""
    place_m: np.ndarray
    """Likeliest place of each finger's touch, (..., finger, 3)."""


class Occupancy:
    """The grids of a batch of worlds; what is learned changes them."""

    def __init__(self, corner_m: np.ndarray, cell_m: np.ndarray, hit: np.ndarray,
                 radius_m: float) -> None:
        """`hit` (world, cells) begins the grids, whose lowest corners are `corner_m` (world, 3) and
        whose cells are `cell_m` (world,) wide; links have `radius_m`."""
        self.corner_m, self.cell_m, self.radius_m = corner_m, cell_m, radius_m
        self.hit = hit.astype(np.float32)
        self.cap = np.ones_like(self.hit)

    @property
    def believed(self) -> np.ndarray:
        """The probabilities, (world, x, y, z)."""
        return np.minimum(self.hit, self.cap).reshape(-1, *CELLS)

    def learn_touches(self, contact_m: np.ndarray, normal: np.ndarray, weight: np.ndarray,
                      free_m: np.ndarray, free_count: np.ndarray) -> None:
        """Contacts (world, contact, 3) with outward unit normals and weights from 0 (none) to 1;
        then balls (world, free, 3), of which the first `free_count` (world,) swept freely."""
        self._launch(learn_kernel, {"world": len(self.hit)}, contact=_vectors(contact_m),
                     normal=_vectors(normal), weight=wp.array(weight, dtype=real, device="cpu"),
                     free=_vectors(free_m), radius=self.radius_m,
                     free_count=wp.array(free_count, dtype=int, device="cpu"))

    def learn_barred(self, open_m: np.ndarray, hand_pose: np.ndarray, barred: np.ndarray) -> None:
        """Poses (world, pose, 7) at which the open hand, balls at `open_m` (ball, 3), was `barred`
        (world, pose)."""
        self._launch(barred_kernel, {"world": len(self.hit)}, open_ball=_vectors(open_m),
                     hand_pose=wp.array(hand_pose, dtype=transform, device="cpu"),
                     barred=wp.array(barred, dtype=wp.bool, device="cpu"))

    def worth(self, contact_m: np.ndarray, felt: np.ndarray) -> np.ndarray:
        """What a touch in each cell is worth beside contacts (world, contact, 3), (world, cells).
        """
        worth = np.ones_like(self.hit)
        self._launch(worth_kernel, {"world": len(self.hit)}, contact=_vectors(contact_m),
                     felt=wp.array(felt, dtype=wp.bool, device="cpu"), radius=self.radius_m,
                     near=NEAR_M, reach=WORTH_REACH_M, worth=_shared(worth))
        return worth

    def foresee(self, open_m: np.ndarray, swept: SweptFingers, hand_pose: np.ndarray,
                wanted: np.ndarray, worth: np.ndarray, lowest_m: float) -> Prospect:
        """What hand poses (world, pose, 7) would bring; touches by balls lower than `lowest_m` are
        taken for the table's."""
        worlds, poses = hand_pose.shape[:2]
        barred = np.ones((worlds, poses))
        fingers = len(swept.met)
        gain, stopped = (np.zeros((worlds, poses, fingers)) for _ in range(2))
        place = np.zeros((worlds, poses, fingers, 3))
        chance = np.empty_like(self.hit)
        self._launch(chance_kernel, {"world": worlds}, chance=_shared(chance))
        self._launch(foresee_kernel, {"world": worlds, "pose": poses}, radius=self.radius_m,
                     lowest=lowest_m, open_ball=_vectors(open_m),
                     swept_ball=_vectors(swept.balls_m),
                     feels=wp.array(swept.feels, dtype=wp.bool, device="cpu"),
                     met=_numbers(swept.met), meets=_numbers(swept.meets),
                     hand_pose=wp.array(hand_pose, dtype=transform, device="cpu"),
                     wanted=wp.array(wanted, dtype=wp.bool, device="cpu"), worth=_shared(worth),
                     chance=_shared(chance),
                     barred=wp.array(barred, dtype=real, device="cpu", copy=False),
                     gain=wp.array(gain, dtype=real, device="cpu", copy=False),
                     place=wp.array(place, dtype=vec3, device="cpu", copy=False),
                     stopped=wp.array(stopped, dtype=real, device="cpu", copy=False))
        return Prospect(barred, gain, place)

    def _launch(self, kernel: object, extents: dict[str, int], **given: object) -> None:
        names = {argument.label for argument in kernel.adj.args}  # type: ignore[attr-defined]
        grid = {"corner": _vectors(self.corner_m), "cell": wp.array(self.cell_m, dtype=real,
                                                                    device="cpu"),
                "n": wp.vec3i(*CELLS), "hit": _shared(self.hit), "cap": _shared(self.cap)}
        arguments = {name: value for name, value in grid.items() if name in names} | given
        launch(kernel, extents, _SHAPES, arguments, device="cpu")


def begin_occupancy(prior: BoundingCylinder, radius_m: float) -> Occupancy:
    """What the prior alone says: likelier towards its axis, hardly beyond its sides and top."""
    reach = prior.radius_m + MARGIN_M
    high = prior.height_m + MARGIN_M
    size = np.maximum(np.maximum(2 * reach / CELLS[0], high / CELLS[2]), FINEST_M)
    corner = np.stack([prior.x_m - size * CELLS[0] / 2, prior.y_m - size * CELLS[1] / 2,
                       np.zeros(len(size))], 1)
    middle = [(np.arange(count) + 0.5)[None] * size[:, None] + corner[:, axis, None]
              for axis, count in enumerate(CELLS)]
    x = middle[0][:, :, None] - prior.x_m[:, None, None]
    y = middle[1][:, None, :] - prior.y_m[:, None, None]
    if isinstance(prior, BoundingBox):
        cos, sin = np.cos(prior.yaw_rad)[:, None, None], np.sin(prior.yaw_rad)[:, None, None]
        along, across = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)
        half = prior.half_m[:, :, None, None]
        outside = np.maximum(along - half[:, 0], across - half[:, 1])
        share = np.maximum(along / half[:, 0], across / half[:, 1])
    else:
        far = np.hypot(x, y)
        outside = far - prior.radius_m[:, None, None]
        share = far / prior.radius_m[:, None, None]
    over = middle[2] - prior.height_m[:, None]
    within = ndtr((radius_m - outside) / PRIOR_SIGMA_M) * (
        AT_RIM + (AT_AXIS - AT_RIM) * np.clip(1.0 - share, 0.0, 1.0) ** 2)
    hit = within[..., None] * ndtr((radius_m - over) / PRIOR_SIGMA_M)[:, None, None]
    if isinstance(prior, SeenBox):
        places = np.stack(np.broadcast_arrays(
            middle[0][:, :, None, None], middle[1][:, None, :, None], middle[2][:, None, None]), -1)
        hit = believed_after(prior.view, hit.reshape(len(size), -1),
                             places.reshape(len(size), -1, 3), radius_m)
    return Occupancy(corner, size, hit.reshape(len(size), -1), radius_m)


def _numbers(values: np.ndarray) -> wp.array:
    return wp.array(values, dtype=int, device="cpu")


def _vectors(values: np.ndarray) -> wp.array:
    return wp.array(np.ascontiguousarray(values, float), dtype=vec3, device="cpu")


def _shared(values: np.ndarray) -> wp.array:
    """A view of an array that a kernel writes to."""
    return wp.array(values, dtype=wp.float32, device="cpu", copy=False)
