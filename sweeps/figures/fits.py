"""A figure of fits: the touches of each set over the body recovered from them.

In the style of `figure_contacts`: the body seen from one side, and only the touches on that side;
what lies behind the body is hidden.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.fit_status import FitStatus, status_names
from fit.plane import PlaneFit
from fit.points_csv import PointSets
from fit.revolution.fit import revolution_inside
from fit.revolution.record import RevolutionFit
from fit.superquadric.geometry import Superquadric, superquadric_inside_outside
from sweeps.figures.meshes import surface_mesh

MOST_SETS = 12
"""Sets drawn, the first of them."""
_BODY = "#9db7d5"
_TOUCH = "#b2182b"
_ELEVATION_DEG, _AZIMUTH_DEG = 22.0, -55.0
_SHRUNK = 0.96
"""Touches lie on the surface but for noise: sight is blocked by a body a little smaller."""


@dataclass(frozen=True)
class _Solid:
    faces: np.ndarray
    """Quadrilaterals, (face, 4, 3) [m]."""
    blocks: Callable[[np.ndarray], np.ndarray] | None
    """Which points [m] (point, 3) lie well inside; None for what hides nothing."""


def draw_fits(sets: PointSets, fits: Any, form: str) -> bytes:
    """The first sets of a batch, each in a panel of its own, as a png, svg or pdf file.

    `fits` is the `SuperquadricFit`, `PlaneFit` or `RevolutionFit` of `sets`; a set without a fit is
    shown as its touches alone. The same fits give the same bytes.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    shown = min(len(sets.names), MOST_SETS)
    columns = min(shown, 4)
    rows = -(-shown // columns)
    with matplotlib.rc_context({"svg.hashsalt": "warpgrasp", "text.parse_math": False}):
        figure = plt.figure(figsize=(3.6 * columns, 3.6 * rows), dpi=150, layout="constrained")
        words = status_names(fits.status[:shown])
        for row, (name, status) in enumerate(zip(sets.names, words, strict=False)):
            axes = figure.add_subplot(rows, columns, row + 1, projection="3d")
            points = sets.points[row][sets.mask[row]]
            points = points[np.isfinite(points).all(axis=1)]
            usable = status in (FitStatus.converged.name, FitStatus.not_converged.name)
            _draw(axes, points, _solid(fits, row) if usable else None)
            axes.set_title(f"{name}: {fits.rms_m[row] * 1e3:.2f} mm rms" if usable
                           else f"{name}: {status}", fontsize=9)
        if shown < len(sets.names):
            figure.suptitle(f"the first {shown} of {len(sets.names)} sets", fontsize=9)
        content = io.BytesIO()
        dates = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
        form = form.lower()
        figure.savefig(content, format=form, metadata=dates[form])
        plt.close(figure)
    return content.getvalue()


def _draw(axes: Any, points: np.ndarray, solid: _Solid | None) -> None:
    from matplotlib.colors import to_rgb
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    elevation, azimuth = np.radians([_ELEVATION_DEG, _AZIMUTH_DEG])
    eye = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
                    np.sin(elevation)])
    if not len(points):
        axes.set_axis_off()
        return
    corners, seen = points, np.ones(len(points), bool)
    if solid is not None:
        faces = solid.faces
        normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        if solid.blocks is not None:
            middle = faces.mean(axis=1)
            # The meshes run one way round: outward where most of them look away from the middle.
            outward = np.sign(((middle - middle.mean(0)) * normal).sum(1).sum())
            normal = normal * (outward or 1.0)
            seen = ~_behind(points, eye, solid)
            facing = normal @ eye > 0
            faces, normal = faces[facing], normal[facing]
        light = 0.55 + 0.45 * np.clip(normal @ np.array([0.3, -0.6, 0.74]), 0.0, 1.0)
        colour = np.concatenate([np.array(to_rgb(_BODY)) * light[:, None],
                                 np.ones((len(faces), 1))], axis=1)
        axes.add_collection3d(Poly3DCollection(list(1e3 * faces), facecolors=colour,
                                               edgecolors=colour, linewidths=0.3,
                                               zsort="average", zorder=1))
        corners = np.concatenate([points, solid.faces.reshape(-1, 3)])
    axes.computed_zorder = False
    axes.scatter(*(1e3 * points[seen]).T, s=12, color=_TOUCH, depthshade=False, zorder=10)
    low, high = 1e3 * corners.min(axis=0), 1e3 * corners.max(axis=0)
    middle, half = 0.5 * (low + high), 0.52 * np.maximum((high - low).max(), 1e-3)
    axes.set(xlim=(middle[0] - half, middle[0] + half),
             ylim=(middle[1] - half, middle[1] + half),
             zlim=(middle[2] - half, middle[2] + half))
    axes.set_box_aspect((1, 1, 1), zoom=0.85)
    axes.view_init(_ELEVATION_DEG, _AZIMUTH_DEG)
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True):
        axis.set_major_locator(MaxNLocator(4))
        axis.set_label_text(f"{name} [mm]", fontsize=7)
        axis.set_tick_params(labelsize=6)


def _behind(points: np.ndarray, eye: np.ndarray, solid: _Solid) -> np.ndarray:
    """Which points the body hides: those whose line of sight runs through its inside."""
    assert solid.blocks is not None
    corners = solid.faces.reshape(-1, 3)
    reach = np.linalg.norm(np.ptp(corners, axis=0))
    along = np.linspace(0.0, 1.5 * reach, 90)
    ray = points[:, None] + along[:, None] * eye
    inside = solid.blocks(ray.reshape(-1, 3)).reshape(len(points), -1)
    return np.any(inside, axis=1, keepdims=True)[:, 0]


def _solid(fits: Any, row: int) -> _Solid:
    if isinstance(fits, PlaneFit):
        u, v = 0.5 * fits.extent_m[row][:, None] * fits.axes[row]
        centre = fits.centre_m[row]
        return _Solid(np.stack([centre - u - v, centre + u - v, centre + u + v,
                                centre - u + v])[None], None)
    if isinstance(fits, RevolutionFit):
        return _revolution(fits, row)
    body = Superquadric(*(getattr(fits, name)[row:row + 1] for name in Superquadric._fields))
    return _Solid(surface_mesh(body),
                  lambda p: superquadric_inside_outside(body, p[None])[0] < _SHRUNK)


def _revolution(fits: RevolutionFit, row: int) -> _Solid:
    axis, foot, height = fits.axis[row], fits.position_m[row], fits.height_m[row]
    x = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    x = x / np.linalg.norm(x)
    around = np.linspace(0, 2 * np.pi, 73)
    ring = np.cos(around)[:, None] * x + np.sin(around)[:, None] * np.cross(axis, x)
    nodes = np.linspace(0, height, fits.radius_m.shape[1])
    # Finer rings than nodes, for faces are painted by their middle; then the flat ends.
    heights = np.linspace(0, height, 41)
    radii = np.interp(heights, nodes, fits.radius_m[row])
    heights, radii = np.r_[0, heights, height], np.r_[0, radii, 0]
    grid = foot + heights[:, None, None] * axis + radii[:, None, None] * ring
    faces = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]],
                     axis=2).reshape(-1, 4, 3)
    one = replace(fits, **{name: value[row:row + 1] for name, value in vars(fits).items()})
    small = replace(one, radius_m=one.radius_m * _SHRUNK, height_m=one.height_m * _SHRUNK,
                    position_m=one.position_m + 0.5 * (1 - _SHRUNK) * height * axis)
    return _Solid(faces, lambda p: revolution_inside(small, p[None])[0])
