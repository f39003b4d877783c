"""Where an object may be, in cells, by its prior and by what has been felt of it.

A cell's value is the probability that a ball of a link's radius, centred in it, touches the object
(an occupancy grid, Elfes 1989, of the space in which links move). It begins with the prior, is
raised and lowered beside contacts as their normals say, is low where links have swept freely, and
rises where the open hand was barred. The numbers marked [est] are guesses of everyday objects.
"""

from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
import warp as wp
from scipy.special import ndtr

from strategies.foresight.cpu_launch import launch_on_cpu
from strategies.foresight.hand_samples import SweptFingers
from strategies.foresight.occupancy_kernel import barred_kernel, learn_kernel, swept_kernel
from strategies.foresight.prospect_kernel import (
    BORDER,
    LANES,
    MOST_FINGERS,
    Looks,
    foresee_kernel,
    looked_up_kernel,
)
from strategies.poses.waypoints import PRIOR_MARGIN_M, BoundingBox, BoundingCylinder
from strategies.procedures.depth_prior import SeenBox, believed_after
from warpgrasp.core.array_checks import check_range

CELLS = (40, 40, 28)
"""Of every grid, along x, y, z."""
FINEST_M = 0.004
MARGIN_M = 0.025
"""Of the grid about a prior that is as sure as by default; objects outside are not looked for."""
SIGMA_OF_MARGIN = 0.4
"""Standard deviation of the prior's sides and top, of its margin [est]."""
AT_RIM, AT_AXIS = 0.03, 0.80
"""Probability of an object at the prior's rim and at its axis [est]."""
SURE = 0.97
"""Of a touch: what is met more surely is not passed."""
PLACES_APART = 60
"""So many places of the open hand and its way in bar it each by itself, however many balls stand
for them: beliefs of neighbours go together [est]."""
ON_TABLE_M = 0.0005
"""Links that close are not stopped by the table before."""
_SHAPES = {"corner": "world", "cell": "world", "contact": "world contact", "normal":
           "world contact", "weight": "world contact", "came":
           "world pose", "until": "world pose finger", "hit": "world cells", "cap": "world cells",
           "worth": "world cells", "chance": "world padded", "value": "world padded", "open_ball":
           "open", "hand_pose": "world pose", "barred": "world pose", "swept_ball":
           "finger place ball", "feels": "finger ball", "met": "finger", "meets": "finger",
           "wanted": "world pose", "gain": "world pose finger", "place": "world closely finger"}


@dataclass(frozen=True)
class Prospect:
    """What poses are expected to bring. Shapes start with (world, pose)."""

    barred: np.ndarray
    """Probability that the open hand strikes something. Gains do not fall with it: a pose that is
    barred costs no touch, and tells where the object is."""
    gain: np.ndarray
    """Expected worth of each finger's touch, from 0 to 1, (..., finger)."""
    place_m: np.ndarray
    """Likeliest place of each finger's touch, (..., finger, 3); zeros where it gains nothing."""


