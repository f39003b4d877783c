"""What a body was felt by, as its uncertainty takes it: contacts, and how far the next one is."""

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import KDTree

from strategies.contacts.finger_touch import TouchedLinks

FARTHEST_M = 0.1
"""A place farther than this from every contact counts as this far."""
FOOT_M = 0.006
"""Lower places are the foot, where a body is known to stand."""


@dataclass(frozen=True)
class Felt:
    """Contacts of each world. Shapes start with (world, point)."""

    points_m: np.ndarray
    mask: np.ndarray
    covariance_m2: np.ndarray
    contradicted: np.ndarray
    """Which of them contradict the body they were placed on, bool."""
    by_pad: np.ndarray
    """Which of them a pad felt, bool."""

    def contradicted_share(self) -> np.ndarray:
        """Of all contacts, (world,)."""
        return self.contradicted.sum(1) / np.maximum(self.mask.sum(1), 1)


def packed(felt: Felt, links: TouchedLinks, rows: np.ndarray, width: int
           ) -> tuple[Felt, TouchedLinks]:
    """The contacts of the worlds `rows`, in order, in `width` slots."""
    order = np.argsort(~felt.mask[rows], axis=1, kind="stable")[:, :width]
    pad = max(0, width - order.shape[1])

    def taken(record: Felt | TouchedLinks) -> dict[str, np.ndarray]:
        moved = {}
        for f in fields(record):
            values = getattr(record, f.name)
            if isinstance(values, np.ndarray):
                index = order.reshape(*order.shape, *([1] * (values.ndim - 2)))
                moved[f.name] = np.pad(np.take_along_axis(values[rows], index, 1),
                                       [(0, 0), (0, pad)] + [(0, 0)] * (values.ndim - 2))
        return moved

    return replace(felt, **taken(felt)), replace(links, **taken(links))


def unfelt_distance(points_m: np.ndarray, felt: Felt) -> np.ndarray:
    """Distance [m] of points (world, point, 3) from the nearest contact that does not contradict
    the body, at most `FARTHEST_M`; 0 at the foot, where the body is known to stand."""
    use = felt.mask & ~felt.contradicted
    away = np.array([KDTree(c[u]).query(p)[0] if u.any() else np.full(len(p), FARTHEST_M)
                     for p, c, u in zip(points_m, felt.points_m, use, strict=True)])
    return np.where(points_m[..., 2] > FOOT_M, np.minimum(away, FARTHEST_M), 0.0)
