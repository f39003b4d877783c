"""A figure of fits: the touches of each set over the body recovered from them."""

from typing import Any

import numpy as np

from fit.arrays import is_valid
from fit.fit_status import FitStatus, status_names
from fit.implicit.record import FreeForms
from fit.plane_record import PlaneFit
from fit.point_sets import PointSets
from fit.revolution.geometry import RevolutionBody
from fit.revolution.record import RevolutionFit
from fit.superquadric.geometry import Superquadric
from sweeps.figures.meshes import coarse_mesh, quadrilaterals, revolution_grid, surface_mesh
from sweeps.figures.solids import (
    CONTACT,
    direction,
    draw_solid,
    keep_labels_inside,
    normals,
    set_cube,
    visible,
)
from sweeps.figures.style import cut, drawing, encode, figure

MOST_SETS = 12
"""Sets drawn, the first of them."""
PANEL_IN = 2.4
ZOOM = 0.8
ELEVATION_DEG, AZIMUTH_DEG = 22.0, -55.0


@drawing()
def draw_fits(sets: PointSets, fits: Any, form: str) -> bytes:
    """The first sets of a batch, each in a panel of its own, as a png, svg or pdf file.

    `fits` is the `SuperquadricFit`, `PlaneFit`, `RevolutionFit` or `FreeForms` of `sets`. Touches
    behind a body are left out, and so are those that no fit can use (`FitStatus.bad_points`); a set
    without a fit is shown as its touches alone. The same fits give the same bytes.
    """
    shown = min(len(sets.names), MOST_SETS)
    columns = min(shown, 4)
    rows = -(-shown // columns)
    drawn = figure(PANEL_IN * rows, PANEL_IN * columns)
    words = status_names(fits.status[:shown])
    for row, (name, status) in enumerate(zip(sets.names, words, strict=False)):
        axes = drawn.add_subplot(rows, columns, row + 1, projection="3d")
        points = sets.touches_m[sets.slots(row)]
        points = 1e3 * points[is_valid(points).all(axis=1)]
        usable = status in (FitStatus.converged.name, FitStatus.not_converged.name)
        _draw(axes, points, 1e3 * _faces(fits, row) if usable else np.zeros((0, 4, 3)))
        words_of = [cut(name, 20) + ":"] + ([f"{fits.rms_m[row] * 1e3:.2f} mm rms"] if usable
                                            else [])
        words_of += [] if status == FitStatus.converged.name else [status]
        axes.set_title(" ".join(words_of[:2]) + ("\n" + words_of[2] if len(words_of) > 2 else ""))
    if shown < len(sets.names):
        drawn.suptitle(f"the first {shown} of {len(sets.names)} sets", fontsize=7.5)
    keep_labels_inside(drawn, ZOOM)
    return encode(drawn, form.lower())


def _draw(axes: Any, points: np.ndarray, faces: np.ndarray) -> None:
    """Touches and the faces (face, 3 or 4, 3) of a body [mm]; a single one is a plane, hiding none.
    """
    if not len(points):
        axes.set_axis_off()
        return
    eye = direction(AZIMUTH_DEG, ELEVATION_DEG)
    seen = np.ones(len(points), bool)
    if len(faces) == 1:
        draw_solid(axes, faces, normals(faces)[0])
    elif len(faces):
        draw_solid(axes, faces, eye)
        seen = visible(points, faces, eye)
    axes.computed_zorder = False
    axes.scatter(*points[seen].T, s=8, color=CONTACT, depthshade=False, zorder=10)
    set_cube(axes, np.concatenate([points, faces.reshape(-1, 3)]), 0.52, 1.0, ZOOM)
    axes.view_init(ELEVATION_DEG, AZIMUTH_DEG)


def _faces(fits: Any, row: int) -> np.ndarray:
    """The surface of one fit, (face, 3 or 4, 3) [m]."""
    if isinstance(fits, FreeForms):
        mesh = fits.mesh[row]
        return coarse_mesh(mesh).corners_m if len(mesh.faces) else mesh.corners_m
    if isinstance(fits, PlaneFit):
        u, v = 0.5 * fits.extent_m[row][:, None] * fits.axes[row]
        centre = fits.centre_m[row]
        return np.stack([centre - u - v, centre + u - v, centre + u + v, centre - u + v])[None]
    if isinstance(fits, RevolutionFit):
        # Finer rings than the fit's nodes, since each face has one colour.
        heights = np.linspace(0, fits.height_m[row], 41)
        nodes = np.linspace(0, fits.height_m[row], fits.radius_m.shape[1])
        radii = np.interp(heights, nodes, fits.radius_m[row])
        return quadrilaterals(revolution_grid(RevolutionBody(
            fits.position_m[row:row + 1], fits.axis[row:row + 1], heights[None], radii[None]),
            0, 72))
    return surface_mesh(Superquadric(*(getattr(fits, name)[row:row + 1]
                                       for name in Superquadric._fields)))
