"""The command line. Commands import what they need when they run, so that help answers at once."""

import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter

app = App(name="warpgrasp", help="Batched simulation of robots that learn shape by touch. "
          "Every command takes --quiet: no progress and no notes.",
          version_flags=["--version"], help_format="plaintext",
          suppress_keyboard_interrupt=False)

Json = Annotated[bool, Parameter(negative="")]
Settings = Annotated[list[str] | None, Parameter(name="--set", negative="")]


class UsageError(ValueError):
    """An argument that cannot be used."""


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
    from sweeps import commands

    if address is not None and engine != "ray":
        raise UsageError("--address: is for --engine ray")
    return commands.sweep(spec, out, workers=_count(workers, "--workers"), shard=_shard(shard),
                          device=_device(device), settings=set_ or [], engine=engine,
                          address=address, unit_timeout_s=_timeout(unit_timeout_s), verify=verify,
                          as_json=json)


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
    from sweeps import previews

    return previews.check(spec, settings=set_ or [], as_json=json)


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
    from sweeps import commands

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
    from sweeps import commands

    return commands.leaderboard(folders, out, metric=metric, by=by, as_json=json)


@app.command
def table(words: list[str], /, *,
          out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
          metric: str = "chamfer_mm", against: str | None = None, json: Json = False) -> int:
    """Print what else a study tells: pairs, objects, curves, reach, same-time, pareto and more.

    Parameters
    ----------
    words
        DIR... KIND: the directories of a study, then one of pairs (paired tests), objects
        (medians on each), confusion (recognition), curves (error against touches and robot
        time), reach (touches and seconds to 5 mm and 3 mm), same-time (errors when the
        strategy of --against ended), pareto (error against robot time), settings (what each
        swept factor does).
    out
        Also write it, as CSV.
    metric
        Of pairs, objects, pareto and settings.
    against
        For pairs and same-time: compare with one strategy only; best is the leaderboard's first.
    json
        Print JSON.
    """
    from sweeps import tables

    folders, kind = _folders_and_kind(words, tables.KINDS)
    return tables.table(folders, kind, out, metric=metric, against=against, as_json=json)


@app.command
def figure(words: list[str], /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])],
           metric: str = "chamfer_mm", strategy: str | None = None,
           object_: Annotated[str | None, Parameter(name="--object")] = None,
           episode: int = 0) -> int:
    """Draw a figure of a study, one column wide: SVG, PDF or PNG.

    Parameters
    ----------
    words
        DIR... KIND: the directories of a study, then one of forest (the leaderboard),
        curves-touches, curves-time (error as it falls), pareto (error and robot time),
        confusion (recognition), settings (swept factors), contacts (one episode, run again).
    out
        The file; its ending, .svg, .pdf or .png, names the format.
    metric
        Of forest, pareto and settings.
    strategy
        For confusion and contacts; by default the best.
    object_
        For contacts; by default the first.
    episode
        For contacts: which episode of that strategy and object.
    """
    from sweeps import figures

    folders, kind = _folders_and_kind(words, figures.KINDS)
    return figures.figure(folders, kind, out, metric=metric, strategy=strategy, object_=object_,
                          episode=episode)


@app.command
def report(folders: list[Path], /, *, out: Annotated[Path, Parameter(name=["--out", "-o"])],
           views: bool = True, workers: int = 1, device: str = "cpu") -> int:
    """Write a study as one HTML file that needs no network.

    Parameters
    ----------
    folders
        The directory of a study, or several that hold parts (shards) of one.
    out
        The HTML file.
    views
        Run the best, median and worst episode of each strategy again, for their 3-D views.
    workers
        Cores to use for that, one process each.
    device
        cpu, or cuda:0.
    """
    from sweeps import report

    return report.report(folders, out, views=views, device=_device(device),
                         workers=_count(workers, "--workers"))


