"""Which episode of a study is meant, by name or by its leaderboard."""

from pathlib import Path

import numpy as np
import pytest
from curved_episodes import wide_study, wide_text

from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.analysis.rerun_episode import OTHERWISE, Episode, choose_episode, ended_otherwise
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.run.unit_file import write_unit
from sweeps.spec.errors import StoreError

SWEPT = wide_text(2, 2, 8, """
[sweep.grid]
"sensors.tendon_threshold_N" = [6.0, 3.0, 9.0]
"object.yaw_deg" = [0, 90]
""")
KEY = "sensors.tendon_threshold_N"


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Store]:
    return wide_study(tmp_path_factory.mktemp("swept"), SWEPT)


@pytest.mark.parametrize("strategy", [None, "s", "sx"])
def test_the_best_setting_is_played_again(
    swept: tuple[Plan, Store], strategy: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    """The stand-ins lose 0.1 mm a newton, so that the best is not the first of the spec. Which one
    it is, is said."""
    plan, store = swept
    episode = choose_episode(plan, [store], strategy, None, 3)
    cell = plan.study.cell(episode.strategy, episode.body, episode.setting)
    assert cell.setting[KEY] == 3.0
    assert cell.strategy.name == (strategy or "s")
    assert episode.episode == 3
    assert f"leaderboard's first: {strategy or 's'} [{KEY}=3, " in capsys.readouterr().err


def test_every_entry_of_the_leaderboard_can_be_named(swept: tuple[Plan, Store]) -> None:
    plan, store = swept
    for row in make_leaderboard(plan, [store]).rows:
        episode = choose_episode(plan, [store], row[1], "large_cylinder", 0)
        cell = plan.study.cell(episode.strategy, episode.body, episode.setting)
        told = ", ".join(f"{key}={value:g}" for key, value in cell.setting.items())
        assert f"{cell.strategy.name} [{told}]" == row[1]
        assert cell.object_name == "large_cylinder"
    with pytest.raises(StoreError, match="--strategy: the study has no"):
        choose_episode(plan, [store], f"s [{KEY}=4]", None, 0)


def test_a_study_of_one_entry_needs_no_units(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(1, 1, 2))
    for file in store.units.iterdir():
        file.unlink()
    assert choose_episode(plan, [store], None, None, 1).setting == 0


def test_an_episode_that_ends_otherwise_than_its_row_is_told(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(1, 2, 70))
    unit = next(unit for unit in plan.units() if unit.start == 64)
    rows = store.read(unit)
    assert rows is not None
    notes = np.full(len(rows["status"]), "", object)
    notes[3] = "mine.py:7: next_best: ValueError"
    status = np.array(rows["status"], object)
    status[3] = "strategy_failed"
    write_unit(store.path(unit), unit.id, {**rows, "status": status, "note": notes})
    episode = Episode(0, [body.name for body in plan.study.objects].index(unit.cell.object_name),
                      67)
    assert ended_otherwise(plan, [store], episode, "ok") == (
        "its row in the study has the status strategy_failed (mine.py:7: next_best: ValueError): "
        f"{OTHERWISE}")
    assert ended_otherwise(plan, [store], episode, "strategy_failed") == ""
    assert ended_otherwise(plan, [], episode, "ok") == ""  # of a race: no such unit
