"""Conclusions follow from the data: other data, other conclusions."""

import re

import numpy as np
import pytest

from sweeps.paper import conclusions as said
from sweeps.paper.exponents import cylinder_overlap, exponents_said

RNG = np.random.default_rng(3)
NAMES = ("block", "wedge", "funnel")
TOLD = [RNG.normal(0.5, 0.05, 16) for _ in NAMES]


def raised(by: float) -> list[np.ndarray]:
    return [iou + by + RNG.normal(0.0, 0.01, 16) for iou in TOLD]


def test_paired_differences_are_those_of_the_means_with_students_interval() -> None:
    one, other = [TOLD[0]], [TOLD[0] + RNG.normal(0.1, 0.02, 16)]
    apart = other[0] - one[0]
    mean, low, high = said.paired(one, other)
    assert mean == pytest.approx(apart.mean())
    half = 2.131 * apart.std(ddof=1) / 4.0  # Student's t, 15 degrees of freedom
    assert (low, high) == pytest.approx((mean - half, mean + half), abs=1e-4)


@pytest.mark.parametrize(("link", "tip", "verdict"), [
    (0.2, 0.05, "The link matters more than the place on the tip"),
    (0.05, 0.2, "The place on the tip matters more than the link"),
    (0.1, 0.1, "The run does not tell which")])
def test_link_or_place(link: float, tip: float, verdict: str) -> None:
    text = said.link_or_place(TOLD, raised(link), raised(tip), raised(0.25), raised(0.3))
    assert verdict in text
    found = [float(word) for word in re.findall(r"([+-]0\.\d{3}) \(", text)]
    assert found == pytest.approx([link, tip, 0.25, 0.3, tip - link], abs=0.01)


def test_what_limits_says_so_only_of_objects_below() -> None:
    good, poor = np.full(16, 0.9), np.full(16, 0.55)
    text = said.what_limits(NAMES, [poor, good, good], [good, good, good])
    assert "1 of 3 objects" in text
    assert "block 0.55 (0.90)" in text
    assert "wedge" not in text
    assert "not the contacts alone" in text
    assert "errors of the contacts are what limits" in said.what_limits(
        NAMES, [good] * 3, [good] * 3)
    enough = np.full(16, said.SUFFICES)
    assert "errors of the contacts are what limits" in said.what_limits(
        NAMES, [enough] * 3, [good] * 3)
    worse = said.what_limits(NAMES, [poor, good, good], [0.8 * poor, good, good])
    assert "on 0 of these 1" in worse
    assert "not the contacts alone" not in worse


def test_rivals_are_counted_and_judged() -> None:
    won = [np.arange(16) < n for n in (7, 0, 12)]
    better = said.what_rivals_do("Here", NAMES, TOLD, raised(0.1), won)
    assert "19 of 48 episodes (block 7, funnel 12)" in better
    assert "IoU is better: +0." in better
    assert "IoU is worse: -0." in said.what_rivals_do("Here", NAMES, TOLD, raised(-0.1), won)
    assert "not clearly changed" in said.what_rivals_do("Here", NAMES, TOLD, raised(0.0), won)
    none = [np.zeros(16, bool)] * 3
    assert "no rival replaced a fit in 48 episodes" in said.what_rivals_do(
        "Here", NAMES, TOLD, TOLD, none)


def test_other_sentences_have_the_numbers_of_their_data() -> None:
    assert "9 of 10 contacts (90 %)" in said.where_touched(9, 1, 6.0, 40.0)
    assert "50 % of 4" in said.iterations_said(np.array([3.0, 15.0, 16.0, 60.0]))
    text = said.what_makes_six([("steps", 6.3, "1", "6 of 9"), ("slip", 5.0, "10 deg", "9 of 9"),
                                ("pads", 0.4, "", "8 of 9")], 6.0)
    assert "crossed): steps (6.3 deg at 1, 6 of 9)." in text
    assert "Nearly: slip (5.0 deg at 10 deg, 9 of 9)." in text
    assert "Not with: pads (0.4 deg, 8 of 9)." in text
    less = said.what_makes_six([("pads", 4.7, "", "8 of 9")], 6.0)  # than 0.8 of it
    assert less.endswith("none of the sources tried. Not with: pads (4.7 deg, 8 of 9).")
    assert "none of the sources tried" in said.what_makes_six([("pads", 0.4, "", "9 of 9")], 6.0)


def test_which_contour_is_judged_by_its_errors() -> None:
    errors = [np.abs(RNG.normal(0.02, 0.004, 24)) for _ in NAMES]
    half = [0.5 * e for e in errors]
    ways = ("the paper's contour", "ours")
    ours = said.which_contour(NAMES, errors, half, ways)
    assert "on 3 of 3 bottles" in ours
    assert "the volumes of ours are nearer" in ours
    paper = said.which_contour(NAMES, half, errors, ways)
    assert "on 0 of 3 bottles." in paper
    assert "the volumes of the paper's contour are nearer" in paper
    assert "does not tell" in said.which_contour(NAMES, errors, errors, ways)
    one_far_off = [np.append(e[1:], 1.0) for e in half]  # the median is as good
    assert "on 3 of 3 bottles" in said.which_contour(NAMES, errors, one_far_off, ways)


def test_an_upright_cylinder_has_eps1_small_and_eps2_one() -> None:
    right, swapped = cylinder_overlap(0.1, 1.0), cylinder_overlap(1.0, 0.1)
    assert right > 0.95
    # A box inside whose z section is an ellipse: 2/3 pi... of the box, by the integral over z.
    z = np.linspace(-1, 1, 20001)
    half = np.sqrt(1 - z**2)  # of the nearly square sections
    square = 4 * half**2
    common = np.where(half <= np.sqrt(0.5), square, 4 * half * np.sqrt(1 - half**2) + 4 * (
        0.5 * (np.arcsin(half) - np.arcsin(np.sqrt(1 - half**2)))))
    overlap = common.mean() / (np.pi + square.mean() - common.mean())
    assert swapped == pytest.approx(overlap, abs=0.02)
    assert "ε1 ≈ 0.1 and ε2 ≈ 1: " in exponents_said()
    assert "contradicts the equation" in exponents_said()
