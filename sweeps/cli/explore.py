"""The command `explore`: one episode, and the strategy that an argument names."""

from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from sweeps.cli.app import UsageError, app, device_of

if TYPE_CHECKING:
    from strategies.strategy import Strategy
    from warpgrasp.parameters import ArmTable


@app.command
def explore(object_: Annotated[str, Parameter(name="OBJECT")], /, *, strategy: str | None = None,
            out: Annotated[Path, Parameter(name=["--out", "-o"])], units: str | None = None,
            seed: int = 0, yaw_deg: float | None = None, x_m: float = 0.45, y_m: float = 0.0,
            stable_pose: int | None = None, hand: str = "utah_mit", arm: str = "puma560",
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
        Of a mesh: m, cm, mm or in, or how long one unit of the file is, as "120 mm".
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
    hand
        A name (`warpgrasp hands`) or a TOML file.
    arm
        A name (`warpgrasp arms`), none for a floating wrist, or a TOML file.
    replay
        Also write replay.html: the episode played again in 3-D (needs the extra `show`).
    reconstruct
        What stands for the body at the end: superquadric; chosen, a free-form surface where the
        model does not explain the touches, or a polyhedron of the faces crossed or a bent
        superquadric where these explain them better; implicit, a free form wherever it is
        plausible; parts, several superquadrics where contacts ask for them; or a function of yours,
        as mine.py:my_network. If not given, chosen with any-object, which touches all around, else
        superquadric.
    device
        cpu, or cuda:0.
    """
    if not abs(yaw_deg or 0.0) <= 360:
        raise UsageError(f"--yaw-deg: is {yaw_deg:g}; should be a number from -360 to 360")
    _check_place("--x-m", x_m)
    _check_place("--y-m", y_m)
    if not 0 <= seed < 2**63:
        raise UsageError(f"--seed: is {seed}; should be a whole number from 0 to 2^63 - 1")
    device = device_of(device)
    if replay:
        from sweeps.report.replay import check_viser

        check_viser()
    from sweeps.report.picture_process import PictureProcess

    with PictureProcess() as pictures:  # imports what draws, beside all that follows
        written = _explored(
            object_, units, stable_pose, strategy, reconstruct, device, hand, arm,
            {"seed": seed, "yaw_rad": None if yaw_deg is None else radians(yaw_deg), "x_m": x_m,
             "y_m": y_m, "out": out, "device": device, "replay": replay, "pictures": pictures})
    for file in written:
        print(file)
    return 0


def _explored(object_: str, units: str | None, stable_pose: int | None, strategy: str | None,
              reconstruct: str | None, device: str, hand: str, arm: str,
              rest: dict[str, Any]) -> list[Path]:
    """Runs the episode with the arguments' objects, strategy, robot and word; files come back."""
    from sweeps.output import init_warp, note, quiet_stdout
    from sweeps.result_file import make_folder
    from sweeps.spec.errors import StoreError
    from sweeps.spec.objects import floating_notes, object_of_argument
    from sweeps.spec.study import Body

    with quiet_stdout():
        init_warp()
        from strategies.ready_made import DEFAULT

        chosen = strategy_of_argument(strategy or DEFAULT)
        table = object_of_argument(object_, units, stable_pose)
        if units is not None and "mesh" not in table:
            raise StoreError(f"--units: is of a mesh file; {object_} is none")
        for line in floating_notes([Body(table["name"], table)]):
            note(line)
        robot = _robot_of_arguments(hand, arm, chosen)
        _check_apart(robot["arm"], rest["x_m"], rest["y_m"])
        word = _reconstruct_of_argument(
            reconstruct or ("chosen" if chosen.name == DEFAULT else "superquadric"))
        from sweeps.cli.warmup import compile_explored
        from sweeps.report.episode_files import explore as explore_object

        out = rest["out"]
        make_folder(out)
        compile_explored(chosen, device, bends=word == "chosen", hand=robot["hand"].kind,
                         arm=robot["arm"].kind)
        try:
            return explore_object(body_table=table, strategy=chosen, reconstruct=word, **robot,
                                  **rest)
        except OSError as error:
            raise StoreError(f"{out}: cannot be written: {error.strerror or error}") from None


def strategy_of_argument(name: str) -> "Strategy":
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
        if ".py:" in name or not str(error).startswith("no strategy"):
            raise StoreError(f"--strategy: {error}") from None
        raise StoreError(f"--strategy: no strategy {name!r}; {choose(name, STRATEGIES)}; or a "
                         "function in a file, as mine.py:next_best") from None
    from strategies.strategy import Strategy

    return Strategy(name, call=name, touches=TOUCHES)


def _robot_of_arguments(hand: str, arm: str, strategy: "Strategy") -> dict[str, Any]:
    """The tables of a hand and an arm by their names or files, checked as a spec's are."""
    from warpgrasp.parameters import ArmTable, HandTable

    if (hand, arm) == (HandTable.kind, ArmTable.kind):
        return {"hand": HandTable(), "arm": ArmTable()}  # none of what checks need is imported
    from sweeps.spec.errors import Problems, StoreError
    from sweeps.spec.hands import misfit_of, read_hand
    from sweeps.spec.named_files import read_arm

    problems = Problems("", {})
    tables = {"hand": HandTable(kind=read_hand(hand, Path.cwd(), problems)),
              "arm": ArmTable(kind=read_arm(arm, Path.cwd(), problems))}
    if problems.found:
        first = problems.found[0]
        raise StoreError(f"--{first.key.partition('.')[0]}: {first.what}")
    if misfit := misfit_of(tables["hand"], strategy.closings):
        raise StoreError(f"--hand: {misfit}")
    return tables


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


def _check_apart(arm: "ArmTable", x_m: float, y_m: float) -> None:
    """Raises UsageError for a place where the arm stands."""
    from warpgrasp.arms.arm_column import in_column

    if wrong := in_column(arm.kind, x_m, y_m):
        raise UsageError(f"--x-m {x_m:g} --y-m {y_m:g}: {wrong}")
