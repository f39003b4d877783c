"""A chain at several sets of drives side by side, in C++ (`core.lanes`): as `chain_kernel`.

The text begins the body of a `wp.func_native` that has `joint`, a row of joints of any finger.
"""

from math import factorial

from warpgrasp.chain.chain_kernel import JOINTS
from warpgrasp.core.lanes import lanes_begin, polynomial

_TERMS = 11
"""Of the series of sine and cosine of a quarter of a joint's angle, up to 1.6 rad."""
_ALTERNATES = [(-1.0) ** k for k in range(_TERMS)]
_SINE = polynomial("rr", [s / factorial(2 * k + 1) for k, s in enumerate(_ALTERNATES)])
_COSINE = polynomial("rr", [s / factorial(2 * k) for k, s in enumerate(_ALTERNATES)])

CHAIN_LANES = (lanes_begin() + """
    enum { J = JOINTS };
    const reals none = 0.0;
    struct quats { reals x, y, z, w; };
    auto times = [](quats a, quats b) {
        return quats{a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                     a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
                     a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
                     a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z}; };
    auto turn_everywhere = [](const wp::quatd& q) {
        return quats{(reals)q.x, (reals)q.y, (reals)q.z, (reals)q.w}; };
    auto placed = [&](places at, quats q, const wp::vec3d& v) {
        const places u = {q.x, q.y, q.z}, p = everywhere(v), t = cross(u, p);
        const places twice = {t.x + t.x, t.y + t.y, t.z + t.z};
        return along(along(along(at, none + 1.0, p), q.w, twice), none + 1.0, cross(u, twice)); };
    struct frames { places at; quats turn; };
    struct poses { places at[J], axis[J]; quats turn[J]; };

    // `chain_pose`
    auto posed = [&](const auto& hand, const reals* q, frames base, poses& f) {
        const auto* rows = (decltype(joint.data))hand.joints;
        for (int j = 0; j < hand.joint_count; ++j) {
            const auto& row = rows[j];
            base.at = placed(base.at, base.turn, row.place.p);
            base.turn = times(base.turn, turn_everywhere(row.place.q));
            const reals r = (q[row.drive] * row.factor + row.shift) * 0.25, rr = r * r;
            const reals s = r * SINE, c = COSINE, sine = 2.0 * s * c;
            f.at[j] = base.at;
            f.axis[j] = placed(places{none, none, none}, base.turn, row.axis);
            base.turn = times(base.turn, quats{sine * row.axis[0], sine * row.axis[1],
                                               sine * row.axis[2], 1.0 - 2.0 * s * s});
            f.turn[j] = base.turn;
        }
    };
    // `chain_free_joints`, into q
    auto rest_freely = [&](const auto& hand, const reals* command, frames base, wp::vec3d up,
                           reals* q) {
        poses f;
        const auto* rows = (decltype(joint.data))hand.joints;
        for (int d = 0; d < J; ++d)
            q[d] = command[d];
        for (int again = 0; again < (hand.weighs ? 2 : 0); ++again) {
            posed(hand, q, base, f);
            reals torque[J] = {};
            places moment = {none, none, none};
            double carried = 0.0;
            for (int j = hand.joint_count - 1; j >= 0; --j) {
                carried += rows[j].weight;
                moment = along(moment, none + rows[j].weight,
                               placed(f.at[j], f.turn[j], rows[j].centre));
                const places arm = along(moment, none - carried, f.at[j]);
                torque[rows[j].drive] -=
                    rows[j].factor * dot(cross(f.axis[j], arm), everywhere(up));
            }
            for (int d = 0; d < hand.drives; ++d)
                q[d] = command[d] + torque[d] / hand.stiffness[d];
        }
        for (int d = 0; d < hand.drives && hand.stop > 0.0; ++d) {
            const reals past = q[d] - less(more(q[d], none + hand.low[d]), none + hand.high[d]);
            q[d] -= past * (hand.stop / (hand.stop + hand.stiffness[d]));
        }
    };
""").replace("JOINTS", str(JOINTS)).replace("COSINE", _COSINE).replace("SINE", _SINE)
