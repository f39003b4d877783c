# type: ignore  # Warp functions, which type checkers cannot follow
"""Sums over directions and places of a posterior of contacts, none of whose weights overflows.

Weights are relative to the smallest chi-square so far: a smaller one makes all before it fade.
"""

import warp as wp

from warpgrasp.core.dtypes import HALF, ZERO, real, struct, vec3

WORST = wp.constant(real(1e12))
"""The chi-square of a sum to which nothing was added yet."""
NEGLIGIBLE = wp.constant(real(60.0))
"""What lies so far in chi-square above the smallest does not count."""

AROUND = 7
"""Directions around a link."""
CAP = 5
"""Directions over a round tip, each way."""
MOST_DIRECTIONS = max(AROUND, CAP * CAP)
"""That are summed up at one place."""
LEVEL = 1e-9
"""A direction of a tip that leans back by less is level with its rim, and counts: a fifth of them
are, but for rounding."""


@struct
class Around:
    """Sums over the directions at one place along an axis, each weighted by exp((least -
    chi-square) / 2) and by how much narrower than one the spread of the torques is."""

    least: real
    """The smallest chi-square so far, the body's distance aside."""
    weight: real
    outward: vec3
    most: real
    """The largest weight of a direction."""
    misfit: real
    """Chi-square there."""


@struct
class Place:
    """Sums over the places of one link, weighted so."""

    least: real
    """The smallest chi-square so far, that of the body's distance included."""
    misfit: real
    """Chi-square where the weight, `most`, is largest."""
    most: real
    weight: real
    along: real
    axis: vec3
    outward: vec3
    alone: real
    """The weights without the body's distance, and their first two moments along the axis."""
    alone_along: real
    alone_square: real
    alone_least: real


@wp.func
def with_direction(here: Around, d: vec3, chi: real, narrower: real):
    """`here` with one more direction."""
    weight = narrower
    if chi < here.least:
        fade = wp.exp(HALF * wp.max(chi - here.least, -NEGLIGIBLE))
        if here.least == WORST:
            fade = ZERO
        here.least = chi
        here.weight *= fade
        here.outward *= fade
        here.most *= fade
    else:
        weight *= wp.exp(HALF * wp.max(here.least - chi, -NEGLIGIBLE))
    here.weight += weight
    here.outward += d * weight
    if weight > here.most:
        here.most = weight
        here.misfit = chi
    return here


@wp.func
def with_place(post: Place, here: Around, x: vec3, along: real, area: real, beside: real):
    """`post` with one more place along the axis, where each direction stands for `area`, and the
    body's distance adds `beside` to chi-square."""
    least = here.least + beside
    if least < post.least:
        fade = wp.exp(HALF * wp.max(least - post.least, -NEGLIGIBLE))
        if post.least == WORST:
            fade = ZERO
        post.least = least
        post.most *= fade
        post.weight *= fade
        post.along *= fade
        post.axis *= fade
        post.outward *= fade
    if here.least < post.alone_least:
        fade = wp.exp(HALF * wp.max(here.least - post.alone_least, -NEGLIGIBLE))
        if post.alone_least == WORST:
            fade = ZERO
        post.alone_least = here.least
        post.alone *= fade
        post.alone_along *= fade
        post.alone_square *= fade
    if least < post.least + NEGLIGIBLE:
        share = wp.exp(HALF * (post.least - least))
        if share * here.most > post.most:
            post.most = share * here.most
            post.misfit = here.misfit + beside
        weight = share * area * here.weight
        post.weight += weight
        post.along += along * weight
        post.axis += x * weight
        post.outward += here.outward * (share * area)
    if here.least < post.alone_least + NEGLIGIBLE:
        weight = area * here.weight * wp.exp(HALF * (post.alone_least - here.least))
        post.alone += weight
        post.alone_along += along * weight
        post.alone_square += along * along * weight
    return post
