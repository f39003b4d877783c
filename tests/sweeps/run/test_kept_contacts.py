"""Contacts that a study keeps beside its rows: whole, checked, and no part of any result."""

import os
from pathlib import Path

import fake_episodes
import numpy as np
import pytest
from studies import SMALL, board, contents, plan_of, run_in

from sweeps.cli import main as cli
from sweeps.run import unit_file, worker
from sweeps.run.estimate import estimate_cost
from sweeps.run.plan import Plan
from sweeps.run.store import Store, open_study
from sweeps.run.unit_file import write_files
from sweeps.run.worker import run_units
from sweeps.spec.errors import SpecError
from sweeps.spec.reader import read_spec

KEEP = SMALL.replace("seed = 7", 'seed = 7\nkeep = "contacts"')


@pytest.fixture(autouse=True)
def _log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "calls"))


def calls(folder: Path) -> int:
    """Units that were run."""
    return sum(int(line.split()[1]) for line in (folder / "calls").read_text().splitlines())


def plans(folder: Path) -> tuple[Plan, Plan]:
    return plan_of(folder / "a"), plan_of(folder / "b", KEEP)


def test_what_is_kept_changes_no_row_no_unit_and_no_leaderboard(tmp_path: Path) -> None:
    plain, keeping = plans(tmp_path)
    assert plain.hash == keeping.hash
    assert [u.id for u in plain.units()] == [u.id for u in keeping.units()]
    for plan, name in ((plain, "one"), (keeping, "two")):
        run_in(tmp_path / name, plan, "touching_episodes", workers=2)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    assert board(plain, tmp_path / "one") == board(keeping, tmp_path / "two")
    assert not (tmp_path / "one" / "contacts").exists()


def test_every_contact_of_every_episode_is_there(tmp_path: Path) -> None:
    _, plan = plans(tmp_path)
    run_in(tmp_path / "out", plan, "touching_episodes")
    found, (store,) = open_study([tmp_path / "out"])
    assert found.study.head.keep == "contacts"
    for unit in plan.units():
        contacts = store.read_contacts(unit)
        assert contacts is not None
        episodes = np.arange(unit.start, unit.stop)
        assert contacts["episode"].tolist() == np.repeat(episodes, episodes % 3).tolist()
        assert set(contacts["strategy"]) == {unit.cell.strategy.name}
        assert set(contacts["object"]) == {unit.cell.object_name}
        assert contacts["x_m"] == pytest.approx(0.45 + 0.001 * contacts["episode"])
        assert contacts["probe"].dtype == np.int32


def test_a_study_that_keeps_them_from_now_on_makes_what_is_missing(
        tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:touching_episodes")
    out, spec = tmp_path / "out", tmp_path / "spec.toml"
    spec.write_text(SMALL)
    assert cli.run(["sweep", str(spec), "-o", str(out)]) == 0
    before, made = contents(out), calls(tmp_path)
    capsys.readouterr()
    words = ["sweep", str(spec), "-o", str(out), "--set", "keep=contacts"]
    assert cli.run(words) == 0
    assert "contacts are kept from now on" in capsys.readouterr().err
    assert contents(out) == before
    assert calls(tmp_path) == 2 * made
    first = sorted((out / "contacts").iterdir())[0]
    first.unlink()
    assert cli.run(["status", str(out), "--json"]) == 0
    assert '"left": 1' in capsys.readouterr().out
    assert cli.run(words) == 0
    assert first.exists()
    assert calls(tmp_path) == 2 * made + 1
    assert cli.run(words[:-2]) == 0  # kept no more: nothing to do, and nothing is lost
    assert calls(tmp_path) == 2 * made + 1
    assert first.exists()


@pytest.mark.parametrize("verify", [False, True])
def test_damaged_contacts_are_made_again(tmp_path: Path, verify: bool) -> None:
    _, plan = plans(tmp_path)
    out = tmp_path / "out"
    run_in(out, plan, "touching_episodes")
    file = sorted((out / "contacts").iterdir())[1]
    whole = file.read_bytes()
    damaged = bytearray(whole)
    if verify:
        damaged[len(whole) // 3] ^= 1
    else:
        del damaged[len(whole) // 2:]
    file.write_bytes(damaged)
    outcome = run_in(out, plan, "touching_episodes", verify=verify)
    assert (outcome.kept, outcome.done) == (plan.unit_count - 1, 1)
    assert file.read_bytes() == whole
    assert (out / "logs" / f"{file.stem}.contacts.damaged").read_bytes() == damaged


def test_a_unit_that_is_there_has_its_contacts(tmp_path: Path,
                                               monkeypatch: pytest.MonkeyPatch) -> None:
    """The contacts are written first, so that no kill leaves a unit without them."""
    _, plan = plans(tmp_path)
    store, unit = Store(tmp_path / "out"), next(plan.units())
    store.open_for(plan, None, "cpu")
    rows, = run_units(fake_episodes.touching_episodes, [unit], "cpu")
    written = []
    real = unit_file.write_atomic
    monkeypatch.setattr(unit_file, "write_atomic", lambda path, content: (
        written.append(path.parent.name), real(path, content)))
    write_files(store.path(unit), unit.id, rows)
    assert written == ["contacts", "units"]
    os.remove(store.path(unit))
    assert not store.has(unit)


def test_a_spec_may_keep_contacts_or_nothing(tmp_path: Path) -> None:
    file = tmp_path / "spec.toml"
    file.write_text(SMALL.replace("seed = 7", 'seed = 7\nkeep = "touches"'))
    with pytest.raises(SpecError, match=r"keep: is 'touches'; .*nothing, contacts"):
        read_spec(file)


def test_the_estimate_counts_contacts(tmp_path: Path) -> None:
    plain, keeping = (dict(estimate_cost(plan))["disk"].split()[1] for plan in plans(tmp_path))
    assert float(keeping) > 2 * float(plain)
