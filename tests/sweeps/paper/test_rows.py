"""Rows of the paper's tables, of records whose medians and quantiles are known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from strategies.procedures.contour_sections import SectionProfile
from sweeps.paper.bottles import (
    BOTTLES,
    BOTTLES_HEADER,
    Contour,
    Followed,
    _matched,
    bottle_rows,
    contour_of,
    volume_of,
)
from sweeps.paper.faces import FACES_HEADER, Case, Explored, face_rows, typical_sizes
from sweeps.paper.page import _faces
from sweeps.paper.recovery import (
    FINGERTIP,
    PLAIN,
    RECOVERY_HEADER,
    Grasped,
    Recovered,
    median_world,
    recovery_rows,
)
from sweeps.paper.stereo import STEREO_HEADER, Seen, stereo_rows, views

ANY: Any = None
"""What a row does not read."""
ELEVEN = np.random.default_rng(2).permutation(11)


def named(header: tuple[str, ...], row: tuple[str, ...]) -> dict[str, str]:
    return dict(zip(header, row, strict=True))


def sections(contour: np.ndarray, worlds: int) -> SectionProfile:
    z, r = (np.tile(column, (worlds, 1)) for column in contour.T)
    return SectionProfile(np.zeros((worlds, 3)), z, r, np.full(worlds, volume_of(contour)),
                          r.max(1), z[:, -1])


def test_the_volume_of_a_profile_is_that_of_its_discs() -> None:
    contour = np.array([[0.0, 0.03], [0.05, 0.03], [0.08, 0.01], [0.1, 0.02]])
    z = (np.arange(100_000) + 0.5) * 1e-6
    discs = np.pi * np.interp(z, *contour.T) ** 2 * 1e-6
    assert volume_of(contour) == pytest.approx(discs.sum(), rel=1e-6)


@pytest.mark.parametrize("name", BOTTLES)
def test_a_bottle_found_as_it_is_matches_itself(name: str) -> None:
    """A little too large, too; where nothing was found it is none."""
    contours = {bottle: contour_of(bottle) for bottle in BOTTLES}
    for factor in (1.0, 1.02):
        found = _matched(sections(factor * contours[name], 2), contours)
        assert found.matched.tolist() == found.by_volume.tolist() == [name] * 2
    nothing = _matched(sections(np.nan * contours[name], 1), contours)
    assert nothing.matched.tolist() == nothing.by_volume.tolist() == [""]


def test_rows_of_bottles_are_of_the_worlds_that_reached_the_end() -> None:
    contour = contour_of(BOTTLES[0])
    profile = sections(contour, 14)
    ended = np.arange(14) < 11
    share = np.append(0.8 + 0.04 * ELEVEN, [9.0] * 3)  # 0.8 to 1.2, and what did not end
    profile.volume_m3[:] *= share
    profile.length_m[:] *= share
    by_profile, by_volume = (np.where((np.arange(14) < right) | ~ended, *BOTTLES[:2])
                             for right in (4, 9))
    found = Followed(BOTTLES[0], ANY, ended, {"way": Contour(profile, by_profile, by_volume)})
    row = named(BOTTLES_HEADER, bottle_rows([found])[0])
    true = 1e6 * volume_of(contour)
    assert (row["worlds"], row["to_the_end"]) == ("14", "11")
    for name, factor in (("true", 1.0), ("median", 1.0), ("p5", 0.82), ("p95", 1.18)):
        assert float(row[f"volume_ml_{name}"]) == pytest.approx(factor * true, abs=0.6)
    assert float(row["length_mm_median"]) == pytest.approx(1e3 * contour[-1, 0], abs=0.6)
    # Off by 0, 4, 4, 8, 8, 12 and so on.
    assert float(row["volume_off_pct_median"]) == pytest.approx(12.0)
    assert (row["right_by_profile"], row["right_by_size_and_volume"]) == ("4", "9")


def explored(source: str, size: str, number: float, angle_deg: Any, touches: int = 30) -> Explored:
    angle = np.asarray(angle_deg, float)
    return Explored(Case(source, size, number), angle, np.full(len(angle), touches), 25,
                    np.array([1.0, 2.0, 6.0]), (), np.zeros((25, 7)))


def test_opposite_faces_of_a_block_are_not_taken_for_one() -> None:
    said = " ".join(_faces([explored("default", "", 0.0, [90.0, 97.0, 179.0, 178.0, 1.0])]))
    assert "came out in 3 of 5 blocks" in said
    assert "in 1 both sides of the recovered body were one face of the block, in 2 two op" in said


def test_rows_of_faces_have_the_quantiles_of_their_angles() -> None:
    angles = 90.0 + np.random.default_rng(1).permutation(np.arange(-10, 11))
    some, none = (named(FACES_HEADER, row) for row in face_rows(
        [explored("default", "", 0.0, angles), explored("x", "1 deg", 1.0, [])]))
    assert (some["blocks"], some["both_sides"], none["both_sides"]) == ("25", "21", "0")
    assert some["start_off_deg_median"] == "2.0"
    assert [some[f"angle_deg_{q}"] for q in ("p5", "median", "p95")] == ["81.00", "90.00", "99.00"]
    assert some["error_deg_median"] == "5.00"
    assert float(some["share_off_6_or_more"]) == pytest.approx(10 / 21, abs=5e-4)
    assert none["angle_deg_median"] == "NA"


def test_the_size_that_makes_an_error_typical_lies_between_those_tried() -> None:
    found = [explored("default", "", 0.0, [90.0])]
    for source, errors in (("grows", (3.0, 12.0)), ("at once", (7.0, 9.0)), ("never", (5.0, 2.0)),
                           ("just", (3.0, 6.0))):
        found += [explored(source, f"{size:g} deg", size, [90.0 - error, 90.0 + error])
                  for size, error in zip((1.0, 4.0), errors, strict=True)]
    found += [explored("steps", str(n), -n, [90.0 + error], 6 * n) for n, error in ((5, 1), (2, 8))]
    found += [explored("lost", "1 deg", 1.0, [])]
    said = {source: (answer, blocks) for source, answer, blocks in typical_sizes(found)}
    assert said["grows"] == ("about 2.0 deg", "2 of 25")  # 3 deg of error a degree
    assert said["just"][0] == "about 4.0 deg"
    assert said["at once"][0] == "1 deg or less"
    assert said["never"][0] == "not reached: 5.0 deg at 1 deg"
    assert said["steps"] == ("2, 12 touches on both sides together", "1 of 25")
    assert said["lost"] == ("both sides were never crossed", "0")
    assert "default" not in said


def test_rows_of_bodies_have_the_quantiles_of_their_episodes() -> None:
    mask = np.arange(20) < 10 + ELEVEN[:, None]
    scores: Any = SimpleNamespace(iou=ELEVEN / 10, chamfer_m=1e-3 * ELEVEN,
                                  volume_ratio=2.0 - ELEVEN / 10)
    evidence: Any = SimpleNamespace(mask=mask)
    one = Recovered("block", FINGERTIP, PLAIN, evidence, ANY, ANY, ELEVEN < 9, ELEVEN < 2, scores,
                    np.where(ELEVEN < 10, 10.0 + ELEVEN, np.nan), 0.1)
    row = named(RECOVERY_HEADER, recovery_rows([Grasped((one,), ANY)])[0])
    assert (row["episodes"], row["fitted"], row["replaced_by_rival"]) == ("11", "9", "2")
    assert [row[f"contacts_{q}"] for q in ("p10", "median", "p90")] == ["11", "15", "19"]
    assert [row[f"iou_{q}"] for q in ("p10", "median", "p90")] == ["0.100", "0.500", "0.900"]
    assert (row["chamfer_mm_median"], row["volume_ratio_median"]) == ("5.00", "1.50")
    assert (row["iterations_median"], row["iterations_p90"]) == ("14", "18")
    assert one.scores.iou[median_world(one)] == 0.5


def test_rows_of_axes_have_the_sizes_of_errors_of_either_sign() -> None:
    off = np.where(ELEVEN % 2, 1.0, -1.0) * ELEVEN
    seen = Seen(views()[0], 12, ELEVEN * 1.0, 2.0 * ELEVEN, 0.5 * off, off)
    row = named(STEREO_HEADER, stereo_rows([seen, Seen(views()[0], 12, *[np.zeros(0)] * 2)])[0])
    assert (row["pairs_of_images"], row["axis_found"], row["whole_in_both"]) == ("12", "11", "11")
    for name, median, high in (("tilt_deg", "5.0", "9.0"), ("place_mm", "10.0", "18.0"),
                               ("radius_off_mm", "2.5", "4.5"), ("height_off_mm", "5.0", "9.0")):
        assert (row[f"{name}_median"], row[f"{name}_p90"]) == (median, high)
