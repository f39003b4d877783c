"""Guesses of a hand beside each other: which stays, and that one that feels nothing does not."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sweeps.cli import main as cli
from sweeps.cli.hands import _by_trial
from sweeps.cli.tools import hand_trials
from sweeps.cli.tools.hand_trials import BETTER, FEW, Trial, best_guess, trial_misfit, tried
from warpgrasp.hands.hand_file import hand_from_file, hand_named
from warpgrasp.hands.hand_model import HandModel, Posture

HAND = hand_named("leap")


def named(name: str) -> HandModel:
    return replace(HAND, name=name)


@pytest.mark.parametrize(("errors", "best"), [
    ([6.0, 5.9, 5.8], "0"),  # hardly better
    ([6.0, 6.0 * BETTER - 0.01, 5.8], "1"),
    ([6.0, 9.0, 3.0], "2"),
    ([6.0], "0"),
])
def test_another_guess_stays_where_it_is_clearly_better(
        errors: list[float], best: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hand_trials, "tried", lambda hand, bodies, episodes: Trial(
        0.5, errors[int(hand.name)]))
    first, *others = [named(str(n)) for n in range(len(errors))]
    found, last, before = best_guess(first, others)
    assert (found.name, last.chamfer_mm, before.chamfer_mm) == (best, errors[int(best)], errors[0])


@pytest.mark.parametrize(("error", "best"), [(5.5, "1"), (5.9, "0")])
def test_what_is_no_better_on_other_bodies_was_best_by_chance(
        error: float, best: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def stub(hand: HandModel, bodies: Sequence[str], episodes: int) -> Trial:
        chosen = 3.0 if bodies == hand_trials.LAST_BODIES else error
        return Trial(0.5, 6.0 if hand.name == "0" else chosen)

    monkeypatch.setattr(hand_trials, "tried", stub)
    found, last, before = best_guess(named("0"), [named("1")])
    assert (found.name, before.chamfer_mm) == (best, 6.0)
    assert last.chamfer_mm == (error if best == "1" else 6.0)


def test_the_few_that_touch_most_are_compared_by_their_bodies(monkeypatch: pytest.MonkeyPatch
                                                              ) -> None:
    compared = []

    def stub(hand: HandModel, bodies: Sequence[str], episodes: int) -> Trial:
        if bodies == hand_trials.LAST_BODIES:
            compared.append(int(hand.name))
        return Trial(int(hand.name) / 20.0, 5.0)

    monkeypatch.setattr(hand_trials, "tried", stub)
    best_guess(named("0"), [named(str(n)) for n in range(1, 20)])
    assert compared == [0, *range(19, 19 - FEW, -1)]


@pytest.mark.slow
def test_a_thumb_in_the_way_is_found_by_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hand that ships, and one whose thumb lies across the palm."""
    monkeypatch.setattr(hand_trials, "FIRST_BODIES", ("block",))
    monkeypatch.setattr(hand_trials, "LAST_BODIES", ("block", "small_cylinder"))
    monkeypatch.setattr(hand_trials, "OTHER_BODIES", ("wedge",))
    monkeypatch.setattr(hand_trials, "LAST_EPISODES", 2)
    barred = replace(HAND, postures=tuple(
        Posture(p.name, (*((n, a) for n, a in p.angles_rad if n not in ("12", "13")),
                         ("12", 1.4), ("13", 1.2), ("14", 1.0), ("15", 1.0)))
        if p.name == "open" else p for p in HAND.postures))
    assert best_guess(barred, [HAND])[0] == HAND


@pytest.mark.slow
def test_a_trial_is_the_same_each_time() -> None:
    once = tried(HAND, ("block",), 2)
    assert once == tried(HAND, ("block",), 2)
    assert 0.0 < once.touched < 1.0
    assert np.isfinite(once.chamfer_mm)


def test_the_command_writes_the_best_guess(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                           capsys: pytest.CaptureFixture[str]) -> None:
    """The grasp frame of the URDF stays, and every guess is a hand."""
    pytest.importorskip("yourdfpy")
    seen = []

    def best(first: HandModel, others: Sequence[HandModel]) -> tuple[HandModel, Trial, Trial]:
        seen.extend([first, *others])
        return others[-1], Trial(0.5, 2.0), Trial(0.2, 4.0)

    monkeypatch.setattr(hand_trials, "best_guess", best)
    urdf, out = tmp_path / "leap.urdf", tmp_path / "hand.toml"
    assert cli.run(["export", str(urdf), "--hand", "leap"]) == 0
    assert cli.run(["hand", str(urdf), "-o", str(out)]) == 0
    said = capsys.readouterr().err
    assert f"of {len(seen)} guesses" in said
    assert "the best has a mean error of 2.0 mm, the first of 4.0" in said
    assert all(hand.grasp_frame == seen[0].grasp_frame for hand in seen)
    written = hand_from_file(out)
    assert dict(written.posture("open").angles_rad) == pytest.approx(
        dict(seen[-1].posture("open").angles_rad))
    asked = len(seen)
    assert cli.run(["hand", str(urdf), "-o", str(out), "--force", "--no-trials"]) == 0
    assert len(seen) == asked


def test_a_guess_without_a_score_is_never_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    def rows(parts: Sequence[tuple], device: str) -> list[dict[str, np.ndarray]]:
        (cell, episodes), *_ = parts
        failed = 'name = "1"' in Path(cell.hand.kind).read_text()
        value = np.full(len(episodes), np.nan if failed else 5.0)
        return [{"touched10mm": value, "chamfer_mm": value}] * len(parts)

    monkeypatch.setattr(hand_trials, "run_cells", rows)
    assert best_guess(named("0"), [named("1")])[0].name == "0"
    assert tried(named("1"), ("block",), 2) == Trial(0.0, np.inf)


def test_a_hand_that_cannot_close_is_not_tried_and_six_fingers_pass_one_another() -> None:
    finger = HAND.fingers[0]
    six = replace(HAND, thumb="", fingers=tuple(replace(finger, name=str(n)) for n in range(6)))
    assert trial_misfit(six) == trial_misfit(HAND) == ""
    soft = replace(finger, joints=tuple(replace(j, stiffness_Nm_rad=1e-3) for j in finger.joints))
    sagging = replace(HAND, fingers=(soft, *HAND.fingers[1:]))
    assert "sags by its own weight" in trial_misfit(sagging)
    assert _by_trial(sagging, framed=False)[0] == sagging
