// Projection of splats to the image (EWA splatting, Zwicker et al. 2001, as in Kerbl et al. 2023),
// view-dependent colour, and the gradients of both. LANES splats at a time.
#include "engine.h"
#include "kernels.h"
#include "sh.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

struct Geometry {
    F local[3];              // mean in camera coordinates
    F z;                     // local[2], or 1 where the splat is not in front
    I in_front;
    F q[4], q_scale;         // unit quaternion; 1 / its length before
    F r[3][3];               // its rotation matrix
    F scale[3];
    F ratio[2];              // x/z and y/z as clamped for the Jacobian
    I unclamped[2];
    F a[2][3];               // rows of Jacobian times world-to-camera rotation
    F m[2][3];               // a * r * diag(scale): the 2D covariance is m m^T + low pass
};

MATTGS_INLINE void rotation_of(const F q[4], F r[3][3]) {
    const F w = q[0], x = q[1], y = q[2], z = q[3];
    r[0][0] = 1.0f - 2.0f * (y * y + z * z);
    r[0][1] = 2.0f * (x * y - w * z);
    r[0][2] = 2.0f * (x * z + w * y);
    r[1][0] = 2.0f * (x * y + w * z);
    r[1][1] = 1.0f - 2.0f * (x * x + z * z);
    r[1][2] = 2.0f * (y * z - w * x);
    r[2][0] = 2.0f * (x * z - w * y);
    r[2][1] = 2.0f * (y * z + w * x);
    r[2][2] = 1.0f - 2.0f * (x * x + y * y);
}

MATTGS_INLINE Geometry geometry_of(const F mean[3], const F log_scale[3], const F quat[4],
                                   const Camera& c) {
    Geometry g;
    const float* w = c.rotation;
    for (int i = 0; i < 3; ++i)
        g.local[i] = w[3 * i] * mean[0] + w[3 * i + 1] * mean[1] + w[3 * i + 2] * mean[2] +
                     c.translation[i];
    g.in_front = g.local[2] > NEAR_PLANE;
    g.z = g.in_front ? g.local[2] : all(1.0f);

    const F norm2 = quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3];
    // a quaternion without length stands for no rotation, and has no gradient
    g.q_scale = keep(1.0f / sqrt(max(norm2, all(1e-30f))), norm2 > 1e-24f);
    for (int i = 0; i < 4; ++i) g.q[i] = quat[i] * g.q_scale;
    rotation_of(g.q, g.r);
    for (int j = 0; j < 3; ++j)
        g.scale[j] =
            exp_accurate(min(max(log_scale[j], all(-LOG_SCALE_LIMIT)), all(LOG_SCALE_LIMIT)));

    const float focal[2] = {c.fx, c.fy};
    const float low[2] = {c.x_low, c.y_low}, high[2] = {c.x_high, c.y_high};
    for (int i = 0; i < 2; ++i) {
        const F ratio = g.local[i] / g.z;
        g.unclamped[i] = (ratio >= low[i]) & (ratio <= high[i]);
        g.ratio[i] = min(max(ratio, all(low[i])), all(high[i]));
        for (int j = 0; j < 3; ++j)
            g.a[i][j] = focal[i] / g.z * (w[3 * i + j] - g.ratio[i] * w[6 + j]);
        for (int j = 0; j < 3; ++j)
            g.m[i][j] = g.scale[j] * (g.a[i][0] * g.r[0][j] + g.a[i][1] * g.r[1][j] +
                                      g.a[i][2] * g.r[2][j]);
    }
    return g;
}

struct Covariance {
    D xx, xy, yy, det;
};

// In double: det is a difference of nearly equal products when the splat is a needle.
MATTGS_INLINE Covariance covariance_of(const Geometry& g) {
    Covariance v;
    D m[2][3];
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 3; ++j) m[i][j] = __builtin_convertvector(g.m[i][j], D);
    v.xx = m[0][0] * m[0][0] + m[0][1] * m[0][1] + m[0][2] * m[0][2] + (double)LOW_PASS;
    v.xy = m[0][0] * m[1][0] + m[0][1] * m[1][1] + m[0][2] * m[1][2];
    v.yy = m[1][0] * m[1][0] + m[1][1] * m[1][1] + m[1][2] * m[1][2] + (double)LOW_PASS;
    v.det = v.xx * v.yy - v.xy * v.xy;
    return v;
}

