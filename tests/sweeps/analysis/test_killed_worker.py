"""Episodes that are run again in a worker process that is killed."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from curved_episodes import wide_study, wide_text

from sweeps.analysis import rerun_episode
from sweeps.analysis.rerun_episode import Episode, WorkerDied, in_a_worker, rerun_all
from sweeps.report.views import Picked, make_views

pytestmark = pytest.mark.slow
MARK = "WARPGRASP_TEST_KILLED"
ONCE, ALWAYS = 2, 3


def dying_run(task: tuple[Any, int, str]) -> int:
    """The number of an episode, in place of it: ONCE kills its first process, ALWAYS every one."""
    episode = task[1]
    mark = Path(os.environ[MARK])
    if episode == ALWAYS or (episode == ONCE and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return episode


@pytest.fixture
def dying(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(MARK, str(tmp_path / "killed"))
    monkeypatch.setattr(rerun_episode, "_run", dying_run)


def test_what_a_killed_worker_had_is_run_again(dying: None, tmp_path: Path) -> None:
    plan, _ = wide_study(tmp_path / "study", wide_text(1, 1, 8))
    asked = [Episode(0, 0, n) for n in (0, 1, ONCE, 4, 5)]
    assert list(rerun_all(plan, asked, workers=2)) == [0, 1, ONCE, 4, 5]


def test_a_worker_that_dies_again_is_one_line(dying: None, tmp_path: Path) -> None:
    plan, _ = wide_study(tmp_path / "study", wide_text(1, 1, 8))
    found = rerun_all(plan, [Episode(0, 0, n) for n in (0, ALWAYS, 4)])
    assert next(found) == 0
    with pytest.raises(WorkerDied, match="killed"):
        next(found)
    with pytest.raises(WorkerDied, match="killed"):
        in_a_worker(dying_run, (None, ALWAYS, "cpu"))


def test_a_report_says_which_views_are_missing(
        dying: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, _ = wide_study(tmp_path / "study", wide_text(1, 1, 8))
    picked = [Picked("best", Episode(0, 0, ALWAYS), 1.0), Picked("worst", Episode(0, 0, 4), 2.0)]
    views = make_views(plan, picked)
    assert views.episodes == []
    assert capsys.readouterr().err.splitlines() == views.notes
    assert views.notes[0].startswith("2 of 2 episodes are missing from the 3-D views: a worker")
