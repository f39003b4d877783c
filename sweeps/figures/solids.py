"""Solids on three axes in millimetres and their outlines, as the figures of bodies share them."""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BODY, CONTACT, TRUE, FIT = "#9db7d5", "#b2182b", "#4d4d4d", "#2166ac"
LIGHT = np.array([0.3, -0.6, 0.74])
PIXELS = 384
"""Of the longer side of the picture that an outline is traced in."""
SHRINK, MOST_SHRINKS = 0.97, 20
"""How much smaller axes get at a time, and how often, for labels that would be cut off."""
EDGE_PX = 2.0
"""At the border of a figure of 100 dots per inch, where no label may be."""
_EDGE = 4
"""Pixels around the body, so that its outline closes."""
_SMOOTH = 1.0
"""Standard deviation [pixels] of the blur that makes an outline of steps a curve."""


def direction(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    """Unit vector from the origin towards azimuth and elevation."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
                     np.sin(elevation)])


def normals(faces: np.ndarray) -> np.ndarray:
    """Unit normals of triangles or quadrilaterals (face, 3 or 4, 3), outward if anticlockwise."""
    normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, -1] - faces[:, 1])
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


def lit(faces: np.ndarray, colour: str | np.ndarray, light: np.ndarray = LIGHT) -> np.ndarray:
    """Colours of faces, one `colour` or one each, under a light from the direction `light`,
    (face, 3)."""
    from matplotlib.colors import to_rgb

    share = 0.55 + 0.45 * np.clip(normals(faces) @ light, 0.0, 1.0)
    own = np.array(to_rgb(colour)) if isinstance(colour, str) else colour
    return own * share[:, None]


def draw_solid(axes: Any, faces: np.ndarray, eye: np.ndarray,
               tint: str | np.ndarray = BODY, light: np.ndarray = LIGHT) -> None:
    """Draws those faces (face, 4, 3) of a body that look towards the direction `eye`, in one colour
    or in one each, (face, 3)."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    seen = normals(faces) @ eye > 0.0
    faces = faces[seen]
    colours = lit(faces, tint if isinstance(tint, str) else tint[seen], light)
    axes.add_collection3d(Poly3DCollection(
        list(faces), facecolors=colours, edgecolors=colours, linewidths=0.3, zsort="average",
        zorder=1), autolim=False)


def visible(points: np.ndarray, faces: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Which points are nearest to a face that looks towards the direction `eye`, (point,)."""
    if len(points) == 0:
        return np.zeros(0, bool)
    middle = faces.mean(axis=1)
    nearest = np.argmin(((points[:, None] - middle[None]) ** 2).sum(-1), axis=1)
    return normals(faces)[nearest] @ eye > 0.0


def set_box(axes: Any, low: np.ndarray, high: np.ndarray, zoom: float,
            ticks: tuple[int, int, int] = (4, 4, 4)) -> None:
    """Limits [mm] at equal scales, with labels and about `ticks` intervals on each axis."""
    from matplotlib.ticker import MaxNLocator

    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]),
             xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.zaxis.set_rotate_label(False)
    axes.zaxis.label.set_rotation(90.0)  # reads upwards
    axes.set_box_aspect(tuple(high - low), zoom=zoom)
    for axis, count in zip((axes.xaxis, axes.yaxis, axes.zaxis), ticks, strict=True):
        axis.set_major_locator(MaxNLocator(count))


def set_cube(axes: Any, cloud: np.ndarray, share: float, least_mm: float, zoom: float) -> None:
    """A cube about points; half its side is `share` of their extent, or of `least_mm` if larger."""
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    middle, half = (low + high) / 2, share * max((high - low).max(), least_mm)
    set_box(axes, middle - half, middle + half, zoom)


def keep_labels_inside(drawn: "Figure", zoom: float) -> None:
    """Zooms all axes of a figure that holds nothing else, smaller until no label is cut off or lies
    in the legend below."""
    every: list[Any] = drawn.axes
    for shrunk in zoom * SHRINK ** np.arange(MOST_SHRINKS):
        for axes in every:
            sides = [np.ptp(ends) for ends in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())]
            axes.set_box_aspect(sides, zoom=shrunk)
        drawn.draw_without_rendering()
        if _labels_inside(drawn):
            return


def _labels_inside(drawn: "Figure") -> bool:
    """Whether all axes' labels and numbers lie in the figure as it was drawn last. Axes that are
    off have no labels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    pen = FigureCanvasAgg(drawn).get_renderer()
    floor = max((legend.get_window_extent(pen).y1 for legend in drawn.legends), default=EDGE_PX)
    every: list[Any] = drawn.axes
    found = [axis.get_tightbbox(pen) for axes in every if axes.get_zlabel()
             for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    right, top = drawn.bbox.x1 - EDGE_PX, drawn.bbox.y1 - EDGE_PX
    return all(box.x0 >= EDGE_PX and box.x1 <= right and box.y0 >= floor and box.y1 <= top
               for box in found if box is not None)


def silhouette(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which places the faces of a body cover, its faces (face, corner, 2) seen along an axis,
    concavities and holes included.

    Coordinates of columns and of rows, and the covered share (row, column) from 0 to 1.
    """
    from PIL import Image, ImageDraw
    from scipy.ndimage import gaussian_filter

    low, high = faces.reshape(-1, 2).min(0), faces.reshape(-1, 2).max(0)
    step = float((high - low).max()) / PIXELS
    count = np.ceil((high - low) / step).astype(int) + 1 + 2 * _EDGE
    picture = Image.new("L", (int(count[0]), int(count[1])))
    pen = ImageDraw.Draw(picture)
    for corners in (faces - low) / step + _EDGE:
        pen.polygon([(float(x), float(y)) for x, y in corners], fill=255, outline=255)
    covered = gaussian_filter(np.asarray(picture, float) / 255, _SMOOTH)
    x, y = (low[k] + step * (np.arange(count[k]) - _EDGE) for k in (0, 1))
    return x, y, covered


def draw_outline(axes: Any, faces: np.ndarray, colour: str, style: str, label: str) -> None:
    """Draws the outline of a body, its faces (face, corner, 2) seen along an axis."""
    x, y, covered = silhouette(faces)
    axes.contour(x, y, covered, levels=[0.5], colors=[colour], linestyles=[style],
                 linewidths=1.2)
    axes.plot([], [], style, color=colour, lw=1.2, label=label)  # contours have no legend
