"""Labels of axes in space lie in the figure, whatever is drawn."""

import io

import numpy as np
import pytest
import trimesh
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial.transform import Rotation

from fit.plane import fit_plane
from fit.point_sets import PointSets
from sweeps.figures.contacts import ContactsShown, _drawn
from sweeps.figures.fits import draw_fits
from sweeps.figures.grasp import grasp_figure
from sweeps.figures.replay_frames import Frame, HandShape, Replay
from sweeps.report.surfaces import SurfacesShown, surfaces_figure


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("height_m", [0.001, 0.05])
def test_nothing_is_cut_off_at_the_border_of_fits(count: int, height_m: float) -> None:
    draw = np.random.default_rng(0)
    points = draw.normal(size=(count, 40, 3))
    points *= [0.05, 0.05, height_m] / np.linalg.norm(points, axis=2, keepdims=True)
    points += [0.45, 0.0, 0.2]
    sets = PointSets(tuple(f"set {n}" for n in range(count)), points.reshape(-1, 3),
                     np.full(count, 40))
    drawn = draw_fits(sets, fit_plane(points), "png")
    picture = np.asarray(Image.open(io.BytesIO(drawn)).convert("L"))
    assert picture.min() < 128
    for border in (picture[:2], picture[-2:], picture[:, :2], picture[:, -2:]):
        assert (border == 255).all()


def upright_hand() -> Replay:
    """A finger far above a cylinder, which makes the box narrow and tall."""
    finger = np.array([[[[0.45, 0.0, height], [0.45, 0.0, height - 0.05]]
                        for height in (0.3, 0.25)]])
    body = trimesh.creation.cylinder(0.03, 0.1).apply_translation([0.45, 0.0, 0.05])
    frame = Frame(np.array([[0.0, 0.0, 0.0], [0.45, 0.0, 0.32]]),
                  Rotation.from_euler("y", 180.0, degrees=True).as_quat(), finger, np.ones(1),
                  1, -1, "grasp 1")
    return Replay("", (frame,), np.array([[0.45, 0.0, 0.1]]), (), np.array(body.vertices),
                  np.array(body.faces),
                  HandShape(((0.008, 0.008),), np.zeros((1, 2, 3)), np.array([0.02])))


def test_labels_of_a_grasp_lie_above_its_legend() -> None:
    drawn = grasp_figure(upright_hand(), "ring6 on a cylinder")
    drawn.draw_without_rendering()
    pen = FigureCanvasAgg(drawn).get_renderer()
    legend = drawn.legends[0].get_window_extent(pen)
    axes = drawn.axes[0]
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):  # type: ignore[attr-defined]
        label = axis.label.get_window_extent(pen)
        assert label.y0 >= legend.y1
        assert label.x0 >= 0.0
        assert label.x1 <= drawn.bbox.x1


def bottle(height_mm: float = 320.0) -> np.ndarray:
    """Faces of a slender cylinder that stands on the table, (face, corner, 3) in mm."""
    body = trimesh.creation.cylinder(37.0, height_mm).apply_translation([0.0, 0.0, height_mm / 2])
    return np.asarray(body.triangles)


def test_no_axes_of_surfaces_hide_the_labels_of_others() -> None:
    """Where a label stands the whole figure is as dark as its axes are alone."""
    faces = bottle()
    drawn = surfaces_figure(SurfacesShown("bottle", "recovered", faces, faces,
                                          np.full(len(faces), 0.003), np.zeros((0, 3))))
    drawn.draw_without_rendering()
    drawn.set_layout_engine("none")
    whole = painted(drawn)
    every = drawn.axes
    for axes in every[:4]:
        for other in every:
            other.set_visible(other is axes)
        alone = painted(drawn)
        pen = FigureCanvasAgg(drawn).get_renderer()
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):  # type: ignore[attr-defined]
            x0, y0, x1, y1 = axis.label.get_window_extent(pen).extents.astype(int)
            rows = slice(len(whole) - y1, len(whole) - y0)
            assert (alone[rows, x0:x1] < 128).any()
            assert (whole[rows, x0:x1] <= alone[rows, x0:x1]).all()


def painted(drawn: Figure) -> np.ndarray:
    """The grey values of a figure, (row, column)."""
    canvas = FigureCanvasAgg(drawn)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].min(-1)


@pytest.mark.parametrize("wide", [True, False])
def test_contacts_on_the_outline_are_whole(wide: bool) -> None:
    """They lie as far from the frame as their marks are wide."""
    points = np.array([[-38.0, 0, 100], [38, 0, 100], [0, -38, 100], [0, 38, 100], [0, 0, 321]])
    near = np.array([True, True, False, False, True])
    drawn = _drawn(ContactsShown("bottle", "recovered body", False, bottle(), bottle(), points,
                                 near), wide)
    drawn.draw_without_rendering()
    for flat, places in zip(drawn.axes[1:], (points[:, [0, 2]], points[:, :2]), strict=True):
        at = flat.transData.transform(places)
        room = np.minimum(at - flat.bbox.min, flat.bbox.max - at)
        assert room.min() >= 1.25 * drawn.dpi / 72.0
