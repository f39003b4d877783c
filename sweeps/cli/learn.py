"""The command `learn`: models of objects, for recognition."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sweeps.cli.app import Force, UsageError, app, device_of, refuse_existing


@app.command
def learn(*what: Annotated[str, Parameter(name="OBJECT")],
          out: Annotated[Path, Parameter(name=["--out", "-o"])], units: str | None = None,
          strategy: Annotated[list[str] | None, Parameter(negative="")] = None,
          episodes: int = 16, seed: int = 9001, unlisted: int = 0, extend: Path | None = None,
          only: Annotated[bool, Parameter(negative="")] = False, force: Force = False,
          device: str = "cpu") -> int:
    """Learn models of objects by touch, for recognition: `[recognition] models` in a spec.

    Parameters
    ----------
    what
        Names (`warpgrasp objects`), `catalogue` for all of them, or mesh files, then with units.
    out
        The file of models to write.
    units
        Of meshes: m, cm, mm or in, or how long one unit of a file is, as "120 mm".
    strategy
        Strategies that feel them, each given once more: `--strategy ring18 --strategy planar`; by
        default seven, of grasps, faces and contours.
    episodes
        Of each object under each strategy.
    seed
        Names every random number; a study should have another one.
    unlisted
        Learn everything anew, with so many random objects for "none of these", two episodes each.
    extend
        Add the objects to the models of this file; by default to those that ship.
    only
        Leave out the other objects of that file.
    force
        Overwrite an existing file; that of --extend may be extended in place.
    device
        cpu, or cuda:0.
    """
    if not what:
        raise UsageError("OBJECT: is missing; name at least one")
    if not 0 <= seed < 2**63:
        raise UsageError(f"--seed: is {seed}; should be a whole number from 0 to 2^63 - 1")
    for name, value, low, high in (("--episodes", episodes, 4, 4096),
                                   ("--unlisted", unlisted, 0, 4096)):
        if not low <= value <= high:
            raise UsageError(f"{name}: is {value}; should be a whole number from {low} to {high}")
    if unlisted and (extend is not None or only):
        raise UsageError("--unlisted: learns everything anew; leave out --extend and --only")
    from sweeps.result_file import check_result

    check_result(out)
    if extend is None or out.resolve() != extend.resolve():
        refuse_existing(out, force)
    from sweeps.cli.explore import strategy_of_argument
    from sweeps.cli.tools.learn_objects import learn_objects
    from sweeps.episode.teaching import TEACHERS

    chosen = [strategy_of_argument(name) for name in strategy or TEACHERS]
    if unlisted and not any(one.call or {"contour", "decide"} & set(one.order) for one in chosen):
        raise UsageError("--unlisted: learns everything anew, also what contours tell; name a "
                         "strategy that follows them, too, as in --strategy contour")
    return learn_objects(what, out, units=units, strategies=chosen, episodes=episodes, seed=seed,
                         unlisted=unlisted, extend=extend, only=only, device=device_of(device))
