"""A strategy given in advance: where the hand goes, how it closes, which procedures, in order."""

from dataclasses import dataclass

from strategies.waypoints import Ring


@dataclass(frozen=True)
class Strategy:
    """One entry of a leaderboard.

    `waypoints` are visited one family after the other; at each pose the hand closes once along
    every path of `closings`; `order` names the exploratory procedures.
    """

    name: str
    waypoints: tuple[object, ...] = (Ring(),)
    closings: tuple[str, ...] = ("curl40", "base_then_curl")
    order: tuple[str, ...] = ("containment",)
    doc: str = ""