MATTGS_INLINE F narrow(D v) { return __builtin_convertvector(v, F); }

MATTGS_INLINE F view_direction(const F mean[3], const Camera& c, F d[3]) {
    for (int i = 0; i < 3; ++i) d[i] = mean[i] - c.centre[i];
    const F inverse = 1.0f / sqrt(max(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], all(1e-30f)));
    for (int i = 0; i < 3; ++i) d[i] *= inverse;
    return inverse;
}

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

MATTGS_INLINE F sigmoid(F x) { return 1.0f / (1.0f + exp_accurate(-x)); }

MATTGS_INLINE int lanes_left(int64_t first, int64_t end) {
    return end - first < LANES ? (int)(end - first) : LANES;
}

struct Inputs {
    F mean[3], log_scale[3], quat[4], logit;
};

MATTGS_INLINE Inputs read_inputs(const SplatArrays<const float>& s, int64_t first, int64_t end) {
    Inputs in;
    const int lanes = lanes_left(first, end);
    gather_rows<3>(s.means + 3 * first, lanes, in.mean);
    gather_rows<3>(s.log_scales + 3 * first, lanes, in.log_scale);
    gather_rows<4>(s.quaternions + 4 * first, lanes, in.quat);
    gather_rows<1>(s.opacity_logits + first, lanes, &in.logit);
    return in;
}

MATTGS_INLINE I not_finite(const Inputs& in) {
    F zero = in.logit * 0.0f;  // NaN unless finite
    for (int i = 0; i < 3; ++i) zero += in.mean[i] * 0.0f + in.log_scale[i] * 0.0f;
    for (int i = 0; i < 4; ++i) zero += in.quat[i] * 0.0f;
    return zero != zero;
}

// Colours before the clamp at 0: SH + 1/2.
MATTGS_INLINE void colours_of(const SplatArrays<const float>& s, const F b[15], int degree,
                              int64_t first, int64_t end, F rest[45], F colour[3]) {
    const int lanes = lanes_left(first, end);
    F dc[3];
    gather_rows<3>(s.sh_dc + 3 * first, lanes, dc);
    for (int c = 0; c < 3; ++c) colour[c] = SH_0 * dc[c] + 0.5f;
    if (degree == 0) return;
    gather_rows<45>(s.sh_rest + 45 * first, lanes, rest);
    for (int k = 0; k < (degree + 1) * (degree + 1) - 1; ++k)
        for (int c = 0; c < 3; ++c) colour[c] += b[k] * rest[3 * k + c];
}

}  // namespace

