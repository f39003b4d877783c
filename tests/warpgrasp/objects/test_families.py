"""Families of objects: sound bodies, the same for the same seed, different for others."""

from pathlib import Path

import numpy as np
import pytest

from warpgrasp.geometry.body import BodyError
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.catalogue_names import FAMILY_NAMES, HELD_OUT, PUBLIC
from warpgrasp.objects.families import FAMILIES, Draw, family_table

QUICK = ("hammer",)  # a mug and a bowl are hollow, below


def test_each_family_has_a_line() -> None:
    assert list(FAMILY_NAMES) == list(FAMILIES)


@pytest.mark.parametrize("family", [
    pytest.param(family, marks=() if family in QUICK else pytest.mark.slow)
    for family in FAMILIES])
def test_every_family_makes_bodies_that_stand_on_the_table(family: str) -> None:
    contents = set()
    for seed in (0, 1, HELD_OUT):
        table = family_table(f"{family}-{seed}")
        assert table is not None
        body = body_from_table(table, Path())
        assert body.low_m[2] == 0.0
        sides = np.subtract(body.high_m, body.low_m)
        assert 0.04 < sides.max() < 0.33
        assert sample_body(body, surface=64, inside=64).volume_m3 > 1e-5
        contents.add(body.content)
    assert len(contents) == 3


def test_names_give_the_same_object_and_others_give_none() -> None:
    assert family_table("mug-17") == family_table("mug-17")
    assert family_table("mug-17") != family_table("mug-18")
    for name in ("mug", "mug-", "mug-2000", "cup-1", "mug-1.5", "mug--1", "mug-1\u0661"):
        assert family_table(name) is None
    assert PUBLIC <= HELD_OUT


def test_a_member_is_an_object_by_its_name_in_python_too() -> None:
    table = family_table("hammer-3") or {}
    assert body_from_name("hammer-3") == body_from_table(table, Path())
    with pytest.raises(BodyError, match=r"no object 'mug-2000'; mug-0 to mug-1999 are made by"):
        body_from_name("mug-2000")


def test_each_of_several_choices_is_drawn_as_often() -> None:
    drawn = [Draw("toy", seed).one_of(("a", "b", "c", "d")) for seed in range(1000)]
    for choice in "abcd":
        assert drawn.count(choice) == pytest.approx(250, abs=70)  # five deviations


def test_mugs_and_bowls_are_hollow() -> None:
    for name in ("mug-3", "bowl-3"):
        body = body_from_table(family_table(name) or {}, Path())
        box = np.prod(np.subtract(body.high_m, body.low_m))
        assert sample_body(body).volume_m3 < 0.35 * box
