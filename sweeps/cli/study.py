"""The commands that run a study and rank it."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sweeps.cli.app import (
    Json,
    Settings,
    UsageError,
    app,
    count_of,
    device_of,
    shard_of,
    timeout_of,
)


@app.command
def init(spec: Path, /, *, force: Annotated[bool, Parameter(negative="")] = False) -> int:
    """Write a commented template of a study.

    Parameters
    ----------
    spec
        The TOML file to write.
    force
        Write over a file that is there.
    """
    from sweeps.cli import previews

    return previews.init(spec, force=force)


@app.command
def check(spec: Path, /, *, set_: Settings = None, json: Json = False) -> int:
    """Check a study; print its cells, episodes, disk and time.

    Parameters
    ----------
    spec
        The study, a TOML file.
    set_
        KEY=V1,V2: as for sweep.
    json
        Print JSON.
    """
    from sweeps.cli import previews

    return previews.check(spec, settings=set_ or [], as_json=json)


@app.command
def sweep(spec: Path, /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])],
          workers: int = 1, shard: str = "1/1", device: str = "cpu", set_: Settings = None,
          engine: Literal["local", "ray"] = "local", address: str | None = None,
          unit_timeout_s: float = 3600.0, verify: Annotated[bool, Parameter(negative="")] = False,
          json: Json = False) -> int:
    """Run a study, or what is left of it, and print its leaderboard.

    Parameters
    ----------
    spec
        The study, a TOML file; `warpgrasp init` writes a template.
    out
        The directory of the study; running again goes on where it stopped.
    workers
        Cores to use, one process each.
    shard
        I/N: only every N-th unit, for several machines; `leaderboard` merges them.
    device
        cpu, or cuda:0.
    set_
        KEY=V1,V2: adds or replaces a grid axis; seed=, episodes_per_cell= replace a value.
    engine
        local: worker processes here; ray: tasks on a Ray cluster (an optional extra).
    address
        Of the Ray cluster, or auto; without it Ray runs on this machine's cores.
    unit_timeout_s
        A unit of work (64 episodes, seconds) that takes longer than this many seconds is stopped
        and set aside as failed; the rest goes on.
    verify
        Read every row of the finished units first, not just the ends of their files.
    json
        Print the leaderboard as JSON.
    """
    from sweeps.cli import commands

    if address is not None and engine != "ray":
        raise UsageError("--address: is for --engine ray")
    return commands.sweep(spec, out, workers=count_of(workers, "--workers"), shard=shard_of(shard),
                          device=device_of(device), settings=set_ or [], engine=engine,
                          address=address, unit_timeout_s=timeout_of(unit_timeout_s), verify=verify,
                          as_json=json)


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
def leaderboard(folders: list[Path], /, *,
                out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
                metric: str = "chamfer_mm", by: str | None = None, json: Json = False) -> int:
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
        What tells entries apart: strategy, object, swept keys, with commas between.
        Default: the strategy and the keys of [sweep.grid] and [sweep.zip].
    json
        Print JSON.
    """
    from sweeps.cli import commands

    return commands.leaderboard(folders, out, metric=metric, by=by, as_json=json)
