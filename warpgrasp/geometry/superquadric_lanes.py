"""Straight superquadrics at several points side by side, in C++ (`core.lanes`).

The same formulas as `sdf_superquadric`, for one body without bend and `LANES` points in the
processor's vectors. A power is an exponential of a logarithm, both as series; four powers a point
cost a tenth of what a library's cost. The texts begin the body of a `wp.func_native` that has a
body as `s`, a `SuperquadricShape`: `SUPERQUADRIC_LANES` is in the body's frame,
`PLACED_SUPERQUADRIC_LANES` also has its `pose`.
"""

from warpgrasp.core.lanes import lanes_begin

SUPERQUADRIC_LANES = lanes_begin() + """
    const double tiny = 1e-12, thin = 0.02;
    auto gathered = [](const wp::vec3d* from, auto at) {
        places p;
        for (int l = 0; l < L; ++l) {
            const wp::vec3d& one = from[at(l)];
            p.x[l] = one[0];
            p.y[l] = one[1];
            p.z[l] = one[2];
        }
        return p;
    };
    auto power = [&](reals base, double exponent) {
        const reals y = more(binary_logarithm(more(base, (reals)tiny)) * exponent,
                             (reals)-1022.0);
        return base < tiny ? (reals)0.0 : power_of_two(y);
    };

    // `superquadric_gauge`. Of two that are compared the greater is one, and so are its powers.
    struct slopes { places by; reals value; };
    const double across_x = 1.0 / s.size[0], across_y = 1.0 / s.size[1], upwards = 1.0 / s.size[2];
    auto gauge = [&](places p) {
        const reals x = size_of(p.x) * across_x, y = size_of(p.y) * across_y;
        const reals z = size_of(p.z) * upwards;
        const flags wide = x >= y;
        const reals broad = more(wide ? x : y, (reals)tiny), most = more(broad, z);
        const reals narrow = (wide ? y : x) / broad, low = less(broad, z) / most;
        const flags beside = broad >= z;
        const reals of_narrow = power(narrow, 2.0 / s.e2), a = of_narrow + 1.0;
        const reals of_low = power(low, 2.0 / s.e1);
        const reals ring = (beside ? (reals)1.0 : of_low) * power(a, s.e2 / s.e1);
        const reals top = beside ? of_low : (reals)1.0;
        const reals total = ring + top, f = power(total, 0.5 * s.e1), common = f / total;
        // Slopes have powers less by one: quotients of those above.
        const reals side = common * ring / (beside ? a : a * more(low, (reals)tiny));
        const reals far = side * of_narrow / more(narrow, (reals)tiny);
        slopes g;
        g.by.x = (wide ? side : far) * across_x;
        g.by.y = (wide ? far : side) * across_y;
        g.by.z = common * (beside ? of_low / more(low, (reals)tiny) : (reals)1.0) * upwards;
        g.by.x = p.x < 0.0 ? -g.by.x : g.by.x;
        g.by.y = p.y < 0.0 ? -g.by.y : g.by.y;
        g.by.z = p.z < 0.0 ? -g.by.z : g.by.z;
        g.value = most * f;
        return g;
    };

    // `straighten`, `taper_and_bend` and `deformed_gradient` without a bend.
    struct sections { reals x, y; flags sloping_x, sloping_y; };
    auto sections_at = [&](reals z) {
        const reals height = less(more(z * upwards, (reals)-1.0), (reals)1.0);
        const reals x = s.kx * height + 1.0, y = s.ky * height + 1.0;
        const flags within = size_of(z) <= s.size[2];
        return sections{more(x, (reals)thin), more(y, (reals)thin),
                        (x >= thin) & within, (y >= thin) & within};
    };
    auto untapered = [&](places p) {
        const sections at = sections_at(p.z);
        return places{p.x / at.x, p.y / at.y, p.z};
    };
    auto tapered = [&](places p) {
        const sections at = sections_at(p.z);
        return places{p.x * at.x, p.y * at.y, p.z};
    };
    auto tapered_slopes = [&](places by, places p) {
        const sections at = sections_at(p.z);
        const reals x = 1.0 / at.x, y = 1.0 / at.y;
        places g = {by.x * x, by.y * y, by.z};
        g.z -= at.sloping_x ? g.x * p.x * x * (s.kx * upwards) : (reals)0.0;
        g.z -= at.sloping_y ? g.y * p.y * y * (s.ky * upwards) : (reals)0.0;
        return g;
    };

    // `sdf_superquadric_bound_grad`
    struct bounds { places normal; reals distance; };
    auto bound_at = [&](places p) {
        const slopes g = gauge(untapered(p));
        const places by = tapered_slopes(g.by, p);
        const reals slope = more(root(dot(by, by)), (reals)tiny);
        const reals distance = (g.value - 1.0) / slope, past = size_of(p.z) - s.size[2];
        const flags beyond = past > more(distance, (reals)0.0);
        const reals none = 0.0, up = p.z < 0.0 ? none - 1.0 : none + 1.0;
        return bounds{{beyond ? none : by.x / slope, beyond ? none : by.y / slope,
                       beyond ? up : by.z / slope}, beyond ? past : distance};
    };
"""
PLACED_SUPERQUADRIC_LANES = SUPERQUADRIC_LANES + """
    const wp::mat33d turn = wp::quat_to_matrix(pose.q);
    auto turned = [&](places a) {
        return places{turn.data[0][0] * a.x + turn.data[0][1] * a.y + turn.data[0][2] * a.z,
                      turn.data[1][0] * a.x + turn.data[1][1] * a.y + turn.data[1][2] * a.z,
                      turn.data[2][0] * a.x + turn.data[2][1] * a.y + turn.data[2][2] * a.z};
    };
    auto turned_back = [&](places a) {
        return places{turn.data[0][0] * a.x + turn.data[1][0] * a.y + turn.data[2][0] * a.z,
                      turn.data[0][1] * a.x + turn.data[1][1] * a.y + turn.data[2][1] * a.z,
                      turn.data[0][2] * a.x + turn.data[1][2] * a.y + turn.data[2][2] * a.z};
    };
    auto in_frame = [&](places a) {
        return turned_back(places{a.x - pose.p[0], a.y - pose.p[1], a.z - pose.p[2]}); };
"""
