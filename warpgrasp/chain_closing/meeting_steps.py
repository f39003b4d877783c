# type: ignore  # Warp functions, which type checkers cannot follow
"""How many steps of the commands a hand whose links meet may go at once.

Skins of links do not rub. While no finger that moves, or that another one pushes, presses body or
table, where the hand rests hangs on its commands alone and not on the way there: steps whose
readings stop nothing need not be taken.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import Chain
from warpgrasp.chain_closing.chain_closing_kernel import touches
from warpgrasp.chain_closing.chain_record import ChainClosingRow, ChainTruthRow
from warpgrasp.core.dtypes import real
from warpgrasp.finger.chain_energy import ChainRest
from warpgrasp.hand_rest.chain_meetings import ChainMeeting
from warpgrasp.hand_rest.meetings import fingers_met

SURE = wp.constant(real(0.7))
"""Share of a threshold: what reads less would be stopped by no noise."""
_SLOW = wp.constant(real(1e-3))  # share of it a step: a rise that may be noise alone
_LONGEST = wp.constant(8)


@wp.func
def hangs_on_commands(
    hands: wp.array2d[Chain], own: int, state: wp.array2d[ChainRest],
    meetings: wp.array2d[ChainMeeting], i: int, count: int, stopped: int
):
    """Whether where a hand rests hangs on its commands alone."""
    moved = ~stopped
    for a in range(count):
        moved = moved | fingers_met(meetings[i, a])
    presses = int(0)
    for f in range(hands.shape[1]):
        if (moved & (1 << f)) != 0 and touches(hands[own, f], state[i, f]):
            presses = int(1)
    return presses == 0


@wp.func
def steps_at_once(
    felt: wp.array4d[ChainClosingRow], truth: wp.array4d[ChainTruthRow], w: int, p: int, g: int,
    alone: int, s: int, gone: int, most: real, before: real
):
    """How many steps to go from step `s` on, of a hand that `gone` steps led from `before` to
    `most` of the threshold; at least one. Of `alone`, a bit each, none is taken past the step
    before it touches, or that it stops at, closing alone."""
    rise = wp.max((most - before) / real(gone), _SLOW)
    steps = wp.min(wp.min(2 * gone, _LONGEST), int((SURE - most) / rise))
    for f in range(felt.shape[3]):
        if (alone & (1 << f)) != 0:
            if truth[w, p, g, f].touched > s:
                steps = wp.min(steps, truth[w, p, g, f].touched - 1 - s)
            steps = wp.min(steps, felt[w, p, g, f].step - s)
    return wp.max(steps, 1)