@app.command
def show(folders: list[Path], /, *, episode: int = 0, strategy: str | None = None,
         object_: Annotated[str | None, Parameter(name="--object")] = None,
         out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
         live: Annotated[bool, Parameter(negative="")] = False, port: int = 8080,
         device: str = "cpu") -> int:
    """Play an episode again: arm, hand, object, contacts, and the shape believed.

    Parameters
    ----------
    folders
        The directory of a study, or several that hold parts (shards) of one.
    episode
        Which episode of the strategy and object, from 0.
    strategy
        Whose; by default the leaderboard's first.
    object_
        On what; by default the study's first.
    out
        An HTML file to write, which needs no network.
    live
        Serve it on this machine alone (127.0.0.1) until Ctrl-C.
    port
        For --live.
    device
        cpu, or cuda:0.
    """
    from sweeps import replay

    if out is None and not live:
        raise UsageError("show: wants -o FILE.html, or --live")
    return replay.show(folders, out, strategy=strategy, body=object_, episode=episode,
                       live=live, port=port, device=_device(device))


@app.command
def explore(object_: str, /, *, strategy: str,
            out: Annotated[Path, Parameter(name=["--out", "-o"])], units: str | None = None,
            seed: int = 0, yaw_deg: float | None = None, x_m: float = 0.45, y_m: float = 0.0,
            replay: Annotated[bool, Parameter(negative="")] = False,
            device: str = "cpu") -> int:
    """Run one episode and write all that was felt: contacts, shape, a figure.

    Parameters
    ----------
    object_
        A name (`warpgrasp objects`) or a mesh file, then with its units.
    strategy
        A name (`warpgrasp strategies`).
    out
        The directory to write to.
    units
        Of a mesh: m, cm or mm.
    seed
        Names every random number of the episode.
    yaw_deg
        How the object is turned; at random if not given.
    x_m
        Where it stands, ahead of the robot's base.
    y_m
        Where it stands, to the left of the robot's base.
    replay
        Also write replay.html: the episode played again in 3-D (needs the extra `show`).
    device
        cpu, or cuda:0.
    """
    from sweeps import commands

    for name, value in (("--yaw-deg", yaw_deg or 0.0), ("--x-m", x_m), ("--y-m", y_m)):
        if not abs(value) < 1e6:
            raise UsageError(f"{name}: is {value}; should be a finite number")
    if not 0 <= seed < 2**63:
        raise UsageError(f"--seed: is {seed}; should be a whole number from 0 to 2^63 - 1")
    return commands.explore(object_, strategy, out, units=units, seed=seed, yaw_deg=yaw_deg,
                            x_m=x_m, y_m=y_m, device=_device(device),
                            replay=replay)


@app.command
def fit(shape: Literal["superquadric", "plane", "revolution"], points: Path, /, *,
        out: Annotated[Path, Parameter(name=["--out", "-o"])],
        taper: Annotated[bool, Parameter(negative="")] = False,
        bend: Annotated[bool, Parameter(negative="")] = False,
        robust: Annotated[bool, Parameter(negative="")] = False, table_z: float | None = None,
        figure: Path | None = None) -> int:
    """Fit shapes to sets of touched points of your own.

    Parameters
    ----------
    shape
        superquadric, plane or revolution.
    points
        A CSV with columns x_m, y_m, z_m; set where there are several; nx, ny, nz where felt.
    out
        The CSV to write, a row a set; contours of revolutions go to OUT.profile.csv.
    taper
        Superquadric: let it taper along z, 13 parameters instead of 11.
    bend
        Superquadric: let it bend, two parameters more.
    robust
        Superquadric: bear touches that are wrong (the other shapes always do).
    table_z
        Height of the table the body stands on, in metres.
    figure
        Also draw the sets, as .png, .svg or .pdf.
    """
    from sweeps import fit_command

    return fit_command.fit(shape, points, out, taper=taper, bend=bend, robust=robust,
                           table_z_m=table_z, figure=figure)


