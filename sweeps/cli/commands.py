"""The commands that run or read a study: each answers with the process's exit code."""

import csv
import io
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from shlex import quote
from tempfile import TemporaryDirectory
from typing import Any

from sweeps.analysis.bootstrap import population
from sweeps.analysis.leaderboard import Leaderboard, make_leaderboard
from sweeps.cli.app import DONE, SOME_FAILED
from sweeps.output import note, say, write_atomic
from sweeps.race.race_note import end_race_note, race_state
from sweeps.result_file import check_table, write_result
from sweeps.run import worker
from sweeps.run.grown_units import kept_units, reuse_units
from sweeps.run.local_engine import UNIT_TIMEOUT_S, Options, run, terminated_as_interrupted
from sweeps.run.plan import Plan, plan_study
from sweeps.run.progress import Progress, read_note
from sweeps.run.race_record import RACE_NOTE, open_sweep, read_race_note
from sweeps.run.scheduler import Outcome
from sweeps.run.store import Store, damaged_notes, plan_of
from sweeps.spec.errors import OtherStudy, StoreError
from sweeps.spec.reader import read_spec, spec_text
from sweeps.spec.search import refuse_search
from sweeps.spec.toml_reader import read_content
from sweeps.text_table import finite_or_none, json_record, print_json, print_table
from warpgrasp.core.plain_text import counted, csv_cell, on_one_line

RANKED = "leaderboard.csv"
# Columns that fit a terminal, after the means and their intervals; the file has them all.
SHOWN = ("p_best", "iou", "recognized", "touches",
         "robot_time_s", "failure_rate", "n_objects", "n_episodes")


def sweep(spec: Path, folder: Path, *, workers: int, shard: tuple[int, int], device: str,
          settings: Sequence[str], as_json: bool, engine: str = "local",
          address: str | None = None, unit_timeout_s: float = UNIT_TIMEOUT_S,
          verify: bool = False, until: float | None = None, reuse: Sequence[Path] = ()) -> int:
    """Runs what is left of a study, then ranks it; `until` its best is known within so much. Units
    that are the same in the studies of `reuse` are taken from there."""
    options = Options(workers, shard, device, worker.EPISODES, unit_timeout_s, verify)
    if until is not None:
        return _sweep_until(spec, folder, until, options, settings, as_json, engine, address)
    content = read_content(spec)
    plan = plan_study(read_spec(spec, settings, content))
    refuse_search(plan.study, spec)
    store, others = Store(folder), [Store(other) for other in reuse]
    for other in others:
        other.resolved()  # refuses a directory that holds no study
    with terminated_as_interrupted(), store.lock(shard):
        try:
            notes = store.open_for(plan, spec_text(content, settings), device)
        except OtherStudy as error:
            raise OtherStudy(folder, error.lines, (
                "choose another directory (`warpgrasp sweep SPEC.toml -o NEW --reuse "
                f"{quote(str(folder))}` takes over the units that are the same), or undo:")
            ) from None
        for line in notes:
            note(line)
        end_race_note(store.logs)
        _reuse(plan, store, others, shard, device)
        count, kept = plan.shard_size(shard), kept_units(plan, store, shard)
        if 0 < kept.whole + kept.part < count:
            begun = f", and the beginning of {kept.part} more" if kept.part else ""
            note(f"{kept.whole} of {count} units are there already{begun}")
        outcome = _run(plan, store, options, engine, address)
        if outcome.done + outcome.failed == 0:
            note(f"{folder}: finished already, {outcome.kept} units")
        if shard[1] == 1:
            before = store.damaged + len(store.stuck)
            first = plan_of(store)  # the same study in its first spec's order: bootstraps go by it
            board = make_leaderboard(first, [store])
            if damaged := store.damaged + len(store.stuck) - before:  # seen by reading every row
                note(f"running {counted(damaged, 'damaged unit')} again; see {store.logs}")
                outcome = _run(plan, store, options, engine, address)
                board = make_leaderboard(first, [store])
            write_atomic(folder / RANKED, board.csv())
            _show(board, as_json)
    if shard[1] > 1:
        note(f"shard {shard[0]} of {shard[1]} is done; `warpgrasp leaderboard` merges directories")
    if outcome.failed:
        say(f"{counted(outcome.failed, 'unit')} failed; see {store.logs}/*.failed.log")
    if outcome.lost:
        say(f"{counted(outcome.lost, 'unit')} lost: run, and no file is there; run the sweep again")
    return SOME_FAILED if outcome.failed or outcome.lost else DONE


