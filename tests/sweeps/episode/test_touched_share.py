"""The share of a surface near contacts, against areas in closed form, and in rows."""

from dataclasses import replace

import numpy as np
import pytest

from strategies.procedures.touches import TABLE_MARGIN_M
from strategies.ready_made import STRATEGIES
from sweeps.episode import touched_share
from sweeps.episode.episodes import run_episodes
from sweeps.episode.touched_share import NEAR_M, TouchedSurface, open_surface, touched_points
from sweeps.spec.cell import Cell
from warpgrasp.closing.closing import ClosingTruth
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import FitTable
from warpgrasp.robot import Truth
from warpgrasp.touch.line_touch import LineTruth

RADIUS_M = 0.03
SPHERE = {"name": "ball", "compound": [{"shape": "sphere", "radius_mm": 30}]}
POSE = np.array([[0.4, 0.1, 0.0, 0.0, 0.0, 0.6, 0.8]])


def closing(points_m: np.ndarray, **more: np.ndarray) -> ClosingTruth:
    """One closing of one probe whose fingers touched at points (finger, 3)."""
    shape = (1, 1, 1, len(points_m))
    none = np.zeros(shape, bool)
    given = {"link": np.full(shape, 2), "on_table": none, "self_contact": none} | more
    return ClosingTruth(np.zeros((*shape, 4)), np.zeros((*shape, 4)), np.zeros((*shape, 4)),
                        given["link"], points_m.reshape(*shape, 3), np.zeros((*shape, 3)),
                        given["on_table"], given["self_contact"], ~none)


def test_a_contact_on_a_sphere_covers_a_cap() -> None:
    from pathlib import Path

    body = body_from_table(SPHERE, Path())
    truth = Truth(POSE)
    surface = TouchedSurface([(body, slice(0, 1))], POSE)
    assert surface.share(truth) == 0.0
    middle = POSE[0, :3] + [0.0, 0.0, RADIUS_M]
    truth.closings.append(closing(middle + RADIUS_M * np.array([[1.0, 0, 0], [-1.0, 0, 0]])))
    # A cap whose rim is a chord d from its pole has the area pi d^2 (Archimedes); the part of the
    # sphere higher than h over the table has 2 pi r (2 r - h).
    area = 2 * np.pi * RADIUS_M * (2 * RADIUS_M - TABLE_MARGIN_M)
    assert surface.share(truth)[0] == pytest.approx(2 * np.pi * NEAR_M**2 / area, abs=0.02)
    before = surface.share(truth)
    top = middle[None] + [0.0, 0.0, RADIUS_M]
    for flag in ("on_table", "self_contact"):
        truth.closings.append(closing(top, **{flag: np.ones((1, 1, 1, 1), bool)}))
        assert surface.share(truth) == before
    for on_table in (True, False):
        truth.lines.append(LineTruth(np.zeros(1, int), np.zeros((1, 4)), top, np.zeros((1, 3)),
                                     np.ones(1), np.full(1, on_table), np.zeros((1, 7))))
        assert (surface.share(truth) == before) == on_table


def test_no_contact_covers_nothing() -> None:
    surface = open_surface(body_from_name("block"))
    assert not touched_points(surface, np.zeros((0, 3))).any()
    assert touched_points(surface, surface).all()
    assert surface[:, 2].min() > TABLE_MARGIN_M


def test_few_contacts_cover_what_a_tree_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    surface = open_surface(body_from_name("block"))
    contacts = surface[::40] + 0.004
    few = touched_points(surface, contacts)
    monkeypatch.setattr(touched_share, "FEW_PAIRS", 0)
    assert few.any()
    assert not few.all()
    assert (few == touched_points(surface, contacts)).all()


def test_rows_and_curves_have_the_share() -> None:
    strategy = replace(STRATEGIES["ring6"], refit_every=2)
    fit = FitTable(taper=False, rivals=False, rounds=0)
    rows = run_episodes(Cell(strategy, {"name": "small_cylinder"}, "small_cylinder", seed=3,
                             fit=fit), np.arange(2), "cpu")
    for share, curve in zip(rows["touched10mm"], rows["curve_touched10mm"], strict=True):
        assert 0.05 < share < 1.0
        assert curve[-1] == share
        assert (np.diff(curve) >= 0.0).all()
