# type: ignore  # Warp functions, which type checkers cannot follow
"""The capsules of a free finger at eight steps of its path side by side, in C++ (`core.lanes`)."""

import warp as wp

from warpgrasp.chain.chain_kernel import CAPSULES, Chain, ChainCapsule, ChainJoint, vec6
from warpgrasp.chain.chain_lanes import CHAIN_LANES
from warpgrasp.core.dtypes import real, transform
from warpgrasp.core.lanes import LANES

capsules_at_steps = wp.types.matrix(shape=(6 * CAPSULES, LANES), dtype=real)
"""Both ends of each capsule's axis, coordinate by coordinate, a step a column."""

_FREE = CHAIN_LANES + """
    reals command[J], q[J];
    for (int l = 0; l < L; ++l) {
        const int step = begin + l * apart;
        const auto& led = wp::index(path, g, finger, step < last ? step : last);
        for (int d = 0; d < J; ++d)
            command[d][l] = led[d] - hand.offset[d];
    }
    const frames body = {everywhere(base.p), turn_everywhere(base.q)};
    poses at;
    rest_freely(hand, command, body, wp::vec3d(0.0, 0.0, 1.0), q);
    posed(hand, q, body, at);
    const auto* skin = (decltype(capsule.data))hand.capsules;
    wp::mat_t<6 * CAPSULES, L, double> found;
    for (int c = 0; c < hand.capsule_count; ++c) {
        const int j = skin[c].joint;
        const places ends[2] = {placed(at.at[j], at.turn[j], skin[c].start),
                                placed(at.at[j], at.turn[j], skin[c].end)};
        __builtin_memcpy(found.data[6 * c], ends, sizeof(ends));
    }
    return found;
#else
    return {};
#endif
""".replace("CAPSULES", str(CAPSULES))


@wp.func_native(_FREE)
def capsules_in_lanes(
    hand: Chain, joint: wp.array[ChainJoint], capsule: wp.array[ChainCapsule], base: transform,
    path: wp.array3d[vec6], g: int, finger: int, begin: int, apart: int, last: int,
) -> capsules_at_steps:
    """A free finger's capsules at steps from `begin` on, `apart`, `last` at most. `joint` and
    `capsule` are rows of any finger."""
