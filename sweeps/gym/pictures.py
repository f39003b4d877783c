"""Pictures of worlds: the body recovered so far, what was felt, and the true body's outline."""

from typing import Any

import numpy as np

from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered
from sweeps.figures.meshes import quadrilaterals, recovered_grid, turned_mesh
from sweeps.figures.solids import CONTACT, TRUE, direction, draw_solid, set_cube
from sweeps.figures.style import drawing, figure
from warpgrasp.geometry.body import Body

ELEVATION_DEG, AZIMUTH_DEG = 22.0, -55.0
_SIDE_IN = 2.4


@drawing()
def picture(belief: Belief, recovered: Recovered, body: Body, body_pose: np.ndarray,
            world: int) -> np.ndarray:
    """One world as an RGB image, uint8 (row, column, 3). Points are the true body."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    pose = body_pose[world]
    vertices, _ = turned_mesh(body, pose, 24)
    true = 1e3 * vertices
    faces = 1e3 * (quadrilaterals(recovered_grid(recovered, world)) - pose[:3])
    evidence = belief.evidence
    points = 1e3 * (evidence.points_m[world][evidence.mask[world]] - pose[:3])

    drawn = figure(_SIDE_IN, _SIDE_IN)
    drawn.set_layout_engine("none")
    axes: Any = drawn.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    axes.computed_zorder = False
    draw_solid(axes, faces, direction(AZIMUTH_DEG, ELEVATION_DEG))
    thin = true[::max(1, len(true) // 600)]
    axes.scatter(*thin.T, s=1, color=TRUE, depthshade=False, zorder=5)
    axes.scatter(*points.T, s=9, color=CONTACT, depthshade=False, zorder=10)
    set_cube(axes, true, 0.6, 60.0, 1.25)
    axes.view_init(ELEVATION_DEG, AZIMUTH_DEG)
    axes.set_axis_off()
    canvas = FigureCanvasAgg(drawn)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
