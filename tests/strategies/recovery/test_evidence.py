"""Touches of pads as evidence: what was felt, and where fingertips met nothing."""

from types import SimpleNamespace

import numpy as np
import pytest

from fit.superquadric.record import SuperquadricFit
from strategies.procedures.touches import MissedTips, TouchLog
from strategies.recovery import fit_contacts as recovery
from strategies.recovery.evidence import (
    FREE_TIPS,
    NORMAL_SIGMA_M,
    TANGENT_SIGMA_M,
    evidence_from_touches,
    joined_evidence,
    no_evidence,
    slots_of_touches,
)
from warpgrasp.parameters import FitTable, HandTable
from warpgrasp.probe_status import ProbeStatus

LIKE = no_evidence(3, 0.006)


def line(status: list[ProbeStatus]) -> SimpleNamespace:
    n = len(status)
    return SimpleNamespace(
        status=np.array(status), tip_m=np.arange(3.0 * n).reshape(n, 3), link=np.full(n, 2),
        point_m=np.tile([0.4, 0.0, 0.1], (n, 1)), normal=np.tile([-1.0, 0.0, 0.0], (n, 1)),
        q_rad=np.zeros((n, 4)), taxel_peak=np.full(n, 50), image=np.zeros((n, 16, 16)),
        hand_pose=np.zeros((n, 7)))


def test_only_lines_that_met_nothing_are_free() -> None:
    log = TouchLog(4)
    touch = line([ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT, ProbeStatus.BLOCKED])
    log.miss(np.array([0, 1, 2]), touch)  # pyright: ignore
    log.add(np.array([0, 1, 2]), touch, np.array([0]), np.zeros(3, int), 0, 0)  # pyright: ignore
    found, links = evidence_from_touches(log.table(), log.missed(), 3, 4, LIKE, HandTable())
    assert not links.linked.any()
    assert links.link[0, 0] == 2
    assert found.free_mask.sum(1).tolist() == [0, 1, 0]
    np.testing.assert_array_equal(found.free_m[1, 0], touch.tip_m[1])
    assert found.free_radius_m == LIKE.free_radius_m
    assert found.by_pad.tolist() == found.mask.tolist() == [[True, False, False, False],
                                                            [False] * 4, [False] * 4]
    without, _ = evidence_from_touches(log.table(), None, 3, 4, LIKE, HandTable())
    assert without.free_m.shape[1] == 0
    np.testing.assert_array_equal(without.points_m, found.points_m)


def test_a_pad_tells_a_place_best_along_its_normal() -> None:
    """Skin gives along the normal; across it the touch may be anywhere on the pad."""
    normal = np.array([2.0, -1.0, 2.0]) / 3.0
    touch = line([ProbeStatus.CONTACT])
    touch.normal[0] = normal
    log = TouchLog(4)
    log.add(np.array([0]), touch, np.array([0]), np.zeros(1, int), 0, 0)  # pyright: ignore
    found, _ = evidence_from_touches(log.table(), None, 1, 2, LIKE, HandTable())
    covariance = found.covariance_m2[0, 0]
    np.testing.assert_allclose(covariance @ normal, NORMAL_SIGMA_M**2 * normal)
    for across in ([1.0, 2.0, 0.0], [-1.0, 0.0, 1.0]):
        np.testing.assert_allclose(covariance @ across, TANGENT_SIGMA_M**2 * np.array(across),
                                   atol=1e-20)


def test_what_is_felt_of_the_table_is_no_evidence_of_the_body() -> None:
    touch = line([ProbeStatus.CONTACT] * 2)
    touch.point_m[0, 2] = 0.003
    log = TouchLog(4)
    log.add(np.arange(2), touch, np.arange(2), np.zeros(2, int), 0, 0)  # pyright: ignore
    found, _ = evidence_from_touches(log.table(), None, 2, 1, LIKE, HandTable())
    assert found.mask.tolist() == [[False], [True]]


@pytest.mark.parametrize("made", [1, 4, 5, 7, 23, 77])
def test_as_many_touches_are_kept_as_there_are_slots_and_one_in_each(made: int) -> None:
    touch = line([ProbeStatus.CONTACT] * made)
    log = TouchLog(4)
    for world in (1, 0, 1):  # in turn, as procedures make them
        log.add(np.full(made, world), touch, np.arange(made), np.zeros(made, int), 0, 0)  # pyright: ignore
    rows, (world, slot) = slots_of_touches(log.table(), 2, 5)
    kept = [min(made, 5), min(2 * made, 5)]
    assert np.bincount(world).tolist() == kept
    assert sorted(zip(world, slot, strict=True)) == [
        (w, k) for w, count in enumerate(kept) for k in range(count)]
    np.testing.assert_array_equal(log.table().world[rows], world)
    assert (np.diff(rows[world == 1]) > 0).all()


def test_many_misses_are_thinned_evenly_and_apart_from_other_worlds() -> None:
    table = TouchLog(4).table()
    n = 5 * FREE_TIPS
    one = MissedTips(np.full(n, 1), np.arange(3.0 * n).reshape(n, 3))
    both = MissedTips(np.concatenate([one.world, [2, 2]]),
                      np.concatenate([one.tip_m, np.ones((2, 3))]))
    alone, beside = (evidence_from_touches(table, missed, 3, 4, LIKE, HandTable())[0]
                     for missed in (one, both))
    np.testing.assert_array_equal(alone.free_m[1], beside.free_m[1])
    assert alone.free_mask.sum(1).tolist() == [0, FREE_TIPS, 0]
    assert beside.free_mask.sum(1).tolist() == [0, FREE_TIPS, 2]
    assert np.diff(alone.free_m[1, :, 0]).tolist() == [15.0] * (FREE_TIPS - 1)
    assert joined_evidence(LIKE, alone).free_m.shape[1] == FREE_TIPS


@pytest.mark.parametrize("normals", [False, True])
def test_a_fit_is_given_only_normals_that_were_measured(
        normals: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    log = TouchLog(4)
    touch = line([ProbeStatus.CONTACT] * 3)
    log.add(np.arange(3), touch, np.arange(3), np.zeros(3, int), 0, 0)  # pyright: ignore
    felt, _ = evidence_from_touches(log.table(), None, 3, 2, LIKE, HandTable())
    felt.by_pad[1] = False  # a contact placed against a body: its normal is the body's own
    given = {}
    monkeypatch.setattr(recovery, "fit_superquadric",
                        lambda *args, **named: given.update(named) or SuperquadricFit)
    recovery.fit_evidence(felt, FitTable(normals=normals))
    if not normals:
        assert given["normals"] is None
        return
    np.testing.assert_array_equal(given["normals"][[0, 2], 0], [[-1.0, 0.0, 0.0]] * 2)
    assert np.isnan(given["normals"][1]).all()
    assert np.isnan(given["normals"][:, 1]).all()
