"""The directory of a race: what compares entries refuses it, `rows` reads the race's own units."""

import csv
import io
from collections import Counter
from contextlib import redirect_stdout
from pathlib import Path

import pytest
from studies import write_spec

from sweeps.analysis.arrow import read_rows
from sweeps.analysis.rerun_episode import choose_episode, ended_otherwise
from sweeps.cli import main as cli
from sweeps.run import worker
from sweeps.run.store import open_study
from sweeps.spec.errors import StoreError

SPEC = """\
schema = 1
seed = 1
episodes_per_cell = 8
objects = ["block", "wedge", "funnel"]
""" + "".join(f"""[[strategy]]
name = "{name}"
waypoints = {{ kind = "ring", count = 6 }}
""" for name in ("ant", "bee", "cow", "horse", "elephant"))
"""As many episodes a cell as a race's first rung: those are the units of a sweep, too."""
SWEPT = SPEC.partition("[[strategy]]\nname = \"cow\"")[0] + """
[sweep.grid]
"sensors.tendon_threshold_N" = [3, 9]
"""
COMPARING = (["leaderboard", "OUT"], ["table", "OUT", "pairs"], ["table", "OUT", "pareto"],
             ["report", "OUT", "--no-views", "-o", "FILE.html"],
             ["figure", "OUT", "forest", "-o", "FILE.svg"], ["compare", "OUT", "OUT"],
             ["figure", "OUT", "faces", "-o", "FILE.svg"])


@pytest.fixture(autouse=True)
def _fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")


def run(*words: object) -> int:
    with redirect_stdout(io.StringIO()):
        return cli.run([*map(str, words)])


def race(spec: Path, out: Path, *words: str) -> int:
    return run("race", spec, "-o", out, "--within", "0.3", *words)


def answers(out: Path) -> set[int]:
    """The exit codes of all that compares entries; a figure's episode would be the best's."""
    places = {"OUT": str(out), "FILE.html": str(out.parent / "r.html"),
              "FILE.svg": str(out.parent / "f.svg")}
    return {run(*(places.get(word, word) for word in words)) for words in COMPARING}


def test_what_compares_entries_refuses_a_race(tmp_path: Path,
                                              capsys: pytest.CaptureFixture[str]) -> None:
    spec, out = write_spec(tmp_path, SPEC), tmp_path / "out"
    assert race(spec, out) == 0
    assert answers(out) == {3}
    assert "read race.csv" in capsys.readouterr().err
    assert run("sweep", spec, "-o", out) == 0
    capsys.readouterr()
    assert run("leaderboard", out) == 0
    assert "race" not in capsys.readouterr().err  # though its race.csv is still there


def test_a_sweep_that_was_finished_before_is_still_read(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, out = write_spec(tmp_path, SPEC), tmp_path / "out"
    assert run("sweep", spec, "-o", out) == 0
    assert race(spec, out) == 0
    assert run("leaderboard", out) == run("table", out, "pairs") == 0
    capsys.readouterr()
    assert run("rows", out, "-o", tmp_path / "rows.csv") == 0
    assert f"{5 * 3 * 8} rows" in (said := capsys.readouterr().err)
    assert "rows are those of the sweep" in said
    more = write_spec(tmp_path, SPEC.replace("cell = 8", "cell = 9"))
    assert race(more, out) == 0
    assert run("leaderboard", out) == 3  # of the study that it is now no sweep was finished


def test_a_race_whose_note_is_damaged_is_no_sweep(tmp_path: Path,
                                                  capsys: pytest.CaptureFixture[str]) -> None:
    """It was ranked by its first rung, without a word."""
    spec, out = write_spec(tmp_path, SPEC), tmp_path / "out"
    assert race(spec, out) == 0
    note = out / "logs/race.json"
    whole = note.read_bytes()
    note.write_bytes(whole[:100])
    assert answers(out) == {3}
    assert run("rows", out, "-o", tmp_path / "rows.csv") == 3
    assert "race.json should say how the race" in capsys.readouterr().err
    assert cli.run(["status", str(out)]) == 0
    assert "not known: logs/race.json cannot be read" in capsys.readouterr().out
    assert race(spec, out) == 0
    assert note.read_bytes() == whole


@pytest.mark.parametrize("over", ["these", "like-these"])
def test_rows_are_the_episodes_that_the_race_took(
        tmp_path: Path, over: str, capsys: pytest.CaptureFixture[str]) -> None:
    spec, out = write_spec(tmp_path, SWEPT), tmp_path / "out"
    assert race(spec, out, "--over", over) == 0
    taken = {row["strategy"]: int(row["n_episodes"])
             for row in csv.DictReader((out / "race.csv").read_text().splitlines())}
    capsys.readouterr()
    assert run("rows", out, "-o", tmp_path / "rows.csv") == 0
    assert f"{sum(taken.values())} rows" in (said := capsys.readouterr().err)
    assert "holds a race" in said
    assert "missing" not in said
    with (tmp_path / "rows.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    key = "sensors.tendon_threshold_N"
    assert Counter(f"{row['strategy']} [{key}={row[key]}]" for row in rows) == taken
    order = [(row["strategy"], row["object"], int(row["setting"]), int(row["episode"]))
             for row in rows]
    assert len(set(order)) == len(order)
    names = ["ant", "bee"], ["block", "wedge", "funnel"]
    assert order == sorted(order, key=lambda row: (names[0].index(row[0]), names[1].index(row[1]),
                                                   *row[2:]))
    assert read_rows(out).num_rows == len(rows)
    assert run("figure", out, "contacts", "-o", tmp_path / "contacts.png") == 3
    assert "--strategy: should name an entry" in capsys.readouterr().err


def test_an_episode_beyond_those_of_the_spec_is_found(tmp_path: Path) -> None:
    """A race takes as many as it needs; what its rows say of each is compared with, too."""
    spec, out = write_spec(tmp_path, SPEC), tmp_path / "out"
    assert race(spec, out) == 0
    with (out / "race.csv").open() as stream:
        best = next(csv.DictReader(stream))
    plan, stores = open_study([out])
    last = int(best["n_episodes"]) // 3 - 1
    assert last >= plan.study.head.episodes_per_cell
    episode = choose_episode(plan, stores, best["strategy"], "wedge", last)
    assert ended_otherwise(plan, stores, episode, "ok") == ""
    assert ended_otherwise(plan, stores, episode, "?").startswith("its row in the study has the")
    with pytest.raises(StoreError, match=f"whole number from 0 to {last}$"):
        choose_episode(plan, stores, best["strategy"], "wedge", last + 1)


def test_rows_of_a_search_are_refused(tmp_path: Path) -> None:
    (one := SPEC.split("[[strategy]]"))[2:] = []
    text = "[[strategy]]".join(one) + '[search]\n"strategy.count" = { low = 3, high = 6 }\n'
    spec, out = write_spec(tmp_path, text), tmp_path / "out"
    assert race(spec, out, "--budget-episodes", "600") == 0
    with pytest.raises(StoreError, match=r"see its search\.csv"):
        read_rows(out)
    assert run("leaderboard", out) == 3
