// Projection of splats to the image and view-dependent colour. LANES splats at a time.
#include "splats/geometry.h"
#include "kernels.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

// log2 of x > 0 (normal): exponent plus the series of atanh on [sqrt(1/2), sqrt(2)].
MATTGS_INLINE F log2_of(F x) {
    const I bits = (I)x;
    const I exponent = (bits - 0x3f3504f3) >> 23;  // sqrt(1/2) maps to exponent 0
    const F m = (F)((U)bits - ((U)exponent << 23));
    const F s = (m - 1.0f) / (m + 1.0f), t = s * s;
    F series = all(1.0f / 9.0f);
    series = series * t + 1.0f / 7.0f;
    series = series * t + 1.0f / 5.0f;
    series = series * t + 1.0f / 3.0f;
    series = series * t + 1.0f;
    return to_float(exponent) + 2.8853900817779268f * s * series;  // 2 / ln 2
}

MATTGS_INLINE I not_finite(const Inputs& in) {
    F zero = in.logit * 0.0f;  // NaN unless finite
    for (int i = 0; i < 3; ++i) zero += in.mean[i] * 0.0f + in.log_scale[i] * 0.0f;
    for (int i = 0; i < 4; ++i) zero += in.quat[i] * 0.0f;
    return zero != zero;
}

// Colours before the clamp at 0: SH + 1/2, or as they are.
MATTGS_INLINE void colours_of(const SplatArrays<const float>& s, const F b[15], int degree,
                              bool plain, int64_t first, int64_t end, F rest[45],
                              F colour[3]) {
    const int lanes = lanes_left(first, end);
    F dc[3];
    gather_rows<3>(s.sh_dc + 3 * first, lanes, dc);
    for (int c = 0; c < 3; ++c) colour[c] = plain ? dc[c] : SH_0 * dc[c] + 0.5f;
    if (plain || degree == 0) return;
    gather_rows<45>(s.sh_rest + 45 * first, lanes, rest);
    for (int k = 0; k < (degree + 1) * (degree + 1) - 1; ++k)
        for (int c = 0; c < 3; ++c) colour[c] += b[k] * rest[3 * k + c];
}

// Keeps for going back, which then need not read `rest` again: the colour, and the derivatives of
// red, green and blue by the mean through the direction of view (d, at 1 / inverse).
MATTGS_INLINE void keep_colours(const F colour[3], const F rest[45], const F d[3], F inverse,
                                int degree, float* to) {
    for (int c = 0; c < 3; ++c) store(to + c * LANES, colour[c]);
    if (degree == 0) return;
    for (int c = 0; c < 3; ++c) {
        F e[15], g[3];
        for (int k = 0; k < 15; ++k) e[k] = rest[3 * k + c];
        sh_basis_gradient(d, degree, e, g);
        const F along = g[0] * d[0] + g[1] * d[1] + g[2] * d[2];
        for (int k = 0; k < 3; ++k)
            store(to + (3 + 3 * c + k) * LANES, inverse * (g[k] - d[k] * along));
    }
}

// The values of lanes [0, count) to p.
MATTGS_INLINE void store_lanes(float* p, F v, int count) { scatter_rows<1>(&v, p, count); }

}  // namespace

int64_t project(const SplatArrays<const float>& s, const Camera& c, int degree, int64_t first,
                int64_t last, const ProjectOutputs& out) {
    const Conventions& asked = c.conventions;
    if (asked.plain_colours) degree = 0;
    int64_t bad = 0;
    for (int64_t n = first; n < last; n += LANES) {
        const int lanes = lanes_left(n, last);
        prefetch_splats(s, degree, n + LANES);
        const Inputs in = read_inputs(s, n, last);
        const I broken = not_finite(in);
        for (int i = 0; i < lanes; ++i) bad -= broken[i];

        const Geometry g = geometry_of(in.mean, in.log_scale, in.quat, c);
        const Covariance v = covariance_of(g, c);
        const F x = c.fx * g.local[0] / g.z + c.cx, y = c.fy * g.local[1] / g.z + c.cy;
        const F opacity = asked.activated ? max(in.logit, all(1e-30f)) : sigmoid(in.logit);
        const F peak = log2_of(opacity);
        const F level = max(peak - LOG2_ALPHA_MIN, F{});
        const F xx = narrow(v.xx), yy = narrow(v.yy);
        const F extent_x = sqrt(level * (1.0f / HALF_LOG2E) * xx);
        const F extent_y = sqrt(level * (1.0f / HALF_LOG2E) * yy);
        I visible = ~broken & g.in_front & (peak >= LOG2_ALPHA_MIN) & (x + extent_x > 0.0f) &
                    (x - extent_x < (float)c.width) & (y + extent_y > 0.0f) &
                    (y - extent_y < (float)c.height);
        const F extents[2] = {ceil(min(extent_x, all(EXTENT_LIMIT))),
                              ceil(min(extent_y, all(EXTENT_LIMIT)))};
        if (asked.radius_clip > 0.0f)
            visible &= (extents[0] > asked.radius_clip) | (extents[1] > asked.radius_clip);
        if (asked.low_pass == 0.0f) visible &= narrow(v.det) > 0.0f;
        if (out.extents) {
            const F kept[2] = {keep(extents[0], visible), keep(extents[1], visible)};
            scatter_rows<2>(kept, out.extents + 2 * n, lanes);
        }
        const F centre[2] = {keep(x, g.in_front), keep(y, g.in_front)};
        scatter_rows<2>(centre, out.means2d + 2 * n, lanes);
        store_lanes(out.depths + n, keep(g.z, visible), lanes);
        if (!any(visible)) {
            store_lanes(out.radii + n, F{}, lanes);
            continue;
        }

        F d[3], b[15], rest[45], colour[3];
        const F inverse = view_direction(in.mean, c, d);
        sh_basis(d, degree, b);
        colours_of(s, b, degree, asked.plain_colours, n, last, rest, colour);
        const I no_colour = (colour[0] + colour[1] + colour[2]) * 0.0f != F{};
        for (int i = 0; i < lanes; ++i) bad += no_colour[i] && visible[i] ? 1 : 0;
        const F least = all(asked.plain_colours ? -3e38f : 0.0f);
        if (out.colours && !asked.plain_colours)
            keep_colours(colour, rest, d, inverse, degree, out.colours + COLOUR_FLOATS * n);

        const F sx = sqrt(narrow((double)HALF_LOG2E * v.yy / v.det));
        const F sy = sx * narrow(-v.xy / v.yy);
        const F fall = narrow((double)HALF_LOG2E / v.yy);
        const F middle = 0.5f * (xx + yy);
        const F half_gap = sqrt(max(middle * middle - narrow(v.det), all(0.1f)));
        const F radius = 3.0f * sqrt(middle + half_gap);
        const I broad = (sx <= BROAD) & (extent_x < FAR_TOO_BIG) & (extent_y < FAR_TOO_BIG);
        const F curve = broad ? exp2_fine<F, U>(-2.0f * (sy * sy + fall)) : all(-1.0f);
        // as the fields of Projected; what is not visible is never read
        const F projected[12] = {x,
                                 y,
                                 sx,
                                 sy,
                                 fall,
                                 peak,
                                 max(colour[0], least),
                                 max(colour[1], least),
                                 max(colour[2], least),
                                 extent_x,
                                 extent_y,
                                 curve};
        scatter_rows<12>(projected, &out.projected[n].x, lanes);
        store_lanes(out.radii + n, keep(ceil(min(radius, all(1e30f))), visible), lanes);
    }
    return bad;
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
