"""The commands that need no study: one episode, a fit of points, lists, the robot as a file."""

from math import hypot, radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from sweeps.cli.app import Json, UsageError, app, device_of

if TYPE_CHECKING:
    from strategies.strategy import Strategy


@app.command
def explore(object_: Annotated[str, Parameter(name="OBJECT")], /, *, strategy: str | None = None,
            out: Annotated[Path, Parameter(name=["--out", "-o"])], units: str | None = None,
            seed: int = 0, yaw_deg: float | None = None, x_m: float = 0.45, y_m: float = 0.0,
            stable_pose: int | None = None,
            replay: Annotated[bool, Parameter(negative="")] = False,
            reconstruct: str | None = None, device: str = "cpu") -> int:
    """Run one episode and write its contacts, the recovered shape and a figure.

    Parameters
    ----------
    object_
        A name (`warpgrasp objects`) or a mesh file, then with its units.
    strategy
        A name (`warpgrasp strategies`), or a planner of yours, as mine.py:next_best (with 96
        touches); any-object, for objects of any shape, if none is given.
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
    stable_pose
        How it lies: the number of a stable pose, 1 the likeliest; as it is made if not given.
    replay
        Also write replay.html: the episode played again in 3-D (needs the extra `show`).
    reconstruct
        What stands for the body at the end: superquadric; chosen, a free-form surface where the
        model does not explain the touches, or a polyhedron of the faces crossed where it explains
        them better; implicit, a free form wherever it is plausible; parts, several superquadrics
        where contacts ask for them; or a function of yours, as mine.py:my_network. If not given,
        chosen with any-object, which touches all around, else superquadric.
    device
        cpu, or cuda:0.
    """
    if not abs(yaw_deg or 0.0) < 1e6:
        raise UsageError(f"--yaw-deg: is {yaw_deg}; should be a finite number")
    _check_place("--x-m", x_m)
    _check_place("--y-m", y_m)
    _check_apart(x_m, y_m)
    if not 0 <= seed < 2**63:
        raise UsageError(f"--seed: is {seed}; should be a whole number from 0 to 2^63 - 1")
    device = device_of(device)
    if replay:
        from sweeps.report.replay import check_viser

        check_viser()
    from sweeps.report.picture_process import PictureProcess

    with PictureProcess() as pictures:  # imports what draws, beside all that follows
        written = _explored(
            object_, units, stable_pose, strategy, reconstruct, device,
            {"seed": seed, "yaw_rad": None if yaw_deg is None else radians(yaw_deg), "x_m": x_m,
             "y_m": y_m, "out": out, "device": device, "replay": replay, "pictures": pictures})
    for file in written:
        print(file)
    return 0


def _explored(object_: str, units: str | None, stable_pose: int | None, strategy: str | None,
              reconstruct: str | None, device: str, rest: dict[str, Any]) -> list[Path]:
    """Runs the episode with the arguments' objects, strategy and word; files come back."""
    from sweeps.output import init_warp, quiet_stdout
    from sweeps.spec.errors import StoreError
    from sweeps.spec.objects import object_of_argument

    with quiet_stdout():
        init_warp()
        from strategies.ready_made import DEFAULT

        chosen = _strategy_of_argument(strategy or DEFAULT)
        table = object_of_argument(object_, units, stable_pose)
        if units is not None and "mesh" not in table:
            raise StoreError(f"--units: is of a mesh file; {object_} is none")
        word = _reconstruct_of_argument(
            reconstruct or ("chosen" if chosen.name == DEFAULT else "superquadric"))
        from sweeps.cli.warmup import compile_explored
        from sweeps.report.episode_files import explore as explore_object

        compile_explored(chosen, device, bends=word == "chosen")
        out = rest["out"]
        try:
            out.mkdir(parents=True, exist_ok=True)
            return explore_object(body_table=table, strategy=chosen, reconstruct=word, **rest)
        except OSError as error:
            raise StoreError(f"{out}: cannot be written: {error.strerror or error}") from None


def _strategy_of_argument(name: str) -> "Strategy":
    """A ready-made strategy by its name, or a planner of the user's, as `mine.py:next_best`."""
    from strategies.ready_made import STRATEGIES, TOUCHES
    from sweeps.spec.errors import StoreError, choose

    if name in STRATEGIES:
        return STRATEGIES[name]
    from strategies.planners.planner_file import PlannerError
    from strategies.planners.registry import make_planner

    try:
        make_planner(name, {})
    except PlannerError as error:
        if ".py:" in name:
            raise StoreError(f"--strategy: {error}") from None
        raise StoreError(f"--strategy: no strategy {name!r}; {choose(name, STRATEGIES)}; or a "
                         "function in a file, as mine.py:next_best") from None
    from strategies.strategy import Strategy

    return Strategy(name, call=name, touches=TOUCHES)


def _reconstruct_of_argument(value: str) -> str:
    """A word of `[fit] reconstruct`, checked as a spec's is."""
    from strategies.reconstruct.plug_in_name import BUILT_IN

    if value in BUILT_IN:
        return value
    from sweeps.spec.errors import Problems, StoreError
    from sweeps.spec.named_files import read_reconstruct

    problems = Problems("", {})
    word = read_reconstruct(value, Path.cwd(), problems)
    if problems.found:
        raise StoreError(f"--reconstruct: {problems.found[0].what}")
    return word


def _check_place(name: str, value: float) -> None:
    """Raises UsageError for a place that a spec does not allow either."""
    from warpgrasp.parameters import OBJECT_REACH_M as far

    if not abs(value) <= far:
        guess = f"; did you mean {value / 1e3:g}?" if 10 <= abs(value) <= 1e3 * far else ""
        raise UsageError(f"{name}: is {value:g}; should be metres from {-far:g} to {far:g}{guess}")