class Occupancy:
    """The grids of a batch of worlds; what is learned changes them."""

    def __init__(self, corner_m: np.ndarray, cell_m: np.ndarray, hit: np.ndarray,
                 radius_m: float) -> None:
        """`hit` (world, cells) begins the grids, whose lowest corners are `corner_m` (world, 3) and
        whose cells are `cell_m` (world,) wide; links have `radius_m`."""
        self.corner_m, self.cell_m, self.radius_m = corner_m, cell_m, radius_m
        self.hit = np.array(hit, np.float32)
        self.cap = np.ones_like(self.hit)

    @property
    def believed(self) -> np.ndarray:
        """The probabilities, (world, x, y, z)."""
        return np.minimum(self.hit, self.cap).reshape(-1, *CELLS)

    def learn_touches(self, contact_m: np.ndarray, normal: np.ndarray, weight: np.ndarray) -> None:
        """Contacts (world, contact, 3) with outward unit normals and weights from 0 (none) to 1."""
        self._launch(learn_kernel, {"world": len(self.hit)}, ("hit",), contact=contact_m,
                     normal=normal, weight=weight, radius=self.radius_m)

    def learn_swept(self, open_m: np.ndarray, swept: SweptFingers, hand_pose: np.ndarray,
                    came: np.ndarray, until: np.ndarray) -> None:
        """The open hand, balls at `open_m` (ball, 3), `came` to poses (world, pose, 7), bool
        (world, pose), and its fingers closed freely as far as places of their paths before `until`,
        int (world, pose, finger)."""
        check_range("place", until, 0, swept.balls_m.shape[1])
        self._launch(swept_kernel, {"world": len(self.hit)}, ("cap",), open_ball=open_m,
                     swept_ball=swept.balls_m, hand_pose=hand_pose, came=came, until=until)

    def learn_barred(self, open_m: np.ndarray, hand_pose: np.ndarray, barred: np.ndarray) -> None:
        """Poses (world, pose, 7) at which the open hand, balls at `open_m` (ball, 3), was `barred`
        (world, pose)."""
        self._launch(barred_kernel, {"world": len(self.hit)}, ("hit", "cap"), open_ball=open_m,
                     hand_pose=hand_pose, barred=barred, share=_share(open_m))

    def foresee(self, open_m: np.ndarray, swept: SweptFingers, hand_pose: np.ndarray,
                wanted: np.ndarray, worth: np.ndarray, lowest_m: float,
                closely: bool = True) -> Prospect:
        """What hand poses (world, pose, 7) would bring; touches by balls lower than `lowest_m` are
        taken for the table's. Places are left out, (world, 0, finger, 3), unless it looks
        `closely`. Raises ValueError for a hand of more than `MOST_FINGERS`."""
        worlds, poses = hand_pose.shape[:2]
        fingers = len(swept.met)
        check_range("fingers", fingers, 1, MOST_FINGERS)
        barred, gain = np.empty((worlds, poses)), np.empty((worlds, poses, fingers))
        place = np.empty((worlds, poses if closely else 0, fingers, 3))
        padded = prod(count + 2 * BORDER for count in CELLS)
        chance, value = (np.zeros((worlds, padded), np.float32) for _ in range(2))
        self._launch(looked_up_kernel, {"world": worlds}, ("chance", "value"), worth=worth,
                     chance=chance, value=value)
        looks = Looks()
        looks.floor, looks.table = self.radius_m, self.radius_m - ON_TABLE_M
        looks.lowest, looks.sure = lowest_m, SURE
        looks.share = _share(open_m)
        self._launch(foresee_kernel, {"world": worlds, "group": -(-poses // LANES)},
                     ("barred", "gain", "place"), looks=looks, closely=closely,
                     open_ball=open_m, swept_ball=swept.balls_m, feels=swept.feels, met=swept.met,
                     meets=swept.meets, hand_pose=hand_pose, wanted=wanted, chance=chance,
                     value=value, barred=barred, gain=gain, place=place)
        return Prospect(barred, gain, place)

    def _launch(self, kernel: Any, extents: dict[str, int], writes: tuple[str, ...],
                **given: Any) -> None:
        names = {argument.label for argument in kernel.adj.args}
        grid = {"corner": self.corner_m, "cell": self.cell_m, "n": wp.vec3i(*CELLS),
                "hit": self.hit, "cap": self.cap}
        launch_on_cpu(kernel, extents, _SHAPES, writes, **{
            name: value for name, value in grid.items() if name in names}, **given)


def _share(open_m: np.ndarray) -> float:
    """How much of a place that bars the open hand by itself each of its balls is."""
    return min(PLACES_APART / len(open_m), 1.0)


def begin_occupancy(prior: BoundingCylinder, radius_m: float) -> Occupancy:
    """What the prior alone says: likelier towards its axis, hardly beyond its sides and top."""
    margin = MARGIN_M + prior.margin_m - PRIOR_MARGIN_M
    sigma = SIGMA_OF_MARGIN * prior.margin_m
    reach = prior.radius_m + margin
    high = prior.height_m + margin
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
    within = ndtr((radius_m - outside) / sigma) * (
        AT_RIM + (AT_AXIS - AT_RIM) * np.clip(1.0 - share, 0.0, 1.0) ** 2)
    hit = within[..., None] * ndtr((radius_m - over) / sigma)[:, None, None]
    if isinstance(prior, SeenBox):
        places = np.stack(np.broadcast_arrays(
            middle[0][:, :, None, None], middle[1][:, None, :, None], middle[2][:, None, None]), -1)
        hit = believed_after(prior.view, hit.reshape(len(size), -1),
                             places.reshape(len(size), -1, 3), radius_m)
    return Occupancy(corner, size, hit.reshape(len(size), -1), radius_m)
