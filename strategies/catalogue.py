"""Ready-made strategies, found by name."""

from math import radians

from strategies.strategy import Strategy
from strategies.waypoints import Column, Opposing, Random, Ring, Top

STRATEGIES: dict[str, Strategy] = {s.name: s for s in (
    Strategy("ring6", (Ring(count=6, tilt_rad=radians(35)),), doc="six around at 35 deg"),
    Strategy("top2-ring6", (Top(count=2), Ring(count=6)),
             doc="two poses from above, then six around at 55 deg"),
    Strategy("column", (Column(),), doc="three rings of three up the object at 55 deg"),
    Strategy("opposing6", (Opposing(count=6),), doc="three pairs of poses half a turn apart"),
    Strategy("random6", (Random(count=6),), doc="six poses at random from the upper side"),
    Strategy("top6", (Top(count=6),), doc="six poses from above, turned evenly"),
)}