def _check_apart(x_m: float, y_m: float) -> None:
    """Raises UsageError for a place where the arm stands."""
    from warpgrasp.parameters import ARM_COLUMN_M

    if hypot(x_m, y_m) < ARM_COLUMN_M:
        raise UsageError(f"--x-m: {x_m:g} with --y-m {y_m:g} is where the arm itself stands; "
                         f"should be {ARM_COLUMN_M:g} or more from there")


@app.command
def fit(shape: Literal["superquadric", "plane", "revolution"], points: Path, /, *,
        out: Annotated[Path, Parameter(name=["--out", "-o"])],
        taper: Annotated[bool, Parameter(negative="")] = False,
        bend: Annotated[bool, Parameter(negative="")] = False,
        robust: Annotated[bool, Parameter(negative="")] = False, table_z: float | None = None,
        normal_deg: float | None = None,
        units: Literal["m", "cm", "mm"] | None = None, figure: Path | None = None) -> int:
    """Fit shapes to sets of touched points of your own.

    Parameters
    ----------
    shape
        superquadric, plane or revolution.
    points
        A CSV with columns x_m, y_m, z_m (or x_cm, x_mm and so on); set where there are several;
        nx, ny, nz, pointing out of the body, where felt.
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
    normal_deg
        Superquadric: by how many degrees nx, ny, nz err (one standard deviation); 2.9 if not given.
    units
        Of the points, whose columns may then be x, y, z; by default by the columns' names: x_m,
        x_cm or x_mm.
    figure
        Also draw the sets, as .png, .svg or .pdf.
    """
    from sweeps.cli import fit as fit_command

    return fit_command.fit(shape, points, out, taper=taper, bend=bend, robust=robust,
                           table_z_m=table_z, normal_deg=normal_deg, figure=figure,
                           units=units)


@app.command
def learn(*what: Annotated[str, Parameter(name="OBJECT")],
          out: Annotated[Path, Parameter(name=["--out", "-o"])], units: str | None = None,
          strategy: Annotated[list[str] | None, Parameter(negative="")] = None,
          episodes: int = 16, seed: int = 9001, unlisted: int = 0, extend: Path | None = None,
          only: Annotated[bool, Parameter(negative="")] = False, device: str = "cpu") -> int:
    """Learn models of objects by touch, for recognition: `[recognition] models` in a spec.

    Parameters
    ----------
    what
        Names (`warpgrasp objects`), `catalogue` for all of them, or mesh files, then with units.
    out
        The file of models to write.
    units
        Of meshes: m, cm or mm.
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
    from sweeps.cli import learn as learn_command
    from sweeps.episode.teaching import TEACHERS

    chosen = [_strategy_of_argument(name) for name in strategy or TEACHERS]
    if unlisted and not any(one.call or {"contour", "decide"} & set(one.order) for one in chosen):
        raise UsageError("--unlisted: learns everything anew, also what contours tell; name a "
                         "strategy that follows them, too, as in --strategy contour")
    return learn_command.learn(what, out, units=units, strategies=chosen, episodes=episodes,
                               seed=seed, unlisted=unlisted, extend=extend, only=only,
                               device=device_of(device))


@app.command
def objects(*, json: Json = False) -> int:
    """List the objects of the catalogue.

    Parameters
    ----------
    json
        Print JSON.
    """
    from sweeps.text_table import print_table
    from warpgrasp.objects.catalogue_names import BODY_NAMES, FAMILY_NAMES, MOST_SEED

    families = [(f"{name}-SEED", f"{what}; SEED from 0 to {MOST_SEED}, see docs/objects.md [est]")
                for name, what in FAMILY_NAMES.items()]
    print_table(("object", "what"), [*BODY_NAMES.items(), *families], json)
    return 0


@app.command
def strategies(*, json: Json = False) -> int:
    """List the ready-made strategies.

    Parameters
    ----------
    json
        Print JSON.
    """
    from strategies.ready_made import STRATEGIES
    from sweeps.text_table import print_table

    print_table(("strategy", "what"), [(s.name, s.doc) for s in STRATEGIES.values()], json)
    return 0


@app.command(name="export")
def export_(file: Path, /, *, arm: Annotated[bool, Parameter(negative="")] = False,
            on: str | None = None,
            object_: Annotated[str | None, Parameter(name="--object")] = None,
            units: str | None = None, hand: str = "utah_mit") -> int:
    """Write a hand as MJCF or URDF, from the numbers the simulator uses.

    Parameters
    ----------
    file
        Ends in .xml for MJCF (MuJoCo), in .urdf for URDF.
    arm
        The whole robot: the arm with the hand; the PUMA 560 unless `--on` names another.
    on
        The arm that carries the hand: a name (`warpgrasp arms`) or a TOML file.
    object_
        Put this object before it: a name (`warpgrasp objects`) or a mesh file, then with its units.
    units
        Of a mesh: m, cm or mm.
    hand
        A name (`warpgrasp hands`) or a TOML file that `warpgrasp hand` wrote.
    """
    from sweeps.cli.export import export
    from warpgrasp.parameters import FLOATING, PUMA560

    if on == FLOATING:
        raise UsageError("--on: a floating wrist has no links; should be an arm")
    if units is not None and object_ is None:
        raise UsageError("--units: says how large a mesh is; should stand beside --object")
    return export(file, arm=on or (PUMA560 if arm else None), what=object_, units=units, hand=hand)
