"""A strategy: where the hand goes, how it closes, which procedures in which order, how far.

Either given in advance (`order` over `waypoints`), or a planner that decides as it goes: `call`
names a registered one, or one in a user's file. `planners.from_strategy` makes both into what
`strategies.exploration` asks for the next probes.
"""

from dataclasses import dataclass
from typing import Any

from strategies.poses.waypoints import Ring
from warpgrasp.spec_words import number, spec_words


@spec_words
@dataclass(frozen=True)
class Strategy:
    """One entry of a leaderboard.

    `waypoints` are visited one family after the other, shared out evenly over the containments of
    `order`; at each pose the hand closes once along every path of `closings`.
    """

    name: str
    waypoints: tuple[object, ...] = (Ring(),)
    closings: tuple[str, ...] = ("curl40", "base_then_curl")
    order: tuple[str, ...] = ("containment",)
    doc: str = ""
    call: str = ""
    """A registered planner, or `file.py:name`; empty: the order above."""
    options: tuple[tuple[str, Any], ...] = ()
    """Arguments of the planner, by name."""
    refit_every: int = number(
        0, 0, 256, "poses of a containment between two fits; 0: one fit after all of them, "
                   "after each where volume_ratio is a budget; of planners only random and even "
                   "go by it")
    noise_stream: int = number(0, 0, 10**6, "strategies of one stream meet the same noise")
    touches: int | None = number(
        None, 1, 10**6, "budget: guarded motions of a finger in an episode, felt or not")
    robot_time_s: float | None = number(None, 1e-3, 1e6, "budget: robot time of an episode")
    volume_ratio: float | None = number(
        None, 1.0, 1e6, "budget: 90 % interval of the volume, upper over lower bound")

    def __post_init__(self) -> None:
        if isinstance(self.order, str) or not (self.call or self.order) or not (
                set(self.order) <= set(PROCEDURES)):
            raise ValueError(f"Strategy: order is {self.order!r}; should be a list of "
                             f"{', '.join(PROCEDURES)}, such as (\"containment\",)")


BUDGET_KEYS = ("touches", "robot_time_s", "volume_ratio")
PROCEDURES: dict[str, str] = {
    "containment": "tendon-guarded closing of all fingers at each waypoint (paper, section IV-C)",
    "planar": "the extended index finger crosses the faces of the body believed (section IV-D)",
    "contour": "thumb and index finger follow the body's contour along its axis (section IV-E)",
    "decide": "the recovered shape picks: faces of a blocky body, contour of a round one, and "
              "its end where that is flat (section V)",
}
