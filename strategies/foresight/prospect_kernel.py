# type: ignore  # Warp functions, which type checkers cannot follow
"""What hands would meet in a grid of beliefs: which poses are barred, what each finger touches.

Balls are looked up in units of a cell, since a step asks for millions.
"""

import warp as wp

from warpgrasp.core.dtypes import ONE, ZERO, greater, mat33, real, struct, transform, vec3

wp.set_module_options({"max_unroll": 1})
_SURE = wp.constant(real(0.97))
_ON_TABLE = wp.constant(real(0.0005))  # [m]


@struct
class _Frame:
    """From the hand's frame to cells."""

    turn: mat33
    place: vec3
    n: wp.vec3i
    table: real
    """Height [cells] below which a ball is stopped by the table."""
    lowest: real
    """Height below which a touch is taken for the table's."""


@wp.func
def _frame(pose: transform, corner: vec3, size: real, n: wp.vec3i, radius: real, lowest: real):
    frame = _Frame()
    frame.turn = wp.quat_to_matrix(wp.transform_get_rotation(pose)) / size
    frame.place = (wp.transform_get_translation(pose) - corner) / size
    frame.n = n
    frame.table = (radius - corner[2]) / size
    frame.lowest = (lowest - corner[2]) / size
    return frame


@wp.func
def _number(u: vec3, n: wp.vec3i):
    """Number of the cell at `u`, -1 outside the grid."""
    if u[0] < ZERO or u[1] < ZERO or u[2] < ZERO:
        return int(-1)
    i, j, k = int(u[0]), int(u[1]), int(u[2])
    if i >= n[0] or j >= n[1] or k >= n[2]:
        return int(-1)
    return (i * n[1] + j) * n[2] + k


@struct
class _Walk:
    """How far a finger has been followed."""

    most: real
    """Probability that it was stopped by then."""
    gain: real
    best: real
    place: vec3
    """Where the touch of the greatest worth is likeliest [cells]."""
    done: wp.bool


@wp.func
def _followed(
    walk: _Walk, frame: _Frame, w: int, finger: int, begin: int, end: int, share: real,
    swept_ball: wp.array3d[vec3], feels: wp.array2d[wp.bool], chance: wp.array2d[wp.float32],
    worth: wp.array2d[wp.float32]
):
    """A finger followed from one place of its path to another; it comes there with probability
    `share`."""
    s = int(begin)
    while s < end and not walk.done:
        for b in range(swept_ball.shape[2]):
            u = frame.turn @ swept_ball[finger, s, b] + frame.place
            if u[2] < frame.table:
                walk.done = True
            elif not walk.done:
                at = _number(u, frame.n)
                if at >= 0:
                    now = real(chance[w, at])
                    if now > walk.most:
                        value = ZERO
                        if u[2] > frame.lowest and feels[finger, b]:
                            value = share * (now - walk.most) * real(worth[w, at])
                        walk.gain += value
                        if value > walk.best:
                            walk.best = value
                            walk.place = u
                        walk.most = now
        if walk.most > _SURE:
            walk.done = True
        s += 1
    return walk


@wp.kernel(enable_backward=False)
def foresee_kernel(
    first: int,
    corner: wp.array[vec3],
    cell: wp.array[real],
    n: wp.vec3i,
    radius: real,
    lowest: real,
    open_ball: wp.array[vec3],
    swept_ball: wp.array3d[vec3],
    feels: wp.array2d[wp.bool],
    met: wp.array[int],
    meets: wp.array[int],
    hand_pose: wp.array2d[transform],
    wanted: wp.array2d[wp.bool],
    chance: wp.array2d[wp.float32],
    worth: wp.array2d[wp.float32],
    barred: wp.array2d[real],
    gain: wp.array3d[real],
    place: wp.array3d[vec3],
    stopped: wp.array3d[real],
):
    """The probability that a pose is barred, and for each finger the expected worth of its touch
    and the likeliest place of it. Probabilities along a path are those of one uncertain surface:
    that a finger was stopped by then is the greatest of all cells met so far. From its place `met`
    on a finger is stopped by the hand itself, unless the finger that it `meets` there was `stopped`
    before."""
    w, p = wp.tid()
    w += first
    barred[w, p] = ONE
    for finger in range(met.shape[0]):
        stopped[w, p, finger] = ZERO
        gain[w, p, finger] = ZERO
        place[w, p, finger] = vec3(ZERO, ZERO, ZERO)
    if not wanted[w, p]:
        return
    c, size = corner[w], cell[w]
    frame = _frame(hand_pose[w, p], c, size, n, radius - _ON_TABLE, lowest)
    floor = (radius - c[2]) / size
    start = ZERO
    for b in range(open_ball.shape[0]):
        u = frame.turn @ open_ball[b] + frame.place
        if u[2] < floor:
            return
        at = _number(u, n)
        if at >= 0:
            start = greater(start, real(chance[w, at]))
            if start > _SURE:
                return
    barred[w, p] = start
    for again in range(2):
        for finger in range(met.shape[0]):
            if again == 0 and meets[finger] < 0:
                continue
            walk = _Walk()
            walk.most = start
            walk = _followed(walk, frame, w, finger, 0, met[finger], ONE, swept_ball, feels, chance,
                             worth)
            if again == 0:
                stopped[w, p, finger] = walk.most
            else:
                if meets[finger] >= 0:
                    walk = _followed(walk, frame, w, finger, met[finger], swept_ball.shape[1],
                                     stopped[w, p, meets[finger]], swept_ball, feels, chance,
                                     worth)
                gain[w, p, finger] = walk.gain
                place[w, p, finger] = c + walk.place * size