def _reuse(plan: Plan, store: Store, others: Sequence[Store], shard: tuple[int, int],
           device: str) -> None:
    """Takes over units of other studies, and says how many."""
    if not others:
        return
    try:
        for line in (f"{other.folder}: {line}" for other in others
                     for line in other.environment_notes(device)):
            note(line)
        count = reuse_units(plan, store, others, shard)
    except OSError as error:
        raise StoreError(f"{error.filename or store.folder}: cannot be read or written: "
                         f"{error.strerror or error}") from None
    note(f"{count} of {plan.shard_size(shard)} units are taken from "
         f"{', '.join(str(other.folder) for other in others)}")


def _sweep_until(spec: Path, folder: Path, within: float, options: Options,
                 settings: Sequence[str], as_json: bool, engine: str, address: str | None) -> int:
    """Runs a sweep until its best is known; prints what is known above the leaderboard."""
    from sweeps.race.until import sweep_until

    found = sweep_until(spec, folder, within=within, options=options, settings=settings,
                        engine=engine, address=address)
    if as_json:
        print_json({**json_record(found.lines), "within": finite_or_none(found.within),
                    "table": found.board.records()})
    else:
        width = max(map(len, found.lines))
        for name, text in found.lines.items():
            print(f"{name.ljust(width)}  {on_one_line(text)}")
        print()
        _show(found.board, False)
    return SOME_FAILED if found.failed else DONE


def _run(plan: Plan, store: Store, options: Options, engine: str,
         address: str | None) -> Outcome:
    """Runs what is left of a shard on one of the engines."""
    index, count = options.shard
    with Progress(plan.shard_size(options.shard), store.note(f"{index}-of-{count}")) as progress:
        if engine == "ray":
            from sweeps.run.ray_engine import run_on_ray

            return run_on_ray(plan, store, options, progress, address)
        return run(plan, store, options, progress)


def status(folder: Path, *, as_json: bool) -> int:
    """Print the progress of a study; nothing is written."""
    store = Store(folder)
    plan = plan_of(store)
    holders = store.holders()
    notes = [read_note(store.note(shard)) for shard in holders]
    rates = [note["units_per_s"] for note in notes if note["units_per_s"]]
    counts, left, other = _race_counts(store, notes) or _sweep_counts(plan, store)
    found: dict[str, Any] = {
        "study": store.resolved().get("name", ""), "hash": plan.hash, **counts,
        "running": sum(note["running"] for note in notes), "left": left,
        "units_per_s": round(sum(rates), 4) if rates else None,
        "seconds_left": round(left / sum(rates), 1) if rates and left is not None else None,
        "held_by": list(holders.values()),
        "other_files": other,
    }
    if as_json:
        print_json(found)
    else:
        for name, value in found.items():
            text = ", ".join(value) if isinstance(value, list) else value
            print(f"{name.ljust(12)}  {'-' if text in (None, '') else on_one_line(str(text))}")
    return DONE


Counts = tuple[dict[str, int | str | None], int | None, int | None]
"""Units of a study, how many of them are left, and files that are not of it."""


def _sweep_counts(plan: Plan, store: Store) -> Counts:
    """How far a sweep is."""
    named = _unit_files(store)  # once: a run may write more meanwhile
    done = failed = there = 0
    for unit in plan.units():
        there += unit.id in named
        if unit.id in named and all(file.exists() for file in store.files(unit)):
            done += 1
        elif store.log(unit).exists():
            failed += 1
    return ({"units": plan.unit_count, "done": done, "failed": failed},
            plan.unit_count - done - failed, len(named) - there)


