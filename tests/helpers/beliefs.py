"""Beliefs for tests of planners: two worlds with an upright cylinder, felt where a test says."""

from types import SimpleNamespace

import numpy as np

from fit.superquadric.geometry import superquadric
from strategies.contacts.finger_touch import no_links
from strategies.poses.waypoints import BoundingCylinder
from strategies.recovery.belief import Belief
from strategies.recovery.evidence import Evidence
from warpgrasp.parameters import ArmTable, ErrorTable, HandTable, SensorTable

BODY = superquadric((0.035, 0.035, 0.07), (0.1, 1.0), [(0.45, 0.0, 0.07), (0.45, 0.02, 0.07)])


def belief(points: np.ndarray | None = None) -> Belief:
    """Two worlds with a cylinder believed; `points` (2, n, 3) were felt."""
    points = np.zeros((2, 0, 3)) if points is None else points
    n = points.shape[1]
    evidence = Evidence(points, np.ones((2, n), bool), np.tile(np.eye(3) * 1e-6, (2, n, 1, 1)),
                        np.full(points.shape, np.nan), np.zeros((2, 0, 3)), 0.006,
                        np.zeros((2, 0), bool), np.zeros((2, n), bool),
                        np.zeros((2, n)))
    prior = BoundingCylinder(*(np.array(v) for v in (
        (0.45, 0.45), (0.0, 0.02), (0.035, 0.035), (0.14, 0.14))))
    zero = np.zeros(2)
    return Belief(step=0, active=np.ones(2, bool), prior=prior, seed=np.arange(2).astype(np.uint64),
                  arm=ArmTable(), hand=HandTable(), sensors=SensorTable(),
                  closings=("curl40", "base_then_curl"), evidence=evidence,
                  fits=SimpleNamespace(), fitted=np.ones(2, bool),  # pyright: ignore
                  body=BODY, faces=(), profile=None, shape=np.ones(2, int),
                  touches=zero.astype(int), time_s=zero, path_m=zero,
                  links=no_links(2, n, HandTable()), errors=ErrorTable.none())


def on_side(angle_low: float, angle_high: float, n: int = 40) -> np.ndarray:
    """Points of the cylinders' sides between two azimuths [deg]."""
    rng = np.random.default_rng(0)
    angle = np.radians(rng.uniform(angle_low, angle_high, n))
    ring = np.stack([0.035 * np.cos(angle), 0.035 * np.sin(angle), rng.uniform(-0.06, 0.06, n)], 1)
    return BODY.position_m[:, None] + ring
