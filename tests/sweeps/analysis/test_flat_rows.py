"""`warpgrasp rows`: one flat file of all episodes, contacts or points of curves."""

import csv
import re
from pathlib import Path
from typing import Any

import fake_episodes
import numpy as np
import pyarrow.parquet as pq
import pytest
from curved_episodes import wide_study, wide_text
from places import ROOT
from studies import SMALL, fill, plan_of

from sweeps.analysis import arrow
from sweeps.analysis.arrow import read_rows
from sweeps.cli import main as cli
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns
from sweeps.spec.cell import CONTACTS, Cell
from sweeps.spec.errors import StoreError

KEY = "sensors.tendon_threshold_N"
DRAWN = "object.yaw_deg"
SWEPT = wide_text(2, 3, 8, f"""
[sweep.grid]
"{KEY}" = [3.0, 6.0]
[sweep.sobol]
n = 2
"{DRAWN}" = {{ low = -180, high = 180 }}
""")


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Store]:
    return wide_study(tmp_path_factory.mktemp("swept"), SWEPT)


def rows_of(*words: object) -> Path:
    """The file that the command writes; the last word is its name."""
    assert cli.run(["rows", *map(str, words[:-1]), "-o", str(words[-1])]) == 0
    return Path(str(words[-1]))


def read_csv(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_study_without_a_finished_unit_has_no_table(tmp_path: Path) -> None:
    Store(tmp_path / "out").open_for(plan_of(tmp_path, SMALL), None, "cpu")
    with pytest.raises(StoreError, match="out: no unit is finished yet"):
        read_rows(tmp_path / "out")
    with pytest.raises(TypeError, match="read_rows: is given \\['out'\\]; should be the name of a"):
        read_rows(["out"])  # type: ignore[arg-type]


def test_every_episode_is_a_row_with_the_swept_keys_as_numbers(
        swept: tuple[Plan, Store], tmp_path: Path) -> None:
    plan, store = swept
    table = pq.read_table(rows_of(store.folder, tmp_path / "rows.parquet"))
    assert table.column_names[:7] == ["episode", "strategy", "object", "seed", "setting", KEY,
                                      DRAWN]
    assert not [f for f in table.schema if "list" in str(f.type)]
    rows = table.to_pylist()
    assert len(rows) == 2 * 3 * 2 * 2 * 8
    assert {row[KEY] for row in rows} == {3.0, 6.0}
    assert {row[DRAWN] for row in rows} == {
        plan.study.setting(n)[0][DRAWN] for n in range(plan.study.setting_count)}
    of_units = {(r["strategy"], r["object"], r["setting"], r["episode"]): r["chamfer_mm"]
                for r in read_rows(store.folder).to_pylist()}
    assert len(of_units) == len(rows)
    for row in rows:
        value = of_units[row["strategy"], row["object"], row["setting"], row["episode"]]
        assert row["chamfer_mm"] == (None if np.isnan(value) else value)
    assert None in table["chamfer_mm"].to_pylist()  # failed episodes: no number, and no NaN


def test_the_order_is_that_of_the_spec(swept: tuple[Plan, Store], tmp_path: Path) -> None:
    plan, store = swept
    names = [body.name for body in plan.study.objects]
    rows = pq.read_table(rows_of(store.folder, tmp_path / "rows.parquet")).to_pylist()
    keys = [(len(r["strategy"]), names.index(r["object"]), r["setting"], r["episode"])
            for r in rows]
    assert keys == sorted(keys)


@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
@pytest.mark.parametrize("what", [[], ["--curves"]])
def test_the_same_bytes_each_time_and_in_parts_the_same_rows(
        swept: tuple[Plan, Store], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str,
        what: list[str]) -> None:
    _, store = swept
    whole, again = (rows_of(store.folder, *what, tmp_path / f"{n}{name}") for n in (1, 2))
    assert whole.read_bytes() == again.read_bytes()
    monkeypatch.setattr(arrow, "GROUP", 100)
    parts = rows_of(store.folder, *what, tmp_path / f"3{name}")
    if name.endswith("csv"):
        assert parts.read_bytes() == whole.read_bytes()
    else:
        assert pq.read_table(parts).equals(pq.read_table(whole))
        assert pq.ParquetFile(parts).num_row_groups > pq.ParquetFile(whole).num_row_groups == 1
    assert len(list(tmp_path.iterdir())) == 3  # nothing temporary is left


def test_curves_are_a_row_a_point(swept: tuple[Plan, Store], tmp_path: Path) -> None:
    _, store = swept
    points = pq.read_table(rows_of(store.folder, "--curves", tmp_path / "k.parquet")).to_pylist()
    found: dict[tuple, list[float]] = {}
    for p in points:
        own = found.setdefault((p["strategy"], p["object"], p["setting"], p["episode"]), [])
        assert p["point"] == len(own)
        own.append(p["touches"])
    for row in read_rows(store.folder).to_pylist():
        key = row["strategy"], row["object"], row["setting"], row["episode"]
        assert found[key] == row["curve_touches"]
    assert set(points[0]) == {"episode", "strategy", "object", "seed", "setting", KEY, DRAWN,
                              "point", "touches", "time_s", "chamfer_mm", "iou"}


def test_contacts_are_rows_where_they_are_kept(
        tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "calls"))
    text = SMALL.replace("seed = 7", 'seed = 7\nkeep = "contacts"')
    plan = plan_of(tmp_path / "s", text)
    store = fill(tmp_path / "s", plan, fake_episodes.touching_episodes)
    rows = pq.read_table(rows_of(store.folder, "--contacts", tmp_path / "c.parquet")).to_pylist()
    assert len(rows) == 4 * sum(n % 3 for n in range(70))
    assert {row["taxel_peak"] for row in rows} == {None}
    assert rows[0]["x_m"] == pytest.approx(0.451)
    lost = next(iter(store.contacts.iterdir()))
    lost.unlink()
    capsys.readouterr()
    rows_of(store.folder, "--contacts", tmp_path / "c.csv")
    assert "1 finished units have no contacts" in capsys.readouterr().err
    fill(tmp_path / "none", plan_of(tmp_path / "none", SMALL))
    for kind, said in (("--contacts", 'keep = "contacts"'), ("--curves", "holds no curves")):
        assert cli.run(["rows", str(tmp_path / "none"), kind, "-o", str(tmp_path / "x.csv")]) == 2
        assert said in capsys.readouterr().err
    assert not (tmp_path / "x.csv").exists()


