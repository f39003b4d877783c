"""The hand as balls of a link's radius: where it is open, and where its fingers sweep.

A capsule is taken as the balls along its axis, the palm and the wrist as balls just within their
surface. All places are in the hand's frame and depend on the tables of the hand alone.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import pi

import numpy as np
from scipy.spatial import ConvexHull

from fit.rotation import matrix_of_quaternion
from strategies.foresight.hand_meetings import hand_meetings
from strategies.procedures.containment import padded_commands
from strategies.procedures.possible import check_foreseeable
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import HandTable

STRIDE = 6
"""Steps of half a degree between two places of a finger that are looked at."""
BALLS = 3
"""Along a link, its end among them."""
THIN = 6
"""Of how many places of a path a first look takes one; of twice as many balls of the open hand."""
APPROACH_M, APPROACH_STEP_M = 0.12, 0.008
"""The way in, and how often it is looked at."""


@dataclass(frozen=True)
class SweptFingers:
    """The fingers along one closing path."""

    balls_m: np.ndarray
    """Centres, (finger 4, place, ball, 3)."""
    joints_rad: np.ndarray
    """Commands, (finger 4, place, 4)."""
    met: np.ndarray
    """Place at which each finger touches another or the palm, where nothing is in the way; the
    number of places where none, int (finger 4,)."""
    meets: np.ndarray
    """The finger it touches there; -1 the palm or none, int (finger 4,)."""


@dataclass(frozen=True)
class HandSamples:
    """The open hand, and its fingers along every closing path."""

    open_m: np.ndarray
    """Centres of balls that fill the open hand and its way in, (ball, 3)."""
    swept: tuple[SweptFingers, ...]
    """One for each closing path."""

    @cached_property
    def outermost_m(self) -> np.ndarray:
        """Those of `open_m` that no others are around, (corner, 3): the lowest is one of them,
        however the hand is turned."""
        return self.open_m[ConvexHull(self.open_m).vertices]

    @cached_property
    def thinned(self) -> "HandSamples":
        """A tenth of the samples, for a first look at many poses: the ends of links alone, at a few
        places of a path."""
        return HandSamples(self.open_m[::2 * THIN], tuple(
            SweptFingers(swept.balls_m[:, ::THIN, BALLS - 1::BALLS], swept.joints_rad[:, ::THIN],
                         -(-swept.met // THIN), swept.meets) for swept in self.swept))


@lru_cache(maxsize=8)
def samples_of_hand(hand: HandTable, closings: tuple[str, ...]) -> HandSamples:
    """Samples of the Utah-MIT hand for closing paths named in `CLOSING_PATHS`. Raises NotPossible
    for another hand."""
    check_foreseeable(hand)
    commands, count = padded_commands(closings)
    swept = []
    for path, steps in zip(commands, count, strict=True):
        kept = np.append(np.arange(0, steps - 1, STRIDE), steps - 1)
        joints = _joints(hand, path[:, kept])
        swept.append(SweptFingers(_balls(joints), path[:, kept], *hand_meetings(hand, joints)))
    fingers = _balls(_joints(hand, commands[0][:, :1])).reshape(-1, 3)
    ahead = np.stack([s.balls_m[:, 0, -2 * BALLS:].reshape(-1, 3) for s in swept[:1]])[0]
    back = APPROACH_STEP_M * np.arange(1, int(APPROACH_M / APPROACH_STEP_M) + 1)
    way = ahead[:, None] - back[:, None] * np.array([0.0, 0.0, 1.0])
    return HandSamples(np.concatenate([way.reshape(-1, 3), fingers, _palm(hand)]), tuple(swept))


def _joints(hand: HandTable, commands_rad: np.ndarray) -> np.ndarray:
    """Flexion joints and tips of commands (finger 4, place, 4), (finger, place, 4, 3) [m]."""
    pose = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (commands_rad.shape[1], 1))
    points, _ = hand_links(hand, pose, commands_rad.swapaxes(0, 1))
    return points[:, :, 1:].swapaxes(0, 1)


def _balls(joints_m: np.ndarray) -> np.ndarray:
    """Along the links between joints (finger, place, 4, 3): (finger, place, ball, 3)."""
    share = np.arange(1, BALLS + 1)[:, None] / BALLS
    start, end = joints_m[:, :, :-1, None], joints_m[:, :, 1:, None]
    return (start + share * (end - start)).reshape(*joints_m.shape[:2], -1, 3)


def _palm(hand: HandTable) -> np.ndarray:
    """Within the palm's slab and the wrist, (ball, 3)."""
    thick, radius = hand.palm_thickness_m, hand.link_radius_m
    x = np.linspace(-1, 1, 5) * (hand.palm_gap_m / 2 + thick / 2 - radius)
    y = np.linspace(-1, 1, 5) * (hand.finger_spacing_m + thick / 2 - radius)
    face = np.stack(np.meshgrid(x, y, [-radius, radius - thick]), -1).reshape(-1, 3)
    turn = np.arange(4) * pi / 2
    ring = (thick / 2 - radius) * np.stack([np.cos(turn), np.sin(turn)], -1)
    z = -np.linspace(thick, hand.mount_length_m, 4)
    wrist = np.concatenate([np.tile(ring, (len(z), 1)), np.repeat(z, 4)[:, None]], 1)
    return np.concatenate([face, wrist])


def lowest_of_hand(samples: HandSamples, hand: HandTable, hand_pose: np.ndarray) -> np.ndarray:
    """Height of the lowest place of the open hand, way in and all, at poses (..., 7) [m], (...)."""
    down = matrix_of_quaternion(hand_pose[..., 3:])[..., 2, :, None]
    x, y, z = samples.outermost_m.T  # sums written out: they do not round by the batch
    height = down[..., 0, :] * x + down[..., 1, :] * y + down[..., 2, :] * z
    return height.min(-1) + hand_pose[..., 2] - hand.link_radius_m


def reached_place(swept: SweptFingers, finger: np.ndarray, q_rad: np.ndarray) -> np.ndarray:
    """Which place of the path is nearest to where fingers (k,) stand, by joints (k, 4) as read,
    (k,)."""
    apart = np.linalg.norm(swept.joints_rad[finger] - q_rad[:, None], axis=-1)
    return apart.argmin(1)
