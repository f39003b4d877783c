"""`warpgrasp explore`: apart from the studies' commands, whose imports it need not wait for."""

from math import radians
from pathlib import Path

from strategies.strategy import Strategy
from sweeps.output import quiet_stdout, start_warp
from sweeps.spec.errors import StoreError, choose
from sweeps.spec.objects import object_of_argument


def explore(what: str, strategy: str, folder: Path, *, units: str | None, seed: int,
            yaw_deg: float | None, x_m: float, y_m: float, device: str,
            replay: bool = False) -> int:
    """One episode with all that was felt, as files."""
    if replay:
        from sweeps.report.replay import check_viser

        check_viser()
    with quiet_stdout():
        start_warp()
        chosen = _strategy_of_argument(strategy)
        table = object_of_argument(what, units)
        from sweeps.report.episode_files import explore as explore_object

        try:
            folder.mkdir(parents=True, exist_ok=True)
            written = explore_object(
                body_table=table, strategy=chosen, seed=seed,
                yaw_rad=None if yaw_deg is None else radians(yaw_deg), x_m=x_m, y_m=y_m,
                out=folder, device=device, replay=replay)
        except OSError as error:
            raise StoreError(f"{folder}: cannot be written: {error.strerror or error}") from None
    for file in written:
        print(file)
    return 0


def _strategy_of_argument(name: str) -> Strategy:
    """A ready-made strategy by its name, or a planner of the user's, as `mine.py:next_best`."""
    from strategies.ready_made import STRATEGIES, TOUCHES

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
    return Strategy(name, call=name, touches=TOUCHES)
