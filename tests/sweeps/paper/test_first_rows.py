"""The paper's first rows: Solina's residual on fingertips and nothing else, counted as it runs."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from fit.superquadric import descent
from fit.superquadric.residuals import FitData
from strategies.recovery.fit_contacts import recover_bodies
from sweeps.paper import convergence, recovery
from sweeps.paper.contacts import (
    FINGERTIP,
    TRUE_LINK,
    TRUE_POINTS,
    TRUE_TIP,
    contacts_of,
    palmar_middles,
)
from sweeps.paper.recovery import AS_PAPER, OURS, PLAIN, RIVALS, by_fingertip, switched_on

EVIDENCE = ("plane", "upright", "normals", "normal_weight", "free")


@pytest.fixture
def counted(monkeypatch):
    """What every fit of the paper's rows ran with, by the table it was asked for by."""
    ran: dict[str, Counter] = {}
    now = Counter()

    def problem(form, made=descent._problem):
        now[f"residual {form.residual}"] += 1
        now[f"loss {form.loss}"] += 1
        return made(form)

    def refresh(lanes: FitData, theta, sets, form, options, made=descent._refresh):
        lanes, theta = made(lanes, theta, sets, form, options)
        now["fits"] += len(theta)
        for name in EVIDENCE:
            now[name] += getattr(lanes, name) is not None
        now["priors"] += int((lanes.ridge != 0).sum() + (lanes.edge != 0).sum())
        now["weighted"] += sum(len(np.unique(w[w > 0])) > 1 for w in lanes.weight)
        return lanes, theta

    def recover(evidence, links, table):
        now.clear()
        found = recover_bodies(evidence, links, table)
        ran.setdefault(switched_on(table), Counter()).update(now)
        return found

    monkeypatch.setattr(descent, "_problem", problem)
    monkeypatch.setattr(descent, "_refresh", refresh)
    monkeypatch.setattr(recovery, "recover_bodies", recover)
    return ran


def test_first_rows_run_solinas_residual_and_nothing_else(
        counted, monkeypatch: pytest.MonkeyPatch) -> None:
    episodes = 3
    ways, contacts = by_fingertip("wedge", np.arange(episodes))
    alone, rivalled = counted["residual solina, taper"], counted["residual solina, taper, rivals"]
    assert len(counted) == 2
    assert {w for w in alone if w.startswith(("residual", "loss")) and alone[w]} == {
        "residual solina", "loss none"}
    assert alone["fits"] == 2 * episodes * len(contacts.placed)  # before and after settling
    assert not any(alone[what] for what in (*EVIDENCE, "priors", "weighted"))
    # The count sees what is switched on: rivals fit by another residual.
    assert rivalled["residual radial"] > 0
    assert not any(way.replaced.any() for way in ways if way.fit == PLAIN)
    assert any(way.replaced.any() for way in ways if way.fit == RIVALS)
    first, = (w for w in ways if (w.contacts, w.fit) == (FINGERTIP, PLAIN))
    np.testing.assert_array_equal(np.isnan(first.iterations),
                                  first.evidence.mask.sum(1) < convergence.FEWEST)
    # Where any cost is as good as the last, those of the screening are all that count.
    monkeypatch.setattr(convergence, "SETTLED", np.inf)
    monkeypatch.setattr(convergence, "_ITERATIONS", convergence._SCREENED + 1)
    least, _ = convergence.iterations_of(first.evidence.points_m, first.evidence.mask)
    assert set(least[np.isfinite(least)]) == {convergence._SCREENED}


def test_what_is_switched_on_is_read_off_the_table() -> None:
    assert switched_on(AS_PAPER) == "residual solina, taper"
    for word in ("table_plane", "free_space", "weights", "rivals", "flat_ends", "shape_prior",
                 "upright", "loss cauchy", "rounds 4"):
        assert word in switched_on(OURS).split(", ")
    assert "upright" not in switched_on(type(OURS)(table_plane=False))


def test_contacts_are_put_right_in_part() -> None:
    from sweeps.episode.episodes import run_block

    cell = recovery._cell("lightbulb", AS_PAPER, "fingertip")
    block = run_block(cell, np.arange(2), "cpu")
    found = contacts_of(block, cell.hand)
    told, link, tip, points = (found.placed[way].points_m for way in (
        FINGERTIP, TRUE_LINK, TRUE_TIP, TRUE_POINTS))
    truth = block.truth.closings[0].point_m.reshape(told.shape)
    assert found.on_distal.any()
    assert found.on_other.any()
    closing, = block.truth.closings
    for name in ("on_table", "self_contact"):  # what is not the object's is not counted
        all_so = replace(closing, **{name: np.ones_like(closing.on_table)})
        elsewhere = replace(block, truth=replace(block.truth, closings=[all_so]))
        none = contacts_of(elsewhere, cell.hand)
        assert not (none.on_distal | none.on_other | none.placed[TRUE_POINTS].mask).any()
    np.testing.assert_array_equal(tip[found.on_distal], truth[found.on_distal])
    np.testing.assert_array_equal(tip[~found.on_distal], told[~found.on_distal])
    np.testing.assert_array_equal(link[~found.on_other], told[~found.on_other])
    np.testing.assert_array_equal(points[found.on_other], truth[found.on_other])
    nearer = (np.linalg.norm((link - truth)[found.on_other], axis=1)
              < np.linalg.norm((told - truth)[found.on_other], axis=1))
    assert nearer.mean() > 0.9


def test_palmar_middles_of_a_bent_finger() -> None:
    # In the x-z plane; flexion about -y turns z towards x, the palmar side.
    bend = np.radians([0.0, 30.0, 80.0])
    along = np.stack([np.sin(bend), 0 * bend, np.cos(bend)], 1)
    joints = np.concatenate([np.zeros((1, 3)), np.cumsum(0.03 * along, axis=0)])
    palmar = np.stack([np.cos(bend), 0 * bend, -np.sin(bend)], 1)
    middles = palmar_middles(joints, joints[3] + 0.008 * palmar[2], 0.008)
    np.testing.assert_allclose(middles, joints[:3] + 0.015 * along + 0.008 * palmar, atol=1e-12)
