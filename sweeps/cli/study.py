"""The commands that run a study and rank it."""

from math import prod
from pathlib import Path
from shlex import quote
from typing import Annotated, Literal

from cyclopts import Parameter

from sweeps.cli.app import (
    Folders,
    Force,
    Json,
    Settings,
    UsageError,
    app,
    cores_of,
    device_of,
    port_of,
    refuse_existing,
    shard_of,
    timeout_of,
)


@app.command
def init(spec: Path, /, *, force: Force = False) -> int:
    """Write a commented template of a study.

    Parameters
    ----------
    spec
        The TOML file to write.
    force
        Overwrite an existing file.
    """
    from sweeps.output import note
    from sweeps.result_file import check_result, write_result
    from sweeps.spec.template import spec_template

    check_result(spec)
    refuse_existing(spec, force)
    write_result(spec, spec_template().encode())
    note(f"{spec}: written; `warpgrasp check {quote(str(spec))}` shows its size and cost")
    return 0


@app.command
def check(spec: Path, /, *, set_: Settings = None, pilot: Path | None = None,
          metric: str | None = None, json: Json = False) -> int:
    """Check a study; print its cells, episodes, disk and time, and what it can tell apart.

    Parameters
    ----------
    spec
        The study, a TOML file.
    set_
        KEY=V1,V2: as for sweep.
    pilot
        The directory of a sweep of a few episodes, of such entries on such objects: say which
        differences the study will tell apart.
    metric
        Of these differences; chamfer_mm if not given.
    json
        Print JSON.
    """
    from sweeps.run.estimate import estimate_cost
    from sweeps.run.false_contacts import false_contact_warnings
    from sweeps.run.plan import plan_study, same_bodies
    from sweeps.spec.objects import floating_notes
    from sweeps.spec.reader import read_spec
    from sweeps.spec.strategies import idle_grasp_notes
    from sweeps.text_table import json_record, print_json
    from warpgrasp.core.plain_text import on_one_line

    if metric is not None and pilot is None:
        raise UsageError("--metric: is of what a --pilot tells apart; name one")
    plan = plan_study(read_spec(spec, set_ or []))
    study = plan.study
    rows = {
        "study": study.head.name, "hash": plan.hash, "strategies": f"{len(study.strategies)}",
        "objects": f"{len(study.objects)}", "settings": study.settings_each,
    }
    if (search := study.search) is not None:  # of whose entries nothing is known yet
        cases = prod(len(axis.values) for axis in study.axes)
        most = search.trials * search.episodes * len(study.objects) * cases
        rows["search"] = (f"{search.trials} proposals, {search.round} at a time; at most {most:,} "
                          f"episodes, and those of the last race, of {search.finalists} finalists")
    else:
        rows |= {"cells": f"{study.cell_count}",
                 "episodes": f"{study.cell_count * study.head.episodes_per_cell}",
                 "units": f"{plan.unit_count}", **dict(estimate_cost(plan))}
    if warnings := [*false_contact_warnings(study), *same_bodies(study),
                    *floating_notes(study.objects), *idle_grasp_notes(study)]:
        rows["warning"] = "; ".join(warnings)
    if pilot is not None:
        from sweeps.race.power import power_row

        rows |= dict([power_row(plan, pilot, metric or "chamfer_mm")])
    if json:
        print_json(json_record(rows))
    else:
        width = max(map(len, rows))
        for name, value in rows.items():
            print(f"{name.ljust(width)}  {on_one_line(value)}")
    return 0


