"""Surfaces of revolution from touches, in batch: a free axis and a contour of linear segments.

As in Allen and Michelman (1990), sections are circular and the contour is piecewise linear. Here it
has a fixed number of evenly spaced nodes between a free bottom and top, and flat ends. Residuals
are distances to the closed contour in the half plane of height and radius, so touches on the ends
count too.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from fit.arrays import is_valid
from fit.fit_status import FitStatus
from fit.optimize.batch import Program, map_lanes, take
from fit.optimize.multistart import Problem, advance, finish, screen
from fit.optimize.pieces import PIECE, divided, undivided
from fit.option_checks import MOST_WEIGHT, checked_array, options_of
from fit.prepare import Sets, prepare
from fit.revolution.record import STANDS, Middle, RevolutionFit, RevolutionOptions
from fit.revolution.residuals import BY_POINT, EXACT_COST, FitData, evaluate, normal_equations
from fit.rotation import is_upward
from fit.superquadric.starts import box_starts

TOUCH_STD_M = 0.001
"""Of a touch about the contour, which priors are weighed against [est]."""
LEAST_MIDDLE_STD_M = TOUCH_STD_M / MOST_WEIGHT
"""Of a middle: one known better counts as this."""
_LEAST_TILT_WEIGHT = 1e-3  # so that a sphere has one answer


def fit_revolution(
    points: Float[np.ndarray, "fit point 3"],
    mask: Bool[np.ndarray, "fit point"] | None = None,
    *,
    table_z: float | Float[np.ndarray, " fit"] | None = None,
    middle: Middle | None = None,
    options: RevolutionOptions | None = None,
) -> RevolutionFit:
    """Fit surfaces of revolution to sets of points [m].

    With `table_z` [m] the lowest place lies on the table: an end, or the side of a body that lies.
    `middle` tells what else is known of where the axes go through: touches all on one side, or on
    two that are opposite, tell it badly.
    Raises ValueError for an array of the wrong shape and a `middle` that is none; any other problem
    of a set is its `status`.
    """
    options = options_of(options, RevolutionOptions)
    sets = prepare(points, mask, table_z=table_z)
    n = len(sets.count)
    known, none = _known(middle, n)
    sets = replace(sets, status=np.where(none, FitStatus.bad_points, sets.status))
    size = sets.high - sets.low
    rows: dict[str, np.ndarray] = {
        "position_m": 0.5 * (sets.high + sets.low) - [0, 0, 0.5] * size,
        "axis": np.tile([0.0, 0.0, 1.0], (n, 1)),
        "height_m": size[:, 2],
        "radius_m": np.repeat(0.25 * (size[:, :1] + size[:, 1:2]), options.nodes, axis=1),
        **{name: np.zeros(n) for name in ("volume_m3", "rms_m", "cost")},
        "radius_std_m": np.zeros((n, options.nodes)),
        "iterations": np.zeros(n, int),
        "status": sets.status.copy(),
        "n_points": sets.count.copy(),
    }
    for index, bucket in sets.buckets():
        for name, values in _fit_bucket(bucket, known.rows(index), options).items():
            rows[name][index] = values
    return RevolutionFit(**rows)


def _known(middle: Middle | None, n: int) -> tuple[Middle, Bool[np.ndarray, " fit"]]:
    """What is known of the middles of `n` axes, and for which of them it is no evidence."""
    if middle is None:
        return Middle(np.zeros((n, 3)), np.full(n, np.inf)), np.zeros(n, bool)
    if not isinstance(middle, Middle):
        raise ValueError(f"middle: {type(middle).__name__}, should be a Middle")
    point = checked_array("middle.point_m", middle.point_m, (n, 3))
    std = checked_array("middle.std_m", middle.std_m, (n,))
    told = std < np.inf
    sound = np.all(is_valid(point), axis=1)
    none = np.isnan(std) | (std < 0.0) | (told & ~sound)
    return Middle(np.where(sound[:, None], point, 0.0),
                  np.where(none, np.inf, np.maximum(std, LEAST_MIDDLE_STD_M))), none


def _even_volume(height_m: np.ndarray, radius_m: np.ndarray) -> np.ndarray:
    """Volume [m^3] of cone frustums of one height, all of them [fit] and radii [fit, node] in [m].
    """
    low, high = radius_m[:, :-1], radius_m[:, 1:]
    step = height_m / (radius_m.shape[1] - 1)
    return np.pi / 3 * step * (low**2 + low * high + high**2).sum(axis=1)


def _fit_bucket(
    sets: Sets, middle: Middle, options: RevolutionOptions
) -> dict[str, np.ndarray]:
    n = len(sets.count)
    down, floor = (None, None) if sets.plane is None else (sets.plane[:, :3], sets.plane[:, 3])
    if options.upright and down is None:
        down = np.tile([0.0, 0.0, -1.0], (n, 1))
    trim = 0.0 if options.loss == "none" else 0.03
    rotation, half, centre = box_starts(sets.points, sets.mask, down, floor, trim)
    if options.upright:
        rotation, half, centre = rotation[:, 3:4], half[:, 3:4], centre[:, 3:4]
    elif down is not None:
        # The three principal axes, and of the upright box only the upright axis.
        rotation, half, centre = rotation[:, :4], half[:, :4], centre[:, :4]
    starts = rotation.shape[1]
    local = np.einsum("fsji,fsj->fsi", rotation, centre)
    theta = np.zeros((n, starts, 6 + options.nodes))
    theta[..., 2:4] = local[..., :2]
    theta[..., 4] = local[..., 2] - half[..., 2]
    theta[..., 5] = local[..., 2] + half[..., 2]
    theta[..., 6:] = np.log(0.5 * (half[..., :1] + half[..., 1:2]))
    weight = sets.mask / np.sqrt(sets.count)[:, None]
    plane = np.zeros((n, 5))  # without weight: the same program with a table and without
    if sets.plane is not None:
        plane = np.concatenate([sets.plane, np.full((n, 1), options.plane_weight)], axis=1)
    lanes = FitData(np.moveaxis(sets.points, 2, 1).copy(), weight, rotation[:, 0],
                  0.1 / np.sqrt(sets.count), plane, _tilt_weight(sets, options),
                  _middle(sets, middle, rotation[:, 0]))
    spread = take(lanes, np.repeat(np.arange(n), starts))
    spread = spread._replace(rotation=rotation.reshape(-1, 3, 3), middle=np.concatenate([
        _middle(sets, middle, rotation[:, start])[:, None] for start in range(starts)], 1
    ).reshape(-1, 3))
    problem = _problem(_form(options))
    best, found = screen(problem, theta, spread, options.screen_iterations)
    rotation = rotation[np.arange(n), best]
    lanes = lanes._replace(rotation=rotation, middle=_middle(sets, middle, rotation))
    if options.loss != "none":
        for _ in range(2):
            lanes = lanes._replace(loss_scale=_scale(found, lanes, sets, options))
            found = advance(problem, found, lanes._replace(plane=_while_rough(plane, rotation)),
                            options.round_iterations).theta
    end = finish(problem, found, lanes, at_a_time=options.round_iterations,
                 at_most=options.iterations, least_fall=options.least_fall, least_cost=EXACT_COST)
    return _rows(end, lanes, sets, options)


def _tilt_weight(sets: Sets, options: RevolutionOptions) -> np.ndarray:
    """Of the slopes' residuals beside touches', which are weighted by 1 / sqrt(count)."""
    if options.tilt_std_rad is None:
        return np.full(len(sets.count), _LEAST_TILT_WEIGHT)
    return np.maximum(TOUCH_STD_M / (sets.scale * options.tilt_std_rad * np.sqrt(sets.count)),
                      _LEAST_TILT_WEIGHT)


def _while_rough(plane: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """`FitData.plane` of fits that are not near their end, (fit, 5): without weight where the axis
    lies. Any node may touch the table there, and an end that grew until it does would keep others
    from it."""
    stands = np.abs(np.einsum("fi,fi->f", plane[:, :3], rotation[:, :, 2])) > STANDS
    return np.concatenate([plane[:, :4], np.where(stands[:, None], plane[:, 4:], 0.0)], axis=1)


def _middle(sets: Sets, known: Middle, rotation: np.ndarray) -> np.ndarray:
    """`FitData.middle` of frames, (fit, 3)."""
    unit = (known.point_m - sets.origin) / sets.scale[:, None]
    return np.concatenate([np.einsum("fji,fj->fi", rotation, unit)[:, :2],
                           (TOUCH_STD_M / (known.std_m * np.sqrt(sets.count)))[:, None]], 1)


def _scale(theta, lanes: FitData, sets: Sets, options: RevolutionOptions) -> np.ndarray:
    """Scale of the robust loss: 2.4 standard deviations, estimated from the median residual."""
    away = _evaluated(theta, lanes, options).distance
    size = np.where(sets.mask, np.abs(away) * lanes.weight, np.nan)
    spare = np.maximum(sets.count - theta.shape[1], 1) / sets.count
    deviation = 1.4826 * np.nanmedian(size, axis=1) / np.sqrt(spare)
    return np.clip(2.4 * deviation, 1e-4 / np.sqrt(sets.count), lanes.loss_scale)


def _rows(end, lanes: FitData, sets: Sets, options: RevolutionOptions) -> dict[str, np.ndarray]:
    body, away, touches, others = _evaluated(end.theta, lanes, options)
    information = touches + others
    position, axis, height, radius = body
    scale = sets.scale
    # Point the axis upwards, so that the result does not depend on the start.
    up = is_upward(axis)
    position = np.where(up, position, position + height[:, None] * axis)
    square = np.where(sets.mask, away**2, 0.0).sum(axis=1)
    parameters = end.theta.shape[1]
    # Variance of one touch, in the units of the information (weights are 1/sqrt(count)).
    drawn = np.minimum(away**2, 9 * np.nanmedian(np.where(sets.mask, away**2, np.nan),
                                                 axis=1, keepdims=True) * 2.2)
    spare = np.maximum(sets.count - parameters, 1)
    noise = np.where(sets.mask, drawn, 0.0).sum(axis=1) / spare
    information = information / (noise / sets.count)[:, None, None].clip(1e-18)
    cov = np.linalg.inv(information + np.eye(parameters))
    radius_std = np.sqrt(np.diagonal(cov, axis1=1, axis2=2)[:, 6:]) * radius
    volume = _even_volume(height, radius)
    return {
        "position_m": position * scale[:, None] + sets.origin,
        "axis": np.where(up, axis, -axis),
        "height_m": height * scale,
        "radius_m": np.where(up, radius, radius[:, ::-1]) * scale[:, None],
        "volume_m3": volume * scale**3,
        "rms_m": np.sqrt(square / sets.count) * scale,
        "cost": end.cost,
        "radius_std_m": np.where(up, radius_std, radius_std[:, ::-1]) * scale[:, None],
        "iterations": end.iterations,
        "status": end.status,
    }


def _form(options: RevolutionOptions) -> RevolutionOptions:
    """What programs close over: the rest is data, or says how often they are called."""
    return RevolutionOptions(nodes=options.nodes, smoothing=options.smoothing,
                             monotone=options.monotone, loss=options.loss)


@lru_cache(maxsize=64)
def _problem(options: RevolutionOptions) -> Problem:
    return Problem(lambda theta, data, span, _: normal_equations(theta, data, options, span),
                   f"{options}", BY_POINT)


def _evaluated(theta, lanes: FitData, options: RevolutionOptions) -> Any:
    """The `Evaluated` of every fit; each piece of its touches is a lane of the program."""
    points, weight = divided(lanes.points), divided(lanes.weight)
    n, pieces = weight.shape[:2]
    spread = take(lanes._replace(points=points[:, 0], weight=weight[:, 0]),
                  np.repeat(np.arange(n), pieces))
    spread = spread._replace(points=points.reshape(-1, 3, PIECE), weight=weight.reshape(-1, PIECE))
    found = map_lanes(_evaluate(_form(options)), np.repeat(theta, pieces, axis=0), spread)
    parts = lambda values: values.reshape(n, pieces, *values.shape[1:])  # noqa: E731
    return take(found, np.arange(0, n * pieces, pieces))._replace(
        distance=undivided(parts(found.distance), lanes.points.shape[2]),
        touch_information=parts(found.touch_information).sum(1))


@lru_cache(maxsize=64)
def _evaluate(options: RevolutionOptions):
    return Program(f"evaluate {options}",
                   jax.vmap(lambda theta, data: evaluate(theta, data, options)))
