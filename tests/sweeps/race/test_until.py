"""`sweep --until`: it ends when the best is known, and leaves the directory of a sweep."""

import contextlib
import io
import json
import shutil
from pathlib import Path

import pytest
from studies import write_spec

from sweeps.cli import main as cli
from sweeps.run import worker
from sweeps.run.store import Store, plan_of

SPEC = """\
schema = 1
seed = 7
episodes_per_cell = 8
objects = ["block", "wedge"]
""" + "".join(f"""[[strategy]]
name = "{name}"
waypoints = {{ kind = "ring", count = 6 }}
""" for name in ("ant", "bee", "horse"))
WITHIN = 0.14
FAKE = "fake_episodes:run_episodes"


@pytest.fixture(autouse=True)
def _fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "EPISODES", FAKE)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A sweep until the best was known, and what it printed."""
    folder, printed = tmp_path_factory.mktemp("until"), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.setattr(worker, "EPISODES", FAKE)
        assert until(write_spec(folder, SPEC), folder / "whole", "--json") == 0
    return folder / "whole", printed.getvalue()


def until(spec: Path, out: Path, *words: str, within: float = WITHIN) -> int:
    return cli.run(["sweep", str(spec), "-o", str(out), "--until", str(within), *words])


def files(out: Path) -> dict[str, bytes]:
    return {f"{file.parent.name}/{file.name}": file.read_bytes()
            for file in (out / "leaderboard.csv", out / "resolved.json",
                         *sorted((out / "units").iterdir()))
            } if out.exists() else {}


def same(one: Path, other: Path) -> None:
    mine, theirs = ({name.partition("/")[2]: content for name, content in files(out).items()}
                    for out in (one, other))
    assert mine == theirs


def test_it_goes_on_until_the_best_is_known(whole: tuple[Path, str],
                                            capsys: pytest.CaptureFixture[str]) -> None:
    out, printed = whole
    told = json.loads(printed)
    assert told["best"] in ("ant", "bee")
    assert told["claim"] == f"within {WITHIN} mm of the best of 3 on these 2 objects, 95 %"
    plan = plan_of(Store(out))
    each = plan.study.head.episodes_per_cell
    assert each % 64 == 0
    assert each > 64
    assert {row["n_episodes"] for row in told["table"] if row["rank"] is not None} == {2 * each}
    assert all(Store(out).has(unit, verify=True) for unit in plan.units())
    assert len(Store(out).unit_ids()) == plan.unit_count
    assert cli.run(["leaderboard", str(out)]) == 0
    assert "race" not in capsys.readouterr().err


def test_a_wide_margin_takes_the_first_rung_alone(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert until(write_spec(tmp_path, SPEC), out, within=5.0) == 0
    assert plan_of(Store(out)).study.head.episodes_per_cell == 64


@pytest.mark.slow
def test_workers_interruptions_and_a_sweep_before_change_no_row(
        tmp_path: Path, whole: tuple[Path, str]) -> None:
    spec, one = write_spec(tmp_path, SPEC), whole[0]
    assert until(spec, tmp_path / "two", "--workers", "2") == 0
    same(one, tmp_path / "two")
    shutil.copytree(one, tmp_path / "part")
    for file in sorted((tmp_path / "part" / "units").iterdir())[::2]:
        file.unlink()
    assert until(spec, tmp_path / "part") == 0
    same(one, tmp_path / "part")
    assert cli.run(["sweep", str(spec), "-o", str(tmp_path / "grown")]) == 0  # 8 episodes a cell
    assert until(spec, tmp_path / "grown") == 0
    mine, theirs = files(one), files(tmp_path / "grown")
    assert {name: content for name, content in mine.items() if name.startswith("units")} == {
        name: content for name, content in theirs.items() if name.startswith("units")}


def test_a_smaller_margin_goes_on_and_a_larger_one_takes_nothing_more(tmp_path: Path) -> None:
    spec, out = write_spec(tmp_path, SPEC), tmp_path / "out"
    assert until(spec, out, within=1.0) == 0
    before = set(Store(out).unit_ids())
    assert until(spec, out) == 0
    after = set(Store(out).unit_ids())
    assert before < after
    assert until(spec, out, within=1.0) == 0
    assert set(Store(out).unit_ids()) == after


@pytest.mark.parametrize(("words", "message"), [
    (["--until", "0"], "--until: is 0; should be a number"),
    (["--until", "1", "--shard", "1/2"], "--until: what comes next depends on all units"),
])
def test_refusals(tmp_path: Path, words: list[str], message: str,
                  capsys: pytest.CaptureFixture[str]) -> None:
    spec = write_spec(tmp_path, SPEC)
    assert cli.run(["sweep", str(spec), "-o", str(tmp_path / "out"), *words]) == 2
    assert message in capsys.readouterr().err