@app.command
def sweep(spec: Path, /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])],
          until: float | None = None, workers: int | None = None, shard: str = "1/1",
          device: str = "cpu", set_: Settings = None, engine: Literal["local", "ray"] = "local",
          address: str | None = None, unit_timeout_s: float = 3600.0,
          verify: Annotated[bool, Parameter(negative="")] = False,
          reuse: Annotated[list[Path] | None, Parameter(negative="")] = None,
          json: Json = False) -> int:
    """Run a study, or what is left of it, and print its leaderboard.

    Parameters
    ----------
    spec
        The study, a TOML file; `warpgrasp init` writes a template.
    out
        The directory of the study; a second run continues where the first stopped.
    until
        Millimetres of chamfer_mm: go on with more episodes of every entry until the best is known
        within so much (95 %); `race` answers the same with fewer, for it drops entries.
    workers
        Cores to use, one process each; 1 if not given.
    shard
        I/N: only every N-th unit, for several machines; `leaderboard` merges them.
    device
        cpu, or cuda:0.
    set_
        KEY=V1,V2: adds or replaces a grid axis; seed=, episodes_per_cell=, name= and keep= replace
        a value of the spec.
    engine
        local: worker processes here; ray: tasks on a Ray cluster (an optional extra).
    address
        Of the Ray cluster, or auto; without it Ray runs on this machine's cores.
    unit_timeout_s
        A unit of work (64 episodes, seconds) that takes longer than this many seconds is stopped
        and marked as failed; the rest continues.
    verify
        Read every row of the finished units first, not just the ends of their files.
    reuse
        The directory of another study: units that are the same there are taken over, not run again;
        more of them as in --reuse A --reuse B.
    json
        Print the leaderboard as JSON.
    """
    from sweeps.cli import commands

    cores = cores_of(workers, engine, address)
    if until is not None and not 0.0 < until < 1e9:
        raise UsageError(f"--until: is {until:g}; should be a number between 0 and 1e9")
    if until is not None and shard != "1/1":
        raise UsageError("--until: what comes next depends on all units, so it takes no --shard; "
                         "use --engine ray for several machines")
    if until is not None and reuse:
        raise UsageError("--until: takes no --reuse; sweep the spec with --reuse first")
    return commands.sweep(spec, out, workers=cores, shard=shard_of(shard),
                          device=device_of(device, here=engine == "local"),
                          settings=set_ or [], engine=engine,
                          address=address, unit_timeout_s=timeout_of(unit_timeout_s), verify=verify,
                          as_json=json, until=until, reuse=reuse or ())


@app.command
def race(spec: Path, /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])], within: float,
         confidence: float = 95.0, budget_episodes: int | None = None,
         budget_minutes: float | None = None, metric: str = "chamfer_mm",
         over: Literal["these", "like-these"] = "these", start: int = 8,
         cap: float | None = None, workers: int | None = None, device: str = "cpu",
         set_: Settings = None, engine: Literal["local", "ray"] = "local",
         address: str | None = None, unit_timeout_s: float = 3600.0,
         shard: str = "1/1", json: Json = False) -> int:
    """Find the best of many strategies or settings, with as few episodes as that takes.

    Parameters
    ----------
    spec
        The study, a TOML file, as for sweep; episodes_per_cell only counts for --over like-these.
    out
        The directory of the race; a second run continues where the first stopped.
    within
        The race goes on until the best is known within this much, in units of the metric.
    confidence
        In percent: how certain the outcome is to be, over all entries and looks together.
    budget_episodes
        Stop before more episodes than this have been taken, whatever is known by then.
    budget_minutes
        Begin no rung after so many minutes. (What was known then depends on the machine.)
    metric
        What is raced for.
    over
        these: the best on these objects; like-these: on others like them, an object a replicate.
    start
        Episodes on each object (or objects) in the first rung.
    cap
        A score above this counts as this much; the outcome then holds whatever the scores'
        distribution, and takes more episodes.
    workers
        Cores to use, one process each; 1 if not given.
    device
        cpu, or cuda:0.
    set_
        KEY=V1,V2: as for sweep.
    engine
        local: worker processes here; ray: tasks on a Ray cluster (an optional extra).
    address
        Of the Ray cluster, or auto.
    unit_timeout_s
        As for sweep.
    shard
        I/N: run the I-th share of N of every rung, in one directory with the others.
    json
        Print JSON.
    """
    from sweeps.race.command import race as run_race
    from sweeps.race.course import rules_of
    from sweeps.run.local_engine import Options
    from sweeps.run.worker import EPISODES

    cores = cores_of(workers, engine, address)
    for name, value, low, high in (
            ("--within", within, 0.0, 1e9),
            ("--budget-minutes", 1.0 if budget_minutes is None else budget_minutes, 0.0, 1e9),
            ("--cap", 1.0 if cap is None else cap, 0.0, 1e9)):
        if not low < value < high:
            raise UsageError(f"{name}: is {value:g}; should be a number between {low:g} and "
                             f"{high:g}")
    if not 50.0 <= confidence < 100.0:
        raise UsageError(f"--confidence: is {confidence:g}; should be in percent, from 50 to below "
                         "100, such as 95")
    if not 2 <= start <= 1_000_000:
        raise UsageError(f"--start: is {start}; should be a whole number from 2 to 1,000,000")
    if budget_episodes is not None and budget_episodes < 1:
        raise UsageError(f"--budget-episodes: is {budget_episodes}; should be a whole number "
                         "from 1 on")
    options = Options(cores, shard_of(shard),
                      device_of(device, here=engine == "local"), EPISODES,
                      timeout_of(unit_timeout_s))
    return run_race(spec, out, rules=rules_of(within, confidence, start, cap, metric),
                    episodes=budget_episodes, minutes=budget_minutes, metric=metric, over=over,
                    options=options, settings=set_ or [], as_json=json, engine=engine,
                    address=address)


