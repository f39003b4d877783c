"""What two cameras see of round objects: the place, tilt, radius and height of their axes.

The paper leaves the axis of exploration to vision. Each case switches on one fault of the images.
"""

from dataclasses import dataclass, field, fields

import numpy as np

from strategies.procedures.stereo_axis import see_axis
from strategies.procedures.stereo_prior import see_cylinder
from sweeps.paper.recovery import SEED
from sweeps.text_table import number_text
from warpgrasp.geometry.outline import radius_around
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, HandTable, SensorTable, StereoTable
from warpgrasp.robot import Robot, Truth

OBJECTS = ("large_cylinder", "wine_bottle", "orangina_bottle")
AIM_SIGMA_M = 0.010
"""The cameras are turned to where the object is believed to be; estimated."""
_FAULTS = {"missing_edges": 0.2, "spurious_edges": 5, "clutter": 3, "flipped_pixels": 0.05}


@dataclass(frozen=True)
class View:
    """Images with the same faults."""

    table: StereoTable

    @property
    def switched_on(self) -> str:
        """What differs from images without faults."""
        on = [f"{f.name} {getattr(self.table, f.name):g}" for f in fields(StereoTable)
              if (f.name in _FAULTS or f.name == "pixel_noise") and getattr(self.table, f.name)]
        return ", ".join(on) or "no fault"


def views() -> list[View]:
    """Clean images, each fault alone beside the default noise, and all together."""
    clean = {"pixel_noise": 0.0}
    each = [{name: value} for name, value in _FAULTS.items()]
    more = [{name: 2 * value} for name, value in _FAULTS.items()]
    rows = [clean, {}, {"pixel_noise": 1.0}]
    rows += [row for pair in zip(each, more, strict=True) for row in pair]
    rows.append({"pixel_noise": 1.0, **_FAULTS})
    return [View(StereoTable(**row)) for row in rows]  # type: ignore[arg-type]


@dataclass(frozen=True)
class Seen:
    """Errors over all objects, of the pairs of images in which something was found."""

    view: View
    pairs: int
    tilt_deg: np.ndarray
    """Of the axis from Hough lines, (found,)."""
    place_mm: np.ndarray
    """Of the axis of the cylinder, where the whole of it was in both images, (whole,)."""
    radius_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Seen less true, (whole,)."""
    height_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))


def see_objects(worlds: int, chosen: list[View] | None = None) -> list[Seen]:
    """Every view of every object, from the same places."""
    return [_see(view, worlds) for view in (views() if chosen is None else chosen)]


def _see(view: View, worlds: int) -> Seen:
    parts = [_look(name, view.table, worlds) for name in OBJECTS]
    return Seen(view, worlds * len(OBJECTS), *(np.concatenate(p) for p in
                                               zip(*parts, strict=True)))


def _look(name: str, table: StereoTable, worlds: int) -> list[np.ndarray]:
    body = body_from_name(name)
    pose = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (worlds, 1))
    key = np.arange(worlds).astype(np.uint64) + np.uint64(SEED)
    robot = Robot([body], np.zeros(1, int), Truth(pose), key, ArmTable(), HandTable(),
                  SensorTable())
    aim = np.random.default_rng(15).normal(0.0, AIM_SIGMA_M, (worlds, 3))
    target = pose[:, :3] + [0.0, 0.0, body.high_m[2] / 2] + aim
    axis = see_axis(robot, target, table)
    cylinder, whole = see_cylinder(robot, target, table)
    place = np.hypot(cylinder.x_m - pose[:, 0], cylinder.y_m - pose[:, 1])
    tilt = np.degrees(np.arccos(np.clip(axis.direction[:, 2], -1.0, 1.0)))
    return [tilt[axis.found], *(1e3 * off[whole] for off in (
        place, cylinder.radius_m - radius_around(body), cylinder.height_m - body.high_m[2]))]


STEREO_HEADER = (
    "switched_on", "pairs_of_images", "axis_found", "tilt_deg_median", "tilt_deg_p90",
    "whole_in_both", "place_mm_median", "place_mm_p90", "radius_off_mm_median", "radius_off_mm_p90",
    "height_off_mm_median", "height_off_mm_p90")


def stereo_rows(found: list[Seen]) -> list[tuple[str, ...]]:
    """The table, a row for each view; errors are without sign."""
    rows = []
    for s in found:
        tilt, *sizes = ([number_text(float(q), 1) for q in np.quantile(np.abs(v), [0.5, 0.9])]
                        if len(v) else ["NA", "NA"]
                        for v in (s.tilt_deg, s.place_mm, s.radius_mm, s.height_mm))
        rows.append((s.view.switched_on, str(s.pairs), str(len(s.tilt_deg)), *tilt,
                     str(len(s.place_mm)), *(word for size in sizes for word in size)))
    return rows