int64_t project(const SplatArrays<const float>& s, const Camera& c, int degree, int64_t first,
                int64_t last, Projected* out, float* depths, float* radii, float* means2d) {
    int64_t bad = 0;
    for (int64_t n = first; n < last; n += LANES) {
        const int lanes = lanes_left(n, last);
        const Inputs in = read_inputs(s, n, last);
        const I broken = not_finite(in);
        for (int i = 0; i < lanes; ++i) bad -= broken[i];

        const Geometry g = geometry_of(in.mean, in.log_scale, in.quat, c);
        const Covariance v = covariance_of(g);
        const F x = c.fx * g.local[0] / g.z + c.cx, y = c.fy * g.local[1] / g.z + c.cy;
        const F peak = log2_of(sigmoid(in.logit));
        const F level = max(peak - LOG2_ALPHA_MIN, F{});
        const F xx = narrow(v.xx), yy = narrow(v.yy);
        const F extent_x = sqrt(level * (1.0f / HALF_LOG2E) * xx);
        const F extent_y = sqrt(level * (1.0f / HALF_LOG2E) * yy);
        const I visible = ~broken & g.in_front & (peak >= LOG2_ALPHA_MIN) & (x + extent_x > 0.0f) &
                          (x - extent_x < (float)c.width) & (y + extent_y > 0.0f) &
                          (y - extent_y < (float)c.height);
        for (int i = 0; i < lanes; ++i) {
            means2d[2 * (n + i)] = g.in_front[i] ? x[i] : 0.0f;
            means2d[2 * (n + i) + 1] = g.in_front[i] ? y[i] : 0.0f;
            depths[n + i] = visible[i] ? g.z[i] : 0.0f;
            radii[n + i] = 0.0f;
        }
        if (!any(visible)) continue;

        F d[3], b[15], rest[45], colour[3];
        view_direction(in.mean, c, d);
        sh_basis(d, degree, b);
        colours_of(s, b, degree, n, last, rest, colour);
        const I no_colour = (colour[0] + colour[1] + colour[2]) * 0.0f != F{};
        for (int i = 0; i < lanes; ++i) bad += no_colour[i] && visible[i] ? 1 : 0;
        for (int k = 0; k < 3; ++k) colour[k] = max(colour[k], F{});

        const F sx = sqrt(narrow((double)HALF_LOG2E * v.yy / v.det));
        const F sy = sx * narrow(-v.xy / v.yy);
        const F fall = narrow((double)HALF_LOG2E / v.yy);
        const F middle = 0.5f * (xx + yy);
        const F half_gap = sqrt(max(middle * middle - narrow(v.det), all(0.1f)));
        const F radius = 3.0f * sqrt(middle + half_gap);
        const I broad = (sx <= BROAD) & (extent_x < FAR_TOO_BIG) & (extent_y < FAR_TOO_BIG);
        const F curve = broad ? exp2_fine<F, U>(-2.0f * (sy * sy + fall)) : all(-1.0f);
        for (int i = 0; i < lanes; ++i) {
            if (!visible[i]) continue;
            out[n + i] = Projected{x[i],         y[i],         sx[i],        sy[i],
                                   fall[i],      peak[i],      colour[0][i], colour[1][i],
                                   colour[2][i], extent_x[i],  extent_y[i],  curve[i]};
            radii[n + i] = __builtin_ceilf(radius[i] < 1e30f ? radius[i] : 1e30f);
        }
    }
    return bad;
}