@app.command
def watch(folder: Path, /, *, port: int | None = None, metric: str | None = None,
          terminal: Annotated[bool, Parameter(negative="")] = False,
          open_: Annotated[bool, Parameter(name="--open", negative="")] = False) -> int:
    """Watch a sweep or a race, also while it runs: a page on this machine, or text.

    Parameters
    ----------
    folder
        The directory of a sweep or a race; nothing is written there.
    port
        Of the page, on 127.0.0.1; by default a free one. Its address is printed.
    metric
        Of a sweep's leaderboard, chamfer_mm if not given; a race has its own.
    terminal
        Print it instead; on a terminal again and again until the run ends.
    open_
        Open the page in the browser of this machine.
    """
    if terminal and (port is not None or open_):
        raise UsageError(f"{'--open' if open_ else '--port'}: is of the page; leave it or "
                         "--terminal out")
    port = port_of(port or 0)
    from sweeps.watch.view import watched_metric

    shown = watched_metric(folder, metric)
    if terminal:
        from sweeps.watch.terminal import watch_in_terminal

        return watch_in_terminal(folder, metric=shown)
    from sweeps.watch.server import watch as serve

    return serve(folder, port=port, metric=shown, opens=open_)


@app.command
def status(folder: Path, /, *, json: Json = False) -> int:
    """Print how far a study is, also while it runs.

    Parameters
    ----------
    folder
        The directory of a study.
    json
        Print JSON.
    """
    from sweeps.cli import commands

    return commands.status(folder, as_json=json)


@app.command
def leaderboard(folders: Folders, /, *,
                out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
                metric: str = "chamfer_mm", by: str | None = None,
                over: Literal["like-these", "these"] | None = None, json: Json = False) -> int:
    """Rank a study's strategies, with intervals.

    Parameters
    ----------
    folders
        The directory of a study, or several that hold parts (shards) of one.
    out
        Also write the whole table, as CSV.
    metric
        What to rank by.
    by
        What defines an entry: strategy, object, swept keys, with commas between.
        Default: the strategy and the keys of [sweep.grid] and [sweep.zip].
    over
        The interval to print: like-these (of other objects like these, the default where there are
        several) or these (of these objects, with other episodes). CSV and JSON have both.
    json
        Print JSON.
    """
    from sweeps.cli import commands

    return commands.leaderboard(folders, out, metric=metric, by=by, as_json=json,
                                over=over)
