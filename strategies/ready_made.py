"""Ready-made strategies, found by name."""

from dataclasses import replace
from math import radians

from strategies.poses.waypoints import Column, Hemisphere, Opposing, Random, Ring, Spiral, Top
from strategies.strategy import Strategy

RIM = Ring(count=6, tilt_rad=radians(50), roll_rad=radians(90), aim=1.0, aim_out=1.0,
           palm_clearance_m=0.080, clearance_per_radius=0.0)
RIM_TURNED = replace(RIM, roll_rad=radians(-90), azimuth_rad=radians(30))
AROUND = Ring(count=6, tilt_rad=radians(50), palm_clearance_m=0.045, clearance_per_radius=1.0)
CLOSE = Ring(count=6, tilt_rad=radians(50), palm_clearance_m=0.030, clearance_per_radius=0.5,
             azimuth_rad=radians(30))
"""Rings of several strategies, and of the candidates that adaptive ones choose from."""
TOUCHES = 96
"""Budget of the strategies that choose one pose at a time: twelve poses of two closings."""
DEFAULT = "any-object"
"""Where none is named: it supposes nothing of the object's shape."""
REFERENCE = "given-prior"
"""Doing nothing: the name of the row that scores what every strategy is given."""
STRATEGIES: dict[str, Strategy] = {s.name: s for s in (
    Strategy("ring6", (Ring(count=6, tilt_rad=radians(35)),), doc="six around at 35 deg"),
    Strategy("ring18", (Ring(count=18, tilt_rad=radians(50)),), doc="eighteen around at 50 deg"),
    Strategy("top2-ring6", (Top(count=2), Ring(count=6)),
             doc="two from above, then six around at 55 deg"),
    Strategy("rim6-ring12", (RIM, AROUND, CLOSE),
             doc="six on the rim, six around, six around and closer"),
    Strategy("rim12-ring12", (RIM, RIM_TURNED, AROUND, CLOSE),
             doc="twelve on the rim, thumb below and above, six around, six closer"),
    Strategy("coarse-to-fine", (RIM, AROUND, CLOSE), order=("containment", *["decide"] * 3),
             doc="eighteen grasps, then faces or contour as the recovered shape picks, and the "
                 "other if that was wrong"),
    Strategy("contour-first", order=("contour", "containment"), waypoints=(RIM, AROUND),
             doc="the contour about the prior, then twelve grasps"),
    Strategy("planar", (RIM, AROUND, CLOSE), order=("containment", "planar"),
             doc="eighteen grasps, then the faces of the recovered body"),
    Strategy("contour", (RIM, AROUND, CLOSE), order=("containment", "contour"),
             doc="eighteen grasps, then the contour of the recovered body"),
    Strategy("contour-only", order=("contour",), doc="the contour about the prior"),
    Strategy("column9", (Column(count=9),), doc="three rings of three up the object at 55 deg"),
    Strategy("opposing6", (Opposing(count=6),), doc="three pairs half a turn apart"),
    Strategy("spiral12", (Spiral(count=12),), doc="twelve up the object, twice around"),
    Strategy("hemisphere12", (Hemisphere(count=12),), doc="twelve directions evenly from above"),
    Strategy("random6", (Random(count=6),), doc="six at random from the upper side"),
    Strategy("random18", (Random(count=18),), doc="eighteen at random from the upper side"),
    *(Strategy(name, call=name, touches=TOUCHES, doc=doc) for name, doc in (
        ("random", "baseline: a pose at random among the candidates"),
        ("even", "baseline: the pose farthest from those taken"),
        ("coverage", "adaptive: touches farthest from all that was felt"),
        ("most-uncertain", "adaptive: where the fitted surface is least certain"),
        ("information", "adaptive: greatest expected information (D-optimal)"),
        ("gaussian-process", "adaptive: where a Gaussian process surface is least certain"),
        ("any-object", "adaptive: where an object of any shape may still be found"),
        ("expected-error", "adaptive: lowers the expected error of the whole surface most"),
        ("oracle", "the ceiling: takes the truly best of its candidates, by the truth"))),
)}
UNGUIDED = ("random", "even")
"""Planners that do not look at what was felt: `refit_every` says when bodies are fitted."""
PLANNED_TOGETHER = frozenset(("random", "even", "coverage", "most-uncertain", "information",
                              "gaussian-process", "expected-error", "oracle"))
"""Planners that keep worlds apart, and need little memory for each: hundreds are run in one call.
"""
SEARCH_FREELY = frozenset(("gaussian-process",))
"""Of these, the ones that need more where a free form may stand for the body: one unit a call."""


def run_together(call: str, free_forms: bool) -> bool:
    """Whether several units of a strategy that calls this planner, or none, run in one call."""
    return not call or (
        call in PLANNED_TOGETHER and not (call in SEARCH_FREELY and free_forms))
