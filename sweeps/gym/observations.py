"""What a learner is shown of a belief, as one row of numbers a world."""

from collections.abc import Sequence

import numpy as np

from strategies.poses.waypoints import BoundingBox
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered
from strategies.recovery.evidence import CONTOUR_TOUCHES, FACE_TOUCHES
from sweeps.episode.columns import superquadric_parameters

BOUND = 10.0
"""Of every number of an observation but one."""
BEND_PER_M = 100.0
"""Bound of the curvature of a bent body: a radius of 10 mm."""
PRIOR, BODY, MODELS, SHARES, CONTACT = 8, 16, 3, 3, 5
"""Numbers of the prior, the body, the model it is of, the shares, and one contact."""
_BEND = 14
"""Where among the body's numbers its curvature is."""
FEWEST_FINGERS = 4
"""Fingers that there are slots for at least, so that hands of three and four fingers are observed
alike."""


def contact_slots(procedures: Sequence[str], closings: int, probes: int, fingers: int) -> int:
    """The most contacts that an episode can make with a hand of so many fingers, or of four."""
    most = {"containment": max(FEWEST_FINGERS, fingers) * closings, "planar": FACE_TOUCHES,
            "contour": CONTOUR_TOUCHES}
    return probes * max(most[name] for name in procedures)


def observation_size(slots: int) -> int:
    """Numbers of one world's observation."""
    return PRIOR + BODY + MODELS + SHARES + CONTACT * slots


def observation_bounds(slots: int) -> np.ndarray:
    """The largest magnitude of each number of an observation."""
    bounds = np.full(observation_size(slots), BOUND)
    bounds[PRIOR + _BEND] = BEND_PER_M
    return bounds


def observe(belief: Belief, recovered: Recovered, made: float, slots: int) -> np.ndarray:
    """Observations (world, number), in the order of `GraspVectorEnv`'s description.

    `made` is the share of the budget of probes that is spent.
    """
    prior = belief.prior
    zero = np.zeros(belief.worlds)
    box = [zero, zero, zero, zero]
    if isinstance(prior, BoundingBox):
        box = [*prior.half_m.T, np.cos(2 * prior.yaw_rad), np.sin(2 * prior.yaw_rad)]
    felt = belief.evidence.mask
    models = recovered.shape[:, None] == np.arange(MODELS)
    shares = np.stack([felt.sum(1) / slots, (felt & belief.evidence.by_pad).sum(1) / slots,
                       zero + made], 1)
    rows = np.concatenate([
        np.stack([prior.x_m, prior.y_m, prior.radius_m, prior.height_m, *box], 1),
        np.stack(list(superquadric_parameters(recovered.superquadric).values()), 1),
        models, shares, _contacts(belief, slots).reshape(belief.worlds, -1)], 1)
    bounds = observation_bounds(slots)
    return np.clip(np.nan_to_num(rows), -bounds, bounds)


def _contacts(belief: Belief, slots: int) -> np.ndarray:
    """All contacts so far in the prior's frame, the earliest first, (world, slot, 5)."""
    evidence = belief.evidence
    order = np.argsort(~evidence.mask, axis=1, kind="stable")[:, :slots]
    mask = np.take_along_axis(evidence.mask, order, 1)
    points = np.take_along_axis(evidence.points_m, order[..., None], 1)
    by_pad = np.take_along_axis(evidence.by_pad, order, 1)
    foot = np.stack([belief.prior.x_m, belief.prior.y_m, np.zeros(belief.worlds)], 1)
    found = np.zeros((belief.worlds, slots, CONTACT))
    found[:, :order.shape[1]] = np.where(mask[..., None], np.concatenate(
        [mask[..., None], by_pad[..., None], points - foot[:, None]], -1), 0.0)
    return found