@app.command
def objects(*, json: Json = False) -> int:
    """List the objects there are.

    Parameters
    ----------
    json
        Print JSON.
    """
    from sweeps import previews

    return previews.objects(as_json=json)


@app.command
def strategies(*, json: Json = False) -> int:
    """List the ready-made strategies.

    Parameters
    ----------
    json
        Print JSON.
    """
    from sweeps import previews

    return previews.strategies(as_json=json)


@app.command(name="export")
def export_(file: Path, /, *, arm: Annotated[bool, Parameter(negative="")] = False,
            object_: Annotated[str | None, Parameter(name="--object")] = None,
            units: str | None = None) -> int:
    """Write the hand as MJCF or URDF, from the tables the simulator uses.

    Parameters
    ----------
    file
        Ends in .xml for MJCF (MuJoCo), in .urdf for URDF.
    arm
        The whole robot: PUMA 560 with the hand, 22 joints.
    object_
        Put this object before it: a name (`warpgrasp objects`) or a mesh file, then with its units.
    units
        Of a mesh: m, cm or mm.
    """
    from sweeps.export import export

    return export(file, arm=arm, what=object_, units=units)


@app.command
def validate(*, only: Annotated[list[str] | None, Parameter(negative="")] = None,
             out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None, poses: int = 24,
             workers: int = 2, json: Json = False) -> int:
    """Compare with MuJoCo, roboticstoolbox, trimesh and SciPy; print ours, theirs, difference.

    Parameters
    ----------
    only
        Only these checks: puma, distances, pads, metrics, fits, closing.
    out
        Also write the table there, as CSV and Markdown.
    poses
        Random hand poses of each body and closing path, for closing.
    workers
        Processes, for closing.
    json
        Print JSON.
    """
    from sweeps.validate import validate as run_validate

    return run_validate(only or [], out, poses=_count(poses, "--poses"),
                        workers=_count(workers, "--workers"), as_json=json)


@app.command
def paper(*, out: Annotated[Path, Parameter(name=["--out", "-o"])]) -> int:
    """Run the experiments of Allen and Michelman 1990 beside what they printed.

    Parameters
    ----------
    out
        The directory for the tables, figures and paper.md; the same bytes every time.
    """
    from sweeps.paper import paper as run_paper

    return run_paper(out)


@app.command
def sensitivity(*, out: Annotated[Path, Parameter(name=["--out", "-o"])], episodes: int = 16,
                workers: int = 1, spec: Path | None = None, json: Json = False) -> int:
    """Vary each estimated constant over its bracket; print what becomes of the ranking.

    Parameters
    ----------
    out
        The directory of the study; running again goes on where it stopped.
    episodes
        Of each strategy on each object under each setting.
    workers
        Cores to use, one process each.
    spec
        Another study of this kind: one zip axis, its first row the defaults.
    json
        Print the table as JSON.
    """
    from sweeps.sensitivity_command import sensitivity as run_sensitivity

    return run_sensitivity(out, episodes=_count(episodes, "--episodes"),
                           workers=_count(workers, "--workers"), spec=spec, as_json=json)


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
    from sweeps import previews

    return previews.init(spec, force=force)


@app.command
def doctor(*, test: bool = True, json: Json = False) -> int:
    """Say what is installed, where caches are, and whether it computes; 1 if something is wrong.

    Parameters
    ----------
    test
        Also compute a distance and a fit (seconds; the first time compiles).
    json
        Print JSON.
    """
    from sweeps.doctor import doctor as examine

    return examine(as_json=json, test=test)


@app.command
def completion(shell: Literal["bash", "zsh"], /) -> int:
    """Print a script that completes commands and options: source <(warpgrasp completion bash).

    Parameters
    ----------
    shell
        bash or zsh.
    """
    from sweeps.completion import completion as script

    print(script(shell), end="")
    return 0


