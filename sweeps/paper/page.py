"""The page `paper.md`: tables of a run beside printed results, and what follows from its rows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.paper import conclusions
from sweeps.paper.bottles import BOTTLES_HEADER, WAYS, Followed, bottle_rows, median_or_nan
from sweeps.paper.contacts import FINGERTIP, TRUE_BOTH, TRUE_LINK, TRUE_POINTS, TRUE_TIP
from sweeps.paper.exponents import exponents_said
from sweeps.paper.faces import (
    FACES_HEADER,
    PRINTED_DEG,
    TYPICAL_DEG,
    Explored,
    errors_of,
    face_rows,
    typical_sizes,
)
from sweeps.paper.recovery import (
    ALL,
    FITS,
    NO_RIVALS,
    PLAIN,
    RECOVERY_HEADER,
    RIVALS,
    TORQUES,
    Grasped,
    Recovered,
    of_way,
    recovery_rows,
    switched_on,
)
from sweeps.paper.stereo import STEREO_HEADER, Seen, stereo_rows

_RECOVERY_WORDS = {
    "object": "object",
    "contacts": "contacts from",
    "switched_on": "switched on",
    "episodes": "episodes",
    "contacts_median": "contacts",
    "replaced_by_rival": "replaced by a rival",
    "iou_median": "IoU: median",
    "iou_p10": "IoU: 10 %",
    "iou_p90": "IoU: 90 %",
    "chamfer_mm_median": "chamfer [mm]",
    "volume_ratio_median": "volume ratio",
    "iterations_median": "iterations: median",
    "iterations_p90": "iterations: 90 %",
}
_FACES_WORDS = {
    "source": "source changed",
    "size": "to",
    "blocks": "blocks",
    "both_sides": "both crossed",
    "start_off_deg_median": "start off [deg]",
    "touches_median": "touches",
    "angle_deg_median": "angle [deg]: median",
    "angle_deg_p5": "angle: 5 %",
    "angle_deg_p95": "angle: 95 %",
    "error_deg_median": "error [deg]: median",
    "share_off_6_or_more": "share off by 6 or more",
}
_BOTTLES_WORDS = {
    "bottle": "bottle",
    "contour": "contour",
    "worlds": "worlds",
    "to_the_end": "to the end",
    "radius_mm_true": "radius, true [mm]",
    "radius_mm_median": "radius found",
    "length_mm_true": "length, true [mm]",
    "length_mm_median": "length found",
    "volume_ml_true": "volume, true [ml]",
    "volume_ml_median": "volume found",
    "volume_ml_p5": "5 %",
    "volume_ml_p95": "95 %",
    "volume_off_pct_median": "volume off [%]",
    "right_by_size_and_volume": "right by size and volume",
    "right_by_profile": "right by profile",
}
_STEREO_WORDS = {
    "switched_on": "switched on",
    "pairs_of_images": "pairs of images",
    "axis_found": "axis found",
    "tilt_deg_median": "tilt [deg]: median",
    "tilt_deg_p90": "tilt: 90 %",
    "whole_in_both": "whole in both",
    "place_mm_median": "place [mm]: median",
    "place_mm_p90": "place: 90 %",
    "radius_off_mm_median": "radius off [mm]: median",
    "radius_off_mm_p90": "radius off: 90 %",
    "height_off_mm_median": "height off [mm]: median",
    "height_off_mm_p90": "height off: 90 %",
}
"""What columns are called on the page; those left out are in the CSV files."""


@dataclass(frozen=True)
class Run:
    """Everything the page tells of."""

    recovered: list[Grasped]
    faces: list[Explored]
    bottles: list[Followed]
    stereo: list[Seen]


def page(run: Run) -> str:
    """The text, in Markdown."""
    return "\n".join([
        "<!-- written by `warpgrasp paper`; do not edit: `make paper-docs` -->", "",
        "# The paper's experiments, side by side", "",
        "Allen and Michelman, \"Acquisition and interpretation of 3-D sensor data from touch\" "
        "(1990). The printed values are compared with; nothing is tuned to them. Every number and "
        "every conclusion on this page is computed from the same run. Differences are paired by "
        "episode; brackets hold their 95 % intervals, for these objects and other episodes.", "",
        *_summary(run), "", *_six_objects(run.recovered), "", *_faces(run.faces), "",
        *_bottles(run.bottles), "", *_stereo(run.stereo), ""])


def _summary(run: Run) -> list[str]:
    plain = of_way(run.recovered, FINGERTIP, PLAIN)
    count = np.concatenate([r.evidence.mask.sum(1) for r in plain])
    iterations = _iterations(plain)
    angle = run.faces[0].angle_deg
    sized = {way: sum(int((f.contours[way].by_volume[f.ended] == f.name).sum())
                      for f in run.bottles) for way in WAYS}
    ended, followed = (sum(int(n(f.ended)) for f in run.bottles) for n in (np.sum, len))
    return _table(("experiment", "printed", "here"), [
        ("contacts for a body", "30 to 100",
         f"{np.quantile(count, 0.1):.0f} to {np.quantile(count, 0.9):.0f} (10 to 90 %), median "
         f"{np.median(count):.0f}, of {len(count)} episodes"),
        ("iterations to convergence", "10 to 15", _spread(iterations)),
        ("time of a fit", "about 10 s for 20 iterations of 60 points (Sun-4)",
         "printed by the command: it differs from machine to machine"),
        ("angle of two adjacent faces", f"{PRINTED_DEG:.0f} deg, truth taken as 90", (
            f"median {np.median(angle):.2f} deg, {np.quantile(angle, 0.05):.2f} to "
            f"{np.quantile(angle, 0.95):.2f} (5 to 95 %), of {len(angle)} blocks") if len(angle)
            else "both sides were never crossed"),
        ("four bottles", "told apart by size and volume",
         f"right: {sized[WAYS[0]]} (the paper's contour) and {sized[WAYS[1]]} (ours) of {ended} "
         f"followed to the end, of {followed}"),
    ])


def _six_objects(found: list[Grasped]) -> list[str]:
    shown = ((FINGERTIP, PLAIN), (TORQUES, ALL))
    rows = [row for row in recovery_rows(found) if (row[1], row[2]) in shown]
    return [
        "## Six objects from grasps (figure 4)", "", "![Recovered bodies](figure4.png)", "",
        "All rows use the same grasps: `rim6-ring12`, 18 hand poses. The first six take the "
        "fingertip as the contact and fit by Solina's residual, nothing else: no table, no free "
        "space, no weights, no prior, no rival model. The others take contacts from joint torques "
        "and use all evidence. Each row says what was switched on. In all of them a contact "
        "believed lower than 6 mm is taken for the table and left out. Bodies are scored as "
        "fitted, without the checks by which an episode rejects one; where nothing could be "
        "fitted, the cylinder given in advance is scored. Iterations are those of a plain fit of "
        "13 parameters to the contacts, until its cost is within 1 % of its last.", "",
        *_chosen(RECOVERY_HEADER, rows, _RECOVERY_WORDS), "",
        "What if? The fingertip estimate is put right in part, with and without rivals: the "
        "palmar middle of the link that truly touched; the true point where the distal link "
        "touched; both; all true points. Median IoU of each object, and the change of the mean IoU "
        "of all objects from the first row.", "", *_what_if(found), "",
        *_six_conclusions(found), "", exponents_said()]


def _what_if(found: list[Grasped]) -> list[str]:
    first = _iou(of_way(found, FINGERTIP, PLAIN))
    rows = []
    for contacts, fit in dict.fromkeys((r.contacts, r.fit) for g in found for r in g.ways):
        ways = of_way(found, contacts, fit)
        rows.append((contacts, switched_on(FITS[fit]), str(sum(len(r.fitted) for r in ways)),
                     *(f"{np.median(r.scores.iou):.2f}" for r in ways),
                     "" if not rows else conclusions.changed(first, _iou(ways))))
    names = [g.ways[0].name for g in found]
    return _table(("contacts from", "switched on", "episodes", *names, "change of the mean IoU"),
                  rows)


def _six_conclusions(found: list[Grasped]) -> list[str]:
    names = [g.ways[0].name for g in found]
    told, link, tip, both, points = (_iou(of_way(found, contacts, PLAIN)) for contacts in (
        FINGERTIP, TRUE_LINK, TRUE_TIP, TRUE_BOTH, TRUE_POINTS))
    ours = _iou(of_way(found, TORQUES, ALL))
    contacts = [g.contacts for g in found]
    off = {way: 1e3 * np.concatenate([c.off_m[getattr(c, way)] for c in contacts])
           for way in ("on_distal", "on_other")}
    said = [
        conclusions.where_touched(len(off["on_distal"]), len(off["on_other"]),
                                  median_or_nan(off["on_distal"]), median_or_nan(off["on_other"])),
        conclusions.link_or_place(told, link, tip, both, points),
        conclusions.what_limits(names, points, ours)]
    for what, contact, fits in (("With fingertips and Solina's residual", FINGERTIP,
                                 (PLAIN, RIVALS)),
                                ("With true points and Solina's residual", TRUE_POINTS,
                                 (PLAIN, RIVALS)),
                                ("With joint torques and all evidence", TORQUES,
                                 (NO_RIVALS, ALL))):
        alone, rivalled = (of_way(found, contact, fit) for fit in fits)
        said.append(conclusions.what_rivals_do(what, names, _iou(alone), _iou(rivalled),
                                               [r.replaced for r in rivalled]))
    said.append(conclusions.iterations_said(_iterations(of_way(found, FINGERTIP, PLAIN))))
    return [f"- {text}" for text in said] + [
        "- The paper shows its bodies without a score: recovery cannot be compared in numbers."]


def _faces(found: list[Explored]) -> list[str]:
    angle = found[0].angle_deg
    beyond, same, opposite = (
        int(on.sum()) for on in (angle >= PRINTED_DEG, angle < 45.0, angle > 135.0))
    medians = []
    for source in dict.fromkeys(e.case.source for e in found if e.case.source != "default"):
        mine = [(float(np.median(errors_of(e))), e.case.size,
                 f"{len(e.angle_deg)} of {e.worlds} blocks") for e in found
                if e.case.source == source and len(e.angle_deg)]
        if mine:
            medians.append((source, *max(mine)))
    return [
        "## Two faces of a block (figure 5)", "", "![Two faces](figure5.png)", "",
        "A block is grasped as above, and a body recovered from all evidence. The two sides of "
        "that body that face the arm most are crossed, and a plane is fitted to the touches on "
        "each. *Start* is how far the worse of their normals was from the block's, the median of "
        "all blocks. *Both crossed* counts the blocks whose two sides were; the other columns are "
        "over these. The first row has the default errors of robot and sensors, each other one a "
        "single source changed.", "",
        *_chosen(FACES_HEADER, face_rows(found), _FACES_WORDS), "",
        f"The printed {PRINTED_DEG:.0f} degrees or more came out in {beyond} of {len(angle)} "
        f"blocks with the default errors; in {same} both sides of the recovered body were one "
        f"face of the block, in {opposite} two opposite ones. At which size does each source alone "
        "make an error of "
        f"{TYPICAL_DEG:.0f} degrees typical (the median)?", "",
        *_table(("source", "size", "blocks"), typical_sizes(found)), "",
        f"- {conclusions.what_makes_six(medians, TYPICAL_DEG)}"]


def _bottles(found: list[Followed]) -> list[str]:
    errors = [[f.volume_errors(way) for f in found if f.ended.any()] for way in WAYS]
    names = [f.name for f in found if f.ended.any()]
    said = [] if not names else ["- " + conclusions.which_contour(
        names, errors[0], errors[1], ("the paper's contour", "ours"))]
    return [
        "## Four bottles (figure 6)", "", "![Bottles](figure6.png)", "",
        "Thumb and index finger follow each bottle along an axis given with an error (8 mm in "
        "place, radius and height, one standard deviation). The same touches are read in two ways. "
        "The paper's: a circle fitted to the two touches of each section, about the direction "
        "given, and linear segments through the radii. Ours: a surface of revolution fitted to all "
        "touches, which refines the axis. Values are medians over the worlds in which the end was "
        "reached.", "",
        *_chosen(BOTTLES_HEADER, bottle_rows(found), _BOTTLES_WORDS), "", *said, "",
        "True sizes are those of `warpgrasp/objects/profiles`, which gives their sources."]


def _stereo(found: list[Seen]) -> list[str]:
    return [
        "## The axis from two cameras", "",
        "The paper leaves the axis of exploration to vision. Two cameras 0.3 m apart look at "
        "upright round objects (a cylinder, a wine and an Orangina bottle) from 0.8 m. Silhouettes "
        "are cut out of their images with faults, each switched on alone: `pixel_noise`, standard "
        "deviation of an edge's place in pixels; `missing_edges`, share of the edge lost in gaps; "
        "`spurious_edges`, lines in each image that are no edges of the object; `clutter`, things "
        "behind it that look like it; `flipped_pixels`, share of pixels taken for the other side. "
        "All are estimates (`[stereo]`). The tilt is that of the axis from Hough lines; place, "
        "radius and height are those of the upright cylinder, where the silhouettes were whole in "
        "both images.", "",
        *_chosen(STEREO_HEADER, stereo_rows(found), _STEREO_WORDS)]


def _chosen(
    header: Sequence[str], rows: Sequence[Sequence[str]], columns: dict[str, str]
) -> list[str]:
    """A table of some columns under words for readers."""
    at = [header.index(name) for name in columns]
    return _table(tuple(columns.values()), [[row[k] for k in at] for row in rows])


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(row) + " |" for row in (header, *rows)]
    return [lines[0], "|" + "---|" * len(header), *lines[1:]]


def _iou(ways: list[Recovered]) -> list[np.ndarray]:
    return [r.scores.iou for r in ways]


def _iterations(ways: list[Recovered]) -> np.ndarray:
    return np.concatenate([r.iterations[np.isfinite(r.iterations)] for r in ways])


def _spread(values: np.ndarray) -> str:
    if not len(values):
        return "too few contacts in every episode"
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    return f"median {middle:.0f}, quartiles {low:.0f} to {high:.0f}, of {len(values)} fits"