namespace {

// Sums of the pairs of LANES splats, one vector per slot; always added in the same order.
MATTGS_INLINE void sum_slots(const SplatSums& in, int64_t n, int lanes, F sums[SLOT_SIZE]) {
    alignas(64) float rows[LANES][SLOT_SIZE];
    const int size = in.statistics ? SLOT_SIZE : SLOT_SIZE_PLAIN;
    const float* slot = in.slots + (int64_t)in.first_slot[n] * size;
    for (int i = 0; i < LANES; ++i) {
        const uint32_t count = i < lanes ? in.pairs[n + i] : 0;
        F8 low = {}, high = {};
        for (uint32_t k = 0; k < count; ++k, slot += size) {
            low += *reinterpret_cast<const FU8*>(slot);
            // a plain slot ends four floats earlier: what follows is the next one's, and unused
            high += *reinterpret_cast<const FU8*>(slot + 8);
        }
        __builtin_memcpy(rows[i], &low, 32);
        __builtin_memcpy(rows[i] + 8, &high, 32);
    }
    gather_rows<SLOT_SIZE>(rows[0], LANES, sums);
}

MATTGS_INLINE void rotation_gradient(const F q[4], F q_scale, const F g[3][3], F out[4]) {
    const F w = q[0], x = q[1], y = q[2], z = q[3];
    F d[4];
    d[0] = z * (g[1][0] - g[0][1]) + y * (g[0][2] - g[2][0]) + x * (g[2][1] - g[1][2]);
    d[1] = y * (g[0][1] + g[1][0]) + z * (g[0][2] + g[2][0]) + w * (g[2][1] - g[1][2]) -
           2.0f * x * (g[1][1] + g[2][2]);
    d[2] = x * (g[0][1] + g[1][0]) + w * (g[0][2] - g[2][0]) + z * (g[1][2] + g[2][1]) -
           2.0f * y * (g[0][0] + g[2][2]);
    d[3] = w * (g[1][0] - g[0][1]) + x * (g[0][2] + g[2][0]) + y * (g[1][2] + g[2][1]) -
           2.0f * z * (g[0][0] + g[1][1]);
    const F along = w * d[0] + x * d[1] + y * d[2] + z * d[3];
    for (int i = 0; i < 4; ++i) out[i] = 2.0f * q_scale * (d[i] - q[i] * along);
}

struct Gradients2d {
    F x, y, xx, xy, yy;  // of the mean and of the covariance, xy as one variable
};

// From sums over pixels to the gradient of what project() wrote; see Projected.
MATTGS_INLINE Gradients2d gradients_2d(const F sums[SLOT_SIZE], const Covariance& v) {
    const F yy = narrow(v.yy), k = narrow(-v.xy / v.yy);
    const F schur = narrow(v.det / v.yy);
    const F sx = sqrt(HALF_LOG2E / schur), fall = HALF_LOG2E / yy;
    Gradients2d g;
    g.x = 2.0f * LN2 * sx * sums[SUM_QU];
    g.y = 2.0f * LN2 * (sx * k * sums[SUM_QU] + fall * sums[SUM_QY]);
    const F d_schur = LN2 * sums[SUM_QUU] / schur;
    const F d_k = -2.0f * LN2 * sx * sums[SUM_QUY];
    const F d_fall = -LN2 * sums[SUM_QYY];
    g.xx = d_schur;
    g.xy = 2.0f * k * d_schur - d_k / yy;
    g.yy = k * k * d_schur - (d_k * k + d_fall * fall) / yy;
    return g;
}

struct Gradients3d {
    F mean[3], log_scale[3], quat[4];
};

MATTGS_INLINE Gradients3d gradients_3d(const Geometry& g, const Gradients2d& d,
                                       const F log_scale[3], const Camera& c) {
    Gradients3d out;
    F dm[2][3], da[2][3], dr[3][3];
    for (int j = 0; j < 3; ++j) {
        dm[0][j] = 2.0f * d.xx * g.m[0][j] + d.xy * g.m[1][j];
        dm[1][j] = 2.0f * d.yy * g.m[1][j] + d.xy * g.m[0][j];
        const F inside = dm[0][j] * g.m[0][j] + dm[1][j] * g.m[1][j];
        out.log_scale[j] = keep(inside, abs(log_scale[j]) <= LOG_SCALE_LIMIT);
    }
    for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 3; ++i)
            dr[i][j] = g.scale[j] * (dm[0][j] * g.a[0][i] + dm[1][j] * g.a[1][i]);
    rotation_gradient(g.q, g.q_scale, dr, out.quat);

    const float* w = c.rotation;
    const float focal[2] = {c.fx, c.fy};
    const F d2[2] = {d.x, d.y};
    F local[3] = {F{}, F{}, F{}};
    for (int i = 0; i < 2; ++i) {
        for (int k = 0; k < 3; ++k)
            da[i][k] = dm[i][0] * g.scale[0] * g.r[k][0] + dm[i][1] * g.scale[1] * g.r[k][1] +
                       dm[i][2] * g.scale[2] * g.r[k][2];
        const F f = focal[i] / g.z;
        const F d_ratio = keep(-f * (da[i][0] * w[6] + da[i][1] * w[7] + da[i][2] * w[8]),
                               g.unclamped[i]);
        const F along = da[i][0] * g.a[i][0] + da[i][1] * g.a[i][1] + da[i][2] * g.a[i][2];
        const F d_position = d_ratio / g.z + d2[i] * f;
        local[i] = d_position;
        local[2] -= along / g.z + d_position * (g.local[i] / g.z);
    }
    for (int k = 0; k < 3; ++k)
        out.mean[k] = w[k] * local[0] + w[3 + k] * local[1] + w[6 + k] * local[2];
    return out;
}