@app.command
def warmup(*, device: str = "cpu") -> int:
    """Compile the kernels and the programs of the fits into the caches, once for a version.

    Parameters
    ----------
    device
        cpu, or cuda:0.
    """
    from sweeps.warmup import warmup as compile_all

    return compile_all(_device(device))


@app.command
def bench(*, out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("runs/bench"),
          quick: Annotated[bool, Parameter(negative="")] = False,
          peers: Annotated[bool, Parameter(negative="")] = False,
          only: list[str] | None = None) -> int:
    """Measure this machine: a JSON line for each row, bench.jsonl and bench.md.

    Parameters
    ----------
    out
        The directory to write to.
    quick
        Fewer rows, each run once.
    peers
        Beside MuJoCo, numba, JAX, scipy and trimesh (the optional group `peers`).
    only
        Rows of this name alone (repeatable): closings, touches, metrics, fits, episodes, start.
    """
    from sweeps.bench import bench as measure_all

    return measure_all(out, quick=quick, peers=peers, only=only or ())


def main(arguments: list[str] | None = None) -> None:
    """The entry point: runs a command and exits with its code."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: list[str]) -> int:
    """Runs a command; the exit code comes back, user errors are one message on stderr."""
    if "--quiet" in arguments:
        from sweeps.quiet import ask_quiet

        ask_quiet()
        arguments = [argument for argument in arguments if argument != "--quiet"]
    try:
        code = app(arguments or ["--help"], exit_on_error=False, print_error=False,
                   result_action="return_value")
    except CycloptsError as error:
        return _refuse(f"warpgrasp: {error}; see warpgrasp --help")
    except UsageError as error:
        return _refuse(f"warpgrasp: {error}")
    except KeyboardInterrupt:
        print("interrupted; what was finished is kept", file=sys.stderr)
        return 130
    except BrokenPipeError:
        return 0
    except Exception as error:
        return _explain(error)
    return code if isinstance(code, int) else 0


def _explain(error: Exception) -> int:
    """A user error as a message and its exit code; anything else is a defect and raised on."""
    from sweeps.problems import SpecError
    from sweeps.store import OtherStudy, StoreError

    if isinstance(error, SpecError):
        return _refuse(str(error))
    if isinstance(error, OtherStudy):
        return _refuse(str(error), 3)
    if isinstance(error, StoreError):
        return _refuse(str(error), error.exit_code)
    if isinstance(error, OSError):
        return _refuse(f"{error.filename or 'warpgrasp'}: {error.strerror or error}", 1)
    if type(error).__name__ in ("LeaderboardError", "ObjectError", "BodyError", "WaypointError",
                                "PointsError"):
        return _refuse(str(error))
    raise error


def _refuse(text: str, code: int = 2) -> int:
    print(text, file=sys.stderr)
    return code


def _folders_and_kind(words: list[str], kinds: Iterable[str]) -> tuple[list[Path], str]:
    from sweeps.problems import choose

    if words[-1] not in kinds:
        raise UsageError(f"KIND: is {words[-1]!r}; {choose(words[-1], kinds)}")
    if len(words) < 2:
        raise UsageError("DIR: is missing; name the directory of a study before the kind")
    return [Path(word) for word in words[:-1]], words[-1]


def _count(value: int, name: str) -> int:
    if not 1 <= value <= 4096:
        raise UsageError(f"{name}: is {value}; should be a whole number from 1 to 4096")
    return value


def _timeout(value: float) -> float:
    if not 1 <= value <= 1e9:
        raise UsageError(f"--unit-timeout-s: is {value:g}; should be a number from 1 to 1e9")
    return value


def _shard(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise UsageError(f"--shard: is {text!r}; should be I/N with I from 1 to N, such as 2/8")
    return int(match[1]), int(match[2])


def _device(text: str) -> str:
    if not re.fullmatch(r"cpu|cuda(:\d{1,2})?", text):
        raise UsageError(f"--device: is {text!r}; should be cpu or cuda:0")
    return "cuda:0" if text == "cuda" else text


if __name__ == "__main__":
    main()
