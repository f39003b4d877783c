"""Views for a report without running an episode."""

import base64

import numpy as np
from curved_episodes import OBJECTS

from fit.superquadric.geometry import superquadric
from sweeps.figures.meshes import surface_grid
from sweeps.report.views import Picked, Views, body_data, episode_data
from sweeps.run.plan import Plan
from warpgrasp.objects.catalogue import body_from_name


def drawn_views(plan: Plan, picked: list[Picked], device: str = "cpu",
                workers: int = 1, say: object = None) -> Views:
    """Views of the right size without running an episode: an ellipsoid and 120 contacts each."""
    points = np.random.default_rng(1).normal(0, 0.03, (120, 3))
    grid = surface_grid(superquadric(np.array([[0.03, 0.03, 0.06]]), np.array([[1.0, 1.0]])), 16)
    pose = np.array([0, 0, 0, 0, 0, 0, 1.0])
    return Views(
        {name: body_data(body_from_name(name)) for name in OBJECTS[:len(plan.study.objects)]},
        [{"place": p.place, "strategy": plan.study.strategies[p.episode.strategy].name,
          "object": plan.study.objects[p.episode.body].name, "episode": p.episode.episode,
          "chamfer_mm": p.chamfer_mm, "iou": 0.5, "status": "ok",
          "unsure": base64.b64encode(bytes(60 for _ in range(16 * 32))).decode(),
          **episode_data(grid, pose, points)} for p in picked], [])
