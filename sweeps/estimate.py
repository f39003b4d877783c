"""What a study will cost, before it is run: disk and time, as estimates that say so."""

from sweeps.plan import BLOCK, Plan

UNIT_BYTES = 24_000  # a full unit file of 64 episodes, measured
EPISODES_PER_CORE_S = 12.0  # ready-made strategies on the paper's objects, measured on one core


def estimate_cost(plan: Plan) -> list[tuple[str, str]]:
    """Rows of `warpgrasp check`: disk and time."""
    episodes = plan.study.cell_count * plan.study.head.episodes_per_cell
    disk = plan.unit_count * UNIT_BYTES * min(1.0, plan.study.head.episodes_per_cell / BLOCK)
    return [("disk", f"about {disk / 1e6:.1f} MB (estimate)"),
            ("time", f"about {_time(episodes / EPISODES_PER_CORE_S)} on one core (estimate)")]


def _time(seconds: float) -> str:
    for size, unit in ((86400, "days"), (3600, "hours"), (60, "minutes")):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} seconds"
