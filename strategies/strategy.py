"""A strategy: where the hand goes, how it closes, which procedures in which order, how far.

Either given in advance (`order` over `waypoints`), or a planner that decides as it goes: `call`
names a registered one, or one in a user's file. `strategies.planners` makes both into what
`strategies.exploration` asks for the next probes.
"""

from dataclasses import dataclass
from typing import Any

from strategies.waypoints import Ring


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
    refit_every: int = 0
    """Poses of a containment between two fits; 0: one fit after all of them."""
    touches: int | None = None
    """Budget; see `strategies.budget`."""
    robot_time_s: float | None = None
    volume_ratio: float | None = None
    noise_stream: int = 0
    """Strategies of one stream meet the same noise; another number draws noise of its own."""