// Adds the gradient through the viewing direction to d_mean; writes dc and rest.
MATTGS_INLINE void colour_gradient(const SplatArrays<const float>& s, const Camera& c, int degree,
                                   int64_t n, int64_t last, const F mean[3], const F sums[],
                                   I visible, F d_mean[3], F d_dc[3], F d_rest[45]) {
    F d[3], b[15], rest[45], colour[3], grad[3];
    const F inverse = view_direction(mean, c, d);
    sh_basis(d, degree, b);
    colours_of(s, b, degree, n, last, rest, colour);
    for (int k = 0; k < 3; ++k) {
        grad[k] = keep(sums[SUM_RED + k], (colour[k] > 0.0f) & visible);
        d_dc[k] = SH_0 * grad[k];
    }
    for (int k = 0; k < 15; ++k)
        for (int j = 0; j < 3; ++j) d_rest[3 * k + j] = b[k] * grad[j];
    if (degree == 0) return;
    F e[15], g[3];
    for (int k = 0; k < 15; ++k)
        e[k] = rest[3 * k] * grad[0] + rest[3 * k + 1] * grad[1] + rest[3 * k + 2] * grad[2];
    sh_basis_gradient(d, degree, e, g);
    const F along = g[0] * d[0] + g[1] * d[1] + g[2] * d[2];
    for (int k = 0; k < 3; ++k) d_mean[k] += inverse * (g[k] - d[k] * along);
}

}  // namespace

void project_backward(const SplatArrays<const float>& s, const Camera& c, int degree,
                      int64_t first, int64_t last, const SplatSums& in,
                      const SplatGradients& to) {
    const SplatArrays<float>& out = to.parameters;
    for (int64_t n = first; n < last; n += LANES) {
        const int lanes = lanes_left(n, last);
        I visible = I{};
        for (int i = 0; i < lanes; ++i) visible[i] = in.pairs[n + i] ? -1 : 0;
        F sums[SLOT_SIZE], d_rest[45], d_dc[3], d_logit = F{}, d2[2] = {F{}, F{}};
        Gradients3d d = {};
        if (any(visible)) {
            sum_slots(in, n, lanes, sums);
            const Inputs splat = read_inputs(s, n, last);
            const Geometry g = geometry_of(splat.mean, splat.log_scale, splat.quat, c);
            const Covariance v = covariance_of(g);
            const Gradients2d flat = gradients_2d(sums, v);
            d = gradients_3d(g, flat, splat.log_scale, c);
            colour_gradient(s, c, degree, n, last, splat.mean, sums, visible, d.mean, d_dc, d_rest);
            d_logit = keep(sums[SUM_Q] * (1.0f - sigmoid(splat.logit)), visible);
            for (int k = 0; k < 3; ++k) {
                d.mean[k] = keep(d.mean[k], visible);
                d.log_scale[k] = keep(d.log_scale[k], visible);
            }
            for (int k = 0; k < 4; ++k) d.quat[k] = keep(d.quat[k], visible);
            d2[0] = keep(flat.x, visible);
            d2[1] = keep(flat.y, visible);
        } else {
            for (int k = 0; k < SLOT_SIZE; ++k) sums[k] = F{};
            for (int k = 0; k < 3; ++k) d_dc[k] = F{};
            for (int k = 0; k < 45; ++k) d_rest[k] = F{};
        }
        scatter_rows<3>(d.mean, out.means + 3 * n, lanes);
        scatter_rows<3>(d.log_scale, out.log_scales + 3 * n, lanes);
        scatter_rows<4>(d.quat, out.quaternions + 4 * n, lanes);
        scatter_rows<1>(&d_logit, out.opacity_logits + n, lanes);
        scatter_rows<3>(d_dc, out.sh_dc + 3 * n, lanes);
        scatter_rows<45>(d_rest, out.sh_rest + 45 * n, lanes);
        scatter_rows<2>(d2, to.means2d + 2 * n, lanes);
        if (!in.statistics) continue;
        const F absolute[2] = {2.0f * LN2 * sums[SUM_ABS_X], 2.0f * LN2 * sums[SUM_ABS_Y]};
        scatter_rows<2>(absolute, to.means2d_abs + 2 * n, lanes);
        scatter_rows<1>(&sums[SUM_W], to.weight + n, lanes);
        scatter_rows<1>(&sums[SUM_WMAP], to.weighted_map + n, lanes);
    }
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
