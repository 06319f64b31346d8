// A splat in the camera's coordinates and its covariance on the image (EWA splatting, Zwicker et al.
// 2001, as in Kerbl et al. 2023); what both ways of the projection share. LANES splats at a time.
#pragma once

#include "engine.h"
#include "rows.h"
#include "splats/sh.h"
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
    g.in_front = (g.local[2] > c.conventions.near_plane) & (g.local[2] < c.conventions.far_plane);
    g.z = g.in_front ? g.local[2] : all(1.0f);

    const F norm2 = quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3];
    // a quaternion without length stands for no rotation, and has no gradient
    g.q_scale = keep(1.0f / sqrt(max(norm2, all(1e-30f))), norm2 > 1e-24f);
    for (int i = 0; i < 4; ++i) g.q[i] = quat[i] * g.q_scale;
    rotation_of(g.q, g.r);
    const F limit = all(c.conventions.activated ? SCALE_LIMIT : LOG_SCALE_LIMIT);
    for (int j = 0; j < 3; ++j) {
        g.scale[j] = min(max(log_scale[j], -limit), limit);
        if (!c.conventions.activated) g.scale[j] = exp_accurate(g.scale[j]);
    }

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
MATTGS_INLINE Covariance covariance_of(const Geometry& g, const Camera& c) {
    const double low_pass = c.conventions.low_pass;
    Covariance v;
    D m[2][3];
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 3; ++j) m[i][j] = __builtin_convertvector(g.m[i][j], D);
    v.xx = m[0][0] * m[0][0] + m[0][1] * m[0][1] + m[0][2] * m[0][2] + low_pass;
    v.xy = m[0][0] * m[1][0] + m[0][1] * m[1][1] + m[0][2] * m[1][2];
    v.yy = m[1][0] * m[1][0] + m[1][1] * m[1][1] + m[1][2] * m[1][2] + low_pass;
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

MATTGS_INLINE F sigmoid(F x) { return 1.0f / (1.0f + exp_accurate(-x)); }

MATTGS_INLINE int lanes_left(int64_t first, int64_t end) {
    return end - first < LANES ? (int)(end - first) : LANES;
}

// Asks for splats [n, n + LANES): they come in more streams than hardware prefetchers follow.
template <class T>
MATTGS_INLINE void prefetch_splats(const SplatArrays<T>& s, int degree, int64_t n) {
    if (n + LANES > s.count) return;
    prefetch_floats(s.means + 3 * n, 3 * LANES);
    prefetch_floats(s.log_scales + 3 * n, 3 * LANES);
    prefetch_floats(s.quaternions + 4 * n, 4 * LANES);
    prefetch_floats(s.opacity_logits + n, LANES);
    prefetch_floats(s.sh_dc + 3 * n, 3 * LANES);
    if (degree > 0) prefetch_floats(s.sh_rest + 3 * SH_REST * n, 3 * SH_REST * LANES);
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

}  // namespace
}  // namespace MATTGS_ISA
}  // namespace mattgs