def test_failed_units_are_told_apart_from_missing_ones(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan)
    failed, missing, *_ = plan.units()
    for unit in (failed, missing):
        store.path(unit).unlink()
    store.log(failed).write_text("hung")
    capsys.readouterr()
    rows_of(store.folder, tmp_path / "rows.csv")
    said = capsys.readouterr().err
    assert "1 of 8 units failed and have no rows; see logs/*.failed.log" in said
    assert "1 of 8 units are missing" in said


def test_a_growing_study_has_the_episodes_from_before(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """70 episodes a cell are 64 and 6, which a run of 100 has in a unit of 36."""
    text = SMALL.replace("seed = 7", 'seed = 7\nkeep = "contacts"')
    before = fill(tmp_path / "s", plan_of(tmp_path / "a", text), of_two_hands)
    expected = [pq.read_table(rows_of(before.folder, *words, tmp_path / "a.parquet")).to_pylist()
                for words in ((), ("--contacts",))]
    plan = plan_of(tmp_path / "b", text.replace("_cell = 70", "_cell = 100"))
    assert "grown" in before.open_for(plan, None, "cpu")[0]
    capsys.readouterr()
    assert [pq.read_table(rows_of(before.folder, *words, tmp_path / "b.parquet")).to_pylist()
            for words in ((), ("--contacts",))] == expected
    assert "the study has grown, and not every entry has more episodes yet" in (
        capsys.readouterr().err)
    assert len(read_rows(before.folder)) == len(expected[0])


@pytest.mark.parametrize("words", [["table", "objects"], ["rows", "-o", "rows.csv"]])
def test_damaged_units_are_told_by_whoever_finds_them(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
        words: list[str]) -> None:
    monkeypatch.chdir(tmp_path)
    plan = plan_of(tmp_path / "s")
    store = fill(tmp_path / "s", plan)
    file = store.path(next(plan.units()))
    file.write_bytes(file.read_bytes()[:200])
    capsys.readouterr()
    assert cli.run([words[0], "s", *words[1:]]) == 0
    assert (f"1 damaged unit set aside; see {Path('s') / 'logs'}; run the sweep again"
            in capsys.readouterr().err)


def test_what_is_left_out_of_the_table_is_told_in_python_too(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The one who read a damaged unit first was never told, nor the next one."""
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan)
    damaged, failed, *_ = plan.units()
    store.path(damaged).write_bytes(store.path(damaged).read_bytes()[:200])
    store.path(failed).unlink()
    store.log(failed).write_text("hung")
    capsys.readouterr()
    lost = damaged.stop - damaged.start + failed.stop - failed.start
    assert len(read_rows(store.folder)) == 2 * 2 * 70 - lost
    said = capsys.readouterr().err
    for line in ("1 of 8 units failed and have no rows", "1 of 8 units are missing",
                 "1 damaged unit set aside"):
        assert line in said
    with pytest.raises(StoreError, match="no directory is named"):
        read_rows()


@fake_episodes.cell_by_cell
def of_two_hands(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    """Contacts with more joints in one setting; on one object none."""
    rows = fake_episodes.with_contacts(fake_episodes.rows_of(cell, episodes), cell, episodes)
    for n, table in enumerate(rows[CONTACTS]):
        if cell.sensors.tendon_threshold_N > 3.0:
            table["q4_rad"] = np.full(len(table["status"]), 0.5, np.float32)
        if cell.object_name == "wedge":
            rows[CONTACTS][n] = {name: values[:0] for name, values in table.items()}
    return rows


@pytest.mark.parametrize("order", ["[3.0, 6.0]", "[6.0, 3.0]"])
@pytest.mark.parametrize("objects", ['["block", "wedge"]', '["wedge", "block"]'])
def test_contacts_of_hands_that_differ_are_one_table(tmp_path: Path, order: str, objects: str
                                                     ) -> None:
    text = SMALL.replace("seed = 7", 'seed = 7\nkeep = "contacts"').replace(
        '["block", "wedge"]', objects) + f'[sweep.grid]\n"{KEY}" = {order}\n'
    plan = plan_of(tmp_path / "s", text)
    store = fill(tmp_path / "s", plan, of_two_hands)
    rows = pq.read_table(rows_of(store.folder, "--contacts", tmp_path / "c.parquet")).to_pylist()
    assert len(rows) == 4 * sum(n % 3 for n in range(70))
    assert {(row[KEY], row["q4_rad"]) for row in rows} == {(3.0, None), (6.0, 0.5)}


def test_missing_units_are_told_and_shards_merge(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, store = wide_study(tmp_path / "one", wide_text(2, 2, 5))
    other = Store(tmp_path / "two")
    other.open_for(plan, None, "cpu")
    moved = sorted(store.units.iterdir())[:2]
    for file in moved:
        file.rename(other.units / file.name)
    rows_of(store.folder, tmp_path / "part.csv")
    assert "2 of 4 units are missing" in capsys.readouterr().err
    assert len(read_csv(tmp_path / "part.csv")) == 10
    assert len(read_csv(rows_of(store.folder, other.folder, tmp_path / "all.csv"))) == 20


@pytest.mark.parametrize(("text", "cell"), [
    ("=1+1", "'=1+1"), ("+cmd", "'+cmd"), ("-x", "'-x"), ("@sum", "'@sum"), ("-3.5", "-3.5"),
    ("+1e-3", "+1e-3"), ("a=b", "a=b"), ("it's", "it's")])
def test_no_cell_is_run_by_a_spreadsheet(tmp_path: Path, text: str, cell: str) -> None:
    spec = wide_text(1, 1, 2).replace('name = "s"', f'name = "{text}"')
    _, store = wide_study(tmp_path / "s", spec)
    assert [row["strategy"] for row in read_csv(rows_of(store.folder, tmp_path / "r.csv"))] == [
        cell] * 2
    as_parquet = pq.read_table(rows_of(store.folder, tmp_path / "r.parquet"))
    assert as_parquet["strategy"].to_pylist() == [text] * 2


def test_numbers_are_left_alone(tmp_path: Path) -> None:
    _, store = wide_study(tmp_path / "s", wide_text(
        1, 1, 2, '[sweep.grid]\n"object.yaw_deg" = [-90]\n"strategy.closings" = [["curl40"]]\n'
                 '"sensors.tendon_threshold_N" = [3, 4.5]\n"fit.free_space" = [true]\n'))
    rows = read_csv(rows_of(store.folder, tmp_path / "r.csv"))
    assert {(r["object.yaw_deg"], r["strategy.closings"], r[KEY], r["fit.free_space"])
            for r in rows} == {("-90", "(curl40)", threshold, "true") for threshold in ("3", "4.5")}


@pytest.mark.parametrize(("words", "said"), [
    ([], "-o should name a file"), (["-o", "r.txt"], "-o should name a file"),
    (["-o", "r.csv", "--contacts", "--curves"], "one at a time"),
    (["-o", "none/r.csv"], "none/r.csv: cannot be written")])
def test_what_cannot_be_written_is_said(
        swept: tuple[Plan, Store], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str], words: list[str], said: str) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.run(["rows", str(swept[1].folder), *words]) == 2
    printed = capsys.readouterr()
    assert (printed.out, said in printed.err) == ("", True)
    assert not list(tmp_path.iterdir())


def lines_of_docs(word: str) -> list[str]:
    text = (ROOT / "docs/leaderboard.md").read_text()
    return [line.strip() for line in text.splitlines() if line.strip().startswith(word)]


def mean_of(rows: list[dict[str, Any]], strategy: str, body: str) -> float:
    return float(np.mean([row["chamfer_mm"] for row in rows if row["chamfer_mm"] is not None
                          and (row["strategy"], row["object"]) == (strategy, body)]))


def test_the_line_of_pandas_in_the_docs(
        swept: tuple[Plan, Store], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pandas = pytest.importorskip("pandas")
    line, = lines_of_docs("pandas.read_parquet")
    monkeypatch.chdir(tmp_path)
    rows = pq.read_table(rows_of(swept[1].folder, Path("rows.parquet"))).to_pylist()
    found: Any = eval(line, {"pandas": pandas})
    assert found.shape == (3, 2)
    for strategy in found.columns:
        for body in found.index:
            assert found[strategy][body] == pytest.approx(mean_of(rows, strategy, body))


def test_the_line_of_duckdb_in_the_docs(
        swept: tuple[Plan, Store], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    duckdb = pytest.importorskip("duckdb")
    line, = lines_of_docs("duckdb -c")
    found = re.fullmatch(r'duckdb -c "(.*)"', line)
    assert found
    monkeypatch.chdir(tmp_path)
    rows_of(swept[1].folder, Path("rows.parquet"))
    rows = pq.read_table("rows.parquet").to_pylist()
    answer = duckdb.sql(found[1]).fetchall()
    assert len(answer) == 2 * 3
    for strategy, body, mean, count in answer:
        assert mean == pytest.approx(mean_of(rows, strategy, body))
        assert count == len(rows) / 6
