"""The commands that measure: accuracy, sensitivity, speed, and the experiments of the paper."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sweeps.cli.app import Json, UsageError, app, count_of, device_of


@app.command
def validate(*, only: Annotated[list[str] | None, Parameter(negative="")] = None,
             out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
             hand: Annotated[list[str] | None, Parameter(negative="")] = None,
             poses: int | None = None, workers: int | None = None, json: Json = False) -> int:
    """Compare with MuJoCo, roboticstoolbox, trimesh and SciPy; print ours, theirs, difference.

    Parameters
    ----------
    only
        Only these checks: puma, arms, distances, pads, metrics, fits, free_forms, hands, closing.
    out
        Also write the table there, as CSV and Markdown.
    hand
        Hands that the check hands compares: names, or files my_hand.toml; those that ship if not
        given.
    poses
        Random hand poses of each body and closing path, for closing and hands; 24 if not given.
    workers
        Processes, for closing and hands; 2 if not given.
    json
        Print JSON.
    """
    from sweeps.validate.command import validate as run_validate

    for name, value, *checks in (("--poses", poses, "closing", "hands"),
                                 ("--workers", workers, "closing", "hands"),
                                 ("--hand", hand, "hands")):
        if value is not None and only and not set(checks) & set(only):
            raise UsageError(f"{name}: is for {' and '.join(checks)}, which --only leaves out")
    return run_validate(only or [], out, as_json=json, hands=hand or [],
                        poses=count_of(24 if poses is None else poses, "--poses"),
                        workers=count_of(2 if workers is None else workers, "--workers"))


@app.command
def paper(*, out: Annotated[Path, Parameter(name=["--out", "-o"])]) -> int:
    """Repeat the experiments of Allen and Michelman 1990 and compare with their results.

    Parameters
    ----------
    out
        The directory for the tables, figures and paper.md; the same bytes every time.
    """
    from sweeps.paper.command import paper as run_paper

    return run_paper(out)


@app.command
def sensitivity(*, out: Annotated[Path, Parameter(name=["--out", "-o"])],
                episodes: int | None = None, workers: int = 1, spec: Path | None = None,
                json: Json = False) -> int:
    """Vary each estimated constant over its bracket; print the effect on the ranking.

    Parameters
    ----------
    out
        The directory of the study; a second run continues where the first stopped.
    episodes
        Of each strategy on each object under each setting; 16, or the spec's, if not given.
    workers
        Cores to use, one process each.
    spec
        Another study of this kind: one zip axis, its first row the defaults, and every further row
        one constant changed.
    json
        Print the table as JSON.
    """
    from sweeps.cli.commands import sensitivity as run_sensitivity

    if episodes is not None:
        count_of(episodes, "--episodes")
    return run_sensitivity(out, episodes=episodes, workers=count_of(workers, "--workers"),
                           spec=spec, as_json=json)


@app.command
def bench(*, out: Annotated[Path, Parameter(name=["--out", "-o"])] = Path("runs/bench"),
          quick: Annotated[bool, Parameter(negative="")] = False,
          peers: Annotated[bool, Parameter(negative="")] = False,
          only: Annotated[list[str] | None, Parameter(negative="")] = None,
          device: str = "cpu") -> int:
    """Measure this machine: a JSON line for each row, bench.jsonl and bench.md.

    Parameters
    ----------
    out
        The directory to write to.
    quick
        Fewer rows, each run once.
    peers
        Beside MuJoCo, numba, JAX, scipy, scikit-learn and trimesh (the optional group `peers`).
    only
        Rows of this name alone (repeatable): closings, touches, metrics, fits, free_forms,
        episodes, study, start, and with --peers same_closing, mujoco_rollout, numba_closing,
        jax_closing, scipy_fits, sklearn_free_forms, mujoco_scipy_episode, trimesh_distances.
    device
        cpu, or cuda:0: what runs there, beside the same on all cores.
    """
    from sweeps.bench.command import bench as measure_all

    return measure_all(out, quick=quick, peers=peers, only=only or (), device=device_of(device))
