"""Figures after the paper's figures 4, 5 and 6; the same data give the same bytes."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from fit.superquadric.geometry import Superquadric
from sweeps.figures.meshes import surface_mesh
from sweeps.figures.solids import CONTACT, FIT, TRUE
from sweeps.paper.bottles import WAYS, Followed, contour_of
from sweeps.paper.contacts import FINGERTIP
from sweeps.paper.faces import Explored
from sweeps.paper.recovery import ALL, PLAIN, TORQUES, Grasped, median_world, of_way
from warpgrasp.objects.catalogue import body_from_name

_BODY, _SECTIONS = "#c9d8e8", "#2a9d8f"


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def draw_recovered(found: Sequence[Grasped]) -> bytes:
    """Figure 4: recovered bodies and contacts of the episode of median IoU; a row as the paper has
    it, and one with all evidence."""
    rows = [of_way(list(found), *way) for way in ((FINGERTIP, PLAIN), (TORQUES, ALL))]
    figure = Figure(figsize=(2.3 * len(found), 2.9 * len(rows)), dpi=100)
    for place, r in enumerate(r for row in rows for r in row):
        axes: Any = figure.add_subplot(len(rows), len(found), place + 1, projection="3d")
        world = median_world(r)
        pose = r.body_pose[world]
        body = Superquadric(*(f[world:world + 1] for f in r.bodies))
        faces = 1e3 * (surface_mesh(body, rows=12) - pose[:3])
        points = 1e3 * (r.evidence.points_m[world][r.evidence.mask[world]] - pose[:3])
        axes.add_collection3d(Poly3DCollection(list(faces), facecolors=_BODY, edgecolors=FIT,
                                               linewidths=0.25, alpha=0.55))
        axes.scatter(*points.T, s=4, color=CONTACT, depthshade=False)
        tall = 1.1e3 * body_from_name(r.name).high_m[2]
        wide = 0.7 * tall
        axes.set(xlim=(-wide / 2, wide / 2), ylim=(-wide / 2, wide / 2), zlim=(0, tall))
        axes.set_box_aspect((0.7, 0.7, 1.0))
        axes.set_axis_off()
        axes.view_init(18, -60)
        axes.set_title(f"{r.name}\n{r.contacts}, {r.fit}\n{len(points)} contacts, "
                       f"IoU {r.scores.iou[world]:.2f}", fontsize=8)
    figure.subplots_adjust(0.0, 0.0, 1.0, 0.92, 0.0, 0.18)
    return _png(figure)


def draw_faces(default: Explored, poor: Explored) -> bytes:
    """Figure 5: touches on two adjacent faces, and the distribution of the angle."""
    figure = Figure(figsize=(9.0, 3.8), dpi=110, layout="constrained")
    axes: Any = figure.add_subplot(1, 2, 1, projection="3d")
    for exploration, colour in zip(default.faces, (CONTACT, FIT), strict=True):
        table = exploration.touches
        mine = (table.world == 0) & np.isfinite(table.point_m[:, 0])
        axes.scatter(*(1e3 * (table.point_m[mine] - default.body_pose[0, :3])).T, s=6,
                     color=colour, depthshade=False)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", zlim=(0, 130))
    axes.set_title("touches on two faces of a block", fontsize=9)
    axes.view_init(22, 130)
    flat = figure.add_subplot(1, 2, 2)
    edges = np.linspace(75.0, 105.0, 61)
    for e, colour, label in ((default, FIT, "default"), (poor, CONTACT,
                                                         f"{poor.case.source}: {poor.case.size}")):
        flat.hist(np.clip(e.angle_deg, edges[0], edges[-1]), bins=list(edges), alpha=0.6,
                  color=colour, label=label, density=True)
    flat.axvline(96.0, color=TRUE, ls="--", lw=1)
    flat.text(96.2, flat.get_ylim()[1] * 0.9, "printed: 96", fontsize=8)
    flat.set(xlabel="angle between the planes [deg]", ylabel="density")
    flat.set_title("angle of two faces, truth 90", fontsize=9)
    flat.legend(fontsize=7)
    return _png(figure)


def draw_bottles(found: Sequence[Followed]) -> bytes:
    """Figure 6: a panel for each bottle, of the world whose refined contour has the median
    volume."""
    figure = Figure(figsize=(2.3 * len(found), 4.2), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(found), sharey=True)
    for axes, f in zip(panels, found, strict=True):
        ours = f.contours[WAYS[1]].profile
        volume = np.where(f.ended, ours.volume_m3, np.nan)
        world = int(np.argsort(np.nan_to_num(volume, nan=np.inf))[f.ended.sum() // 2])
        z, r = 1e3 * contour_of(f.name).T
        axes.plot(np.r_[r, -r[::-1]], np.r_[z, z[::-1]], color=TRUE, lw=1, label="true")
        for way, style, label in zip(WAYS, ("-", "--"), ("sections", "refined"), strict=True):
            p = f.contours[way].profile
            known = np.isfinite(p.height_m[world])
            h, rho = 1e3 * p.height_m[world][known], 1e3 * p.radius_m[world][known]
            colour = FIT if way == WAYS[1] else _SECTIONS
            axes.plot(rho, h, style, color=colour, lw=1.2, label=label)
            axes.plot(-rho, h, style, color=colour, lw=1.2)
        table = f.exploration.touches
        mine = (table.world == world) & np.isfinite(table.point_m[:, 0])
        p = 1e3 * table.point_m[mine]
        side = np.where(table.finger[mine] == 3, -1.0, 1.0)
        axes.plot(side * np.hypot(p[:, 0] - 450.0, p[:, 1]), p[:, 2], ".", color=CONTACT, ms=3,
                  label="touches")
        axes.set_aspect("equal")
        axes.set_title(f"{f.name}\n{volume[world] * 1e6:.0f} ml", fontsize=8)
        axes.set_xlabel("r [mm]")
    panels[0].set_ylabel("z [mm]")
    panels[-1].legend(fontsize=6, loc="upper right")
    return _png(figure)
