"""Numbers of the exploratory procedures that a spec may set or sweep, with their bounds."""

from dataclasses import dataclass, field
from math import radians

from warpgrasp.spec_words import choice, number, spec_words


@spec_words
@dataclass(frozen=True)
class PlanarTable:
    """Crossing faces (paper, section IV-D)."""

    faces: int = number(5, 1, 5, "faces crossed: the top, then sides, those facing the arm first")
    step_m: float = number(0.006, 5e-4, 0.1, "along the surface")
    interval_m: float = number(0.001, 1e-4, 0.02, "of a guarded line")
    stand_off_m: float = number(0.030, 0.001, 0.2, "the approach starts this far before a face")
    edge_drop_m: float = number(0.004, 5e-4, 0.1, "no contact this far down: the face ended")
    most_steps: int = number(60, 1, 60, "in one direction; with fine steps a face is crossed "
                             "no farther than these go")


@spec_words
@dataclass(frozen=True)
class ContourTable:
    """Following a contour with thumb and index finger (paper, section IV-E)."""

    axis: str = choice("vertical", ("vertical", "fit", "stereo"),
                       "direction of exploration: upright, the body's own, or seen by two cameras")
    axis_error_rad: float = number(0.0, 0.0, radians(40), "the direction is wrong by this, "
                                   "towards an azimuth at random")
    step_m: float = number(0.010, 0.001, 0.1, "along the axis")
    finest_step_m: float = number(0.0025, 2e-4, 0.05, "the end is searched down to this")
    refine: bool = field(default=True, metadata={"doc": "fit the axis to the touches"})


@spec_words
@dataclass(frozen=True)
class DecideTable:
    """How the recovered shape picks the next procedure."""

    round_from: float = number(0.5, 0.0, 2.0,
                               "exponent of the level section from which a body counts as round")
    turned_within: float = number(1.15, 0.0, 10.0, "or from which a surface of revolution leaves "
                                  "this many times the superquadric's mean distance; 0: not asked")
    turned_within_m: float = number(0.0025, 0.0, 1.0, "and no more than this, by which no surface "
                                    "of revolution comes near a block or a wedge")
    flat_share: float = number(0.5, 0.0, 1.0, "share of the sides crossed that must prove flat, "
                               "or the body is followed as a round one after all")
    ends: bool = field(default=True, metadata={"doc": "cross the top of a round body that is flat "
                                               "there, too"})
    flat_below: float = number(0.4, 0.0, 2.0,
                               "exponent of the upright section below which the top is flat")
