"""What a run tells of itself while it goes on."""

from pathlib import Path

import pytest

from sweeps.run import progress
from sweeps.run.progress import Progress, read_note


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_the_rate_is_that_of_the_units_done_since_all_was_compiled(clock: list[float]) -> None:
    told = Progress(20, quiet=True)
    assert told.rate is None
    clock[0] = 60.0  # workers start, and one of them compiles
    told.done(64)
    told.measure()
    assert told.rate is None
    assert told.seconds_left is None
    clock[0] = 68.0
    for _ in range(4):  # of one call, so all at once
        told.done(64)
    assert told.rate == 0.5
    clock[0] = 75.0  # the next call goes on
    assert told.rate == 0.5
    assert told.seconds_left == 30.0
    told.kept()
    assert (told.rate, told.seconds_left) == (0.5, 28.0)


def test_a_first_batch_that_comes_at_once_does_not_tell_an_endless_rate(
        clock: list[float]) -> None:
    told = Progress(16, quiet=True)
    clock[0] = 2.0
    told.measure()
    clock[0] = 4.0
    for _ in range(8):
        told.done(64)
    assert told.rate == 4.0


@pytest.mark.parametrize("number", ["1e999", "null", "NaN", '"x"', "[]"])
def test_a_damaged_note_tells_of_no_run(tmp_path: Path, number: str) -> None:
    file = tmp_path / "progress-1-of-1.json"
    file.write_text(f'{{"running": {number}, "kept": 1, "done": 1, "failed": 0, "total": 3, '
                    '"units_per_s": 1.0}')
    assert read_note(file) == {"running": 0, "units_per_s": 0.0, "past": 0, "total": 0}
