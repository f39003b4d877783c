# type: ignore  # Warp functions, which type checkers cannot follow
"""Whether a finger that stopped may press on another link, by what its robot knows.

A finger that nothing holds rests where its command has it. One that presses on a link with a force
is turned from there by as much as the force turns its joints, until it is out of the link. So three
things agree: how deep in the link the finger would rest if it were free, how far it is turned from
there, and which way. What a force at best leaves unexplained of them is its misfit. The way is that
between links as they are read: there they touch if they do.
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import ZERO, real, struct

NO_PRESS = wp.constant(real(1e9))  # misfit of links that cannot press, in squared deviations
PRESS_REACH = wp.constant(real(0.03))  # [m]: links as far apart do not meet
_TINY = wp.constant(real(1e-12))  # [rad2/N2]
_AT_STOP = wp.constant(real(0.03))  # [rad]: from a stop, which the joint then is pushed against


@struct
class Doubt:
    """What a robot does not know of its fingers, variances."""

    zero: real
    """Of where a joint is whose reading is without noise [rad2]."""
    reading: real
    """Of the noise of a reading [rad2]."""
    turn: real
    """Of how far a joint is read to be turned from where it would rest free [rad2]."""
    place: real
    """Per axis, of a place on a finger whose joint angles are known [m2]."""


@wp.func
def pushed_turn(away: Any, stiffness: Any, free: Any, low: Any, high: Any, stop: real):
    """How a newton turns joints that rest at `free` if `away` is how its place moves along it with
    them [rad/N]: against servos, and against stops of stiffness `stop` [N m/rad]."""
    turn = wp.cw_div(away, stiffness)
    for j in range(len(turn)):
        if (turn[j] < ZERO and free[j] < low[j] + _AT_STOP) or (
                turn[j] > ZERO and free[j] > high[j] - _AT_STOP):
            turn[j] = away[j] / (stiffness[j] + stop)
    return turn


@wp.func
def press_misfit(
    apart: real, both: real, variance: real, away: Any, give: Any, turned: Any, doubt: Doubt
):
    """How badly a finger that presses on a link explains where it is read: squared deviations.

    If the finger were free, its axis would be `apart` from the link's [m], with a `variance` [m2],
    of which skins take `both`, and `away` [m/rad] is how that changes with the joints. `give`
    [rad/N] is how a newton that pushes away from the link turns them, and `turned` [rad] how far
    they are from where they would be free. A finger that would be deeper in the link than the force
    explains is no contradiction: the link gives, too.
    """
    gap = apart - both
    # The force leans from where it is believed to point as links are beside where they are.
    doubtful = doubt.turn + wp.dot(turned, turned) * variance / wp.max(apart * apart, both * both)
    soft = wp.max(wp.dot(give, give), _TINY)
    lift = wp.dot(away, give)  # [m/N]
    force = wp.max(wp.dot(turned, give) / soft, ZERO)
    if gap + lift * force > ZERO:  # less of it explains the gap, more of it the turn
        by_turn = soft / doubtful
        by_gap = lift * lift / variance
        force = wp.max((by_turn * force - lift * gap / variance) / (by_turn + by_gap), ZERO)
    over = wp.max(gap + lift * force, ZERO)
    left = turned - give * force
    return over * over / variance + wp.dot(left, left) / doubtful
