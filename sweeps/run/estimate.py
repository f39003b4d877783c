"""Estimates of the disk space and time of a study before it is run."""

from itertools import product
from math import log
from statistics import mean

from strategies.ready_made import UNGUIDED, run_together
from strategies.strategy import Strategy
from sweeps.run.plan import Plan
from sweeps.spec.checks import arms_of
from sweeps.spec.hands import hands_of
from sweeps.spec.study import Study
from warpgrasp.parameters import FLOATING, PUMA560, UTAH_MIT, FitTable

UNIT_BYTES = 21_000  # of a unit file beside its episodes: what its columns are, measured
EPISODE_BYTES = 270  # measured
RECONSTRUCT = "fit.reconstruct"
MOVE_BYTES = 65  # of a guarded move whose contact is kept, measured
TOUCHES = 200  # of a procedure that feels with pads
# Seconds of one core, measured on objects of the catalogue and a scanned bottle, in units of 64
# episodes, of planners those of many objects together; a quieter or a faster machine takes half
# as long.
FIT_S = 0.008  # a body found from scratch, in five fits
GRASP_S = 0.0008  # a pose of two closings
TOUCHED_S = {"planar": 0.07, "contour": 0.03, "decide": 0.08}
STEP_S = {"random": 0.007, "even": 0.007, "any-object": 0.08, "oracle": 0.05}
"""A step of planners that choose one pose at a time, its fit included."""
UNGUIDED_S = 0.0015
"""Those whose bodies are fitted once, and a pose of theirs."""
OTHER_STEP_S = 0.01
"""Of the others, and of planners of the user's own."""
START_S = 4.0
"""Until the first unit is begun, where kernels and fits have been compiled (`warpgrasp warmup`)."""
# What few episodes do not share: user CPU seconds on two cores with other work on them, of
# catalogue objects, mugs and bottles, 1 to 16 episodes a call [est].
OBJECT_S = 0.6
"""The first time that a worker meets an object: its grid, the elements of its surface."""
UNIT_S = 0.1
"""A unit beside its episodes, placing, fits and scores of few worlds: 0.04 to 0.3."""
UNIT_STEP_S = 0.07
"""A step of a planner that is called for one unit at a time, beside its worlds."""
FORM_S = 0.22
"""Making and scoring a body where a free form may stand for it [est]."""
GROWN = 1.5
"""By which factor touches have grown when the next such body is made (docs/free_forms.md)."""
# Factors on all of these, measured with hands and arms that ship, in units of 4 episodes.
CHAINS = {"any-object": 0.6}
CHAINS_OTHER = 1.3
"""Of hands that are chains of joints, by what the strategy calls."""
ITERATED = {"any-object": 25.0}
ITERATED_OTHER = 8.0
"""Of arms whose inverse kinematics are iterated, where a planner tries many poses a step."""


def estimate_cost(plan: Plan) -> list[tuple[str, str]]:
    """Rows of `warpgrasp check`: disk and time."""
    study = plan.study
    robots = [*product(arms_of(study), hands_of(study))]
    free = _free_share(study)
    seconds = START_S + OBJECT_S * len(study.objects)
    moves = 0.0
    for number, strategy in enumerate(study.strategies):
        cells = len(study.objects) * study.settings_of(number)
        each, units = cells * study.head.episodes_per_cell, cells * plan.block_count
        moves += each * episode_moves(strategy)
        seconds += each * mean(episode_seconds(strategy, *robot) for robot in robots)
        seconds += each * free * form_seconds(strategy) + units * unit_seconds(strategy, free > 0)
    disk = (plan.unit_count * UNIT_BYTES
            + EPISODE_BYTES * study.cell_count * study.head.episodes_per_cell)
    if study.head.keep == "contacts":
        disk += MOVE_BYTES * moves
    return [("disk", f"about {disk / 1e6:.1f} MB (estimate)"),
            ("time", f"about {_time(seconds)} on one core (estimate)")]


def episode_seconds(strategy: Strategy, arm: str = PUMA560, hand: str = UTAH_MIT) -> float:
    """What one episode costs one core, roughly, with an arm and a hand of these kinds."""
    seconds = _usual_seconds(strategy)
    if hand != UTAH_MIT:
        seconds *= CHAINS.get(strategy.call, CHAINS_OTHER)
    if arm not in (PUMA560, FLOATING) and strategy.call and strategy.call not in UNGUIDED:
        seconds *= ITERATED.get(strategy.call, ITERATED_OTHER)
    return seconds


def form_seconds(strategy: Strategy) -> float:
    """What free forms add to an episode: one at its end, and of planners those on the way."""
    steps = (strategy.touches or 96) / 8 if strategy.call or strategy.refit_every else 1.0
    return FORM_S * (1.0 + log(max(1.0, steps)) / log(GROWN))


def unit_seconds(strategy: Strategy, free_forms: bool) -> float:
    """What a unit costs beside its episodes."""
    if run_together(strategy.call, free_forms):
        return UNIT_S
    return UNIT_S + UNIT_STEP_S * min((strategy.touches or 96) / 8, 64.0)


def _free_share(study: Study) -> float:
    """The share of settings in which a free form may stand for the body."""
    words = [point[axis.keys.index(RECONSTRUCT)] for axis in study.axes
             if RECONSTRUCT in axis.keys for point in axis.si]
    return mean(FitTable(reconstruct=word).free_forms
                for word in words or [study.tables["fit"].reconstruct])


def _usual_seconds(strategy: Strategy) -> float:
    """With the PUMA 560 or a floating wrist, and the Utah-MIT hand."""
    poses = sum(getattr(family, "count", 12) for family in strategy.waypoints)
    if strategy.call in UNGUIDED and not strategy.refit_every:
        return 2 * FIT_S + UNGUIDED_S * min((strategy.touches or 96) / 8, 38.0)
    if strategy.call:
        return STEP_S.get(strategy.call, OTHER_STEP_S) * min((strategy.touches or 96) / 8, 64.0)
    fits = strategy.order.count("containment") * (
        max(1.0, poses / strategy.refit_every) if strategy.refit_every else 1.0)
    return (FIT_S * fits + GRASP_S * poses
            + sum(TOUCHED_S.get(name, 0.0) for name in {*strategy.order}))


def episode_moves(strategy: Strategy) -> float:
    """Guarded moves of an episode, roughly: fingers closed, touches of pads."""
    if strategy.touches is not None or strategy.call:
        return strategy.touches or 96
    poses = sum(getattr(family, "count", 12) for family in strategy.waypoints)
    feels = len(TOUCHED_S.keys() & set(strategy.order))
    return 4 * len(strategy.closings) * poses * ("containment" in strategy.order) + TOUCHES * feels


def _time(seconds: float) -> str:
    for size, unit in ((86400, "days"), (3600, "hours"), (60, "minutes")):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} seconds"