def _race_counts(store: Store, notes: Sequence[dict[str, Any]]) -> Counts | None:
    """How far a race is, which knows the units of its rung alone; None of a sweep."""
    found = read_race_note(store.logs)
    if found is None and not (store.logs / RACE_NOTE).exists():
        return None
    state = (race_state(found, bool(notes)) if found is not None
             else f"not known: logs/{RACE_NOTE} cannot be read")
    failed = sum(1 for _ in store.logs.glob("*.failed.log"))
    left = sum(note["total"] - note["past"] for note in notes) if notes else None
    return ({"race": state, "units": None, "done": len(_unit_files(store)),
             "failed": failed}, left, None)


def leaderboard(folders: Sequence[Path], out: Path | None, *, metric: str,
                by: str | None, as_json: bool, over: str | None = None) -> int:
    """Ranks a study from one directory or from several that hold parts of it.

    `over` chooses the interval that is printed; the file has both.
    """
    check_table(out, RANKED)
    plan, stores = open_sweep(folders)
    names = [name.strip() for name in by.split(",")] if by is not None else None
    board = make_leaderboard(plan, stores, metric, names)
    if out is not None:
        write_result(out, board.csv(), RANKED)
    _show(board, as_json, over)
    for line in damaged_notes(stores):
        note(line)
    return DONE


def sensitivity(
    folder: Path, *, episodes: int | None, workers: int, spec: Path | None, as_json: bool
) -> int:
    """Run what is left of the study (or of `spec`, one of its kind), write and print the table.

    `episodes` override those of the spec. Raises SpecError for a spec of another kind.
    """
    from sweeps.analysis.sensitivity import (
        EPISODES as EPISODES_PER_CELL,
    )
    from sweeps.analysis.sensitivity import (
        HEADER,
        check_study,
        sensitivity_spec,
        sensitivity_table,
    )

    store = Store(folder)
    store.refuse_other_files()
    settings = [] if episodes is None else [f"episodes_per_cell={episodes}"]
    with TemporaryDirectory() as place:  # nothing is written to a directory that is refused
        file = spec or Path(place) / "sensitivity.toml"
        content = sensitivity_spec(episodes=episodes or EPISODES_PER_CELL).encode()
        if spec is None:
            file.write_bytes(content)
        plan = plan_study(read_spec(file, settings))
    check_study(plan, file)
    store.refuse_other_study(plan)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if spec is None:
            file = folder / file.name
            write_atomic(file, content)
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror or error}") from None
    with redirect_stdout(io.StringIO()):  # a leaderboard of every setting would hide the table
        code = sweep(file, folder, workers=workers, shard=(1, 1), device="cpu", settings=settings,
                     as_json=False)
    rows, notes = sensitivity_table(plan, store)
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(csv_cell, row) for row in [HEADER, *rows])
    write_atomic(folder / "sensitivity.csv", text.getvalue().encode())
    table = [HEADER, ("---",) * len(HEADER), *rows]
    lines = ["<!-- written by `warpgrasp sensitivity`; do not edit -->", "",
             "# Each constant over its bracket", "",
             *("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
               for row in table), "", *(f"- {n}" for n in notes), ""]
    write_atomic(folder / "sensitivity.md", "\n".join(lines).encode())
    shown = [[cell.removeprefix("+") for cell in row] for row in rows] if as_json else rows
    print_table(HEADER, shown, as_json)  # JSON has no number with a plus
    for line in notes:
        note(line)
    return code


def _show(board: Leaderboard, as_json: bool, over: str | None = None) -> None:
    """Prints all of it as JSON, or some columns as text, where the interval of other objects is
    unknown that of these ones."""
    objects = board.header.index("n_objects")
    most = max((int(row[objects]) for row in board.rows), default=0)
    metric, kind = board.header[2], "these" if population(over, most) == "these" else "ci"
    ends = [board.header.index(f"{metric}_{kind}_{end}") for end in ("low", "high")]
    rest = [n for n, name in enumerate(board.header) if n > 2 and name in SHOWN]
    keep = range(len(board.header)) if as_json else [0, 1, 2, *ends, *rest]
    print_table([board.header[n] for n in keep], [[row[n] for n in keep] for row in board.rows],
                as_json)
    for line in board.notes:
        note(line)


def _unit_files(store: Store) -> set[str]:
    """Names of the files of units, without their ending."""
    return {file.stem for file in store.units.glob("*.parquet")}
