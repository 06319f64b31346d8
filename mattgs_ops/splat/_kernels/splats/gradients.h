// Gradients of LANES splats from their sums over pixels: the projection and the colour gone back.
#pragma once

#include "engine.h"
#include "splats/geometry.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

// Sums of the pairs of LANES splats, one vector per slot; always added in the same order.
MATTGS_INLINE void sum_slots(const SplatSums& in, int64_t n, int lanes, F sums[SLOT_SIZE]) {
    alignas(64) float rows[LANES][SLOT_SIZE];
    const int size = in.slot_size;
    const float* slot = in.slots + (int64_t)(in.of[n].end - in.of[n].count) * size;
    for (int i = 0; i < LANES; ++i) {
        const uint32_t count = i < lanes ? in.of[n + i].count : 0;
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

// Asks for the slots of the LANES splats after those from n on.
MATTGS_INLINE void prefetch_slots(const SplatSums& in, int64_t n, int64_t last) {
    if (n + 2 * LANES > last) return;
    const int size = in.slot_size;
    const int64_t from = in.of[n + LANES - 1].end, to = in.of[n + 2 * LANES - 1].end;
    prefetch_floats(in.slots + from * size, (to - from) * size);
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
    F local[3], a[2][3];  // of the mean in the camera, of the rows of Jacobian times rotation
};

MATTGS_INLINE Gradients3d gradients_3d(const Geometry& g, const Gradients2d& d,
                                       const F log_scale[3], const Camera& c) {
    Gradients3d out;
    const bool activated = c.conventions.activated;
    F dm[2][3], dr[3][3];
    auto& da = out.a;
    for (int j = 0; j < 3; ++j) {
        dm[0][j] = 2.0f * d.xx * g.m[0][j] + d.xy * g.m[1][j];
        dm[1][j] = 2.0f * d.yy * g.m[1][j] + d.xy * g.m[0][j];
        F inside = dm[0][j] * g.m[0][j] + dm[1][j] * g.m[1][j];
        if (activated) {  // the scale itself: m without it
            inside = F{};
            for (int k = 0; k < 3; ++k)
                inside += g.r[k][j] * (dm[0][j] * g.a[0][k] + dm[1][j] * g.a[1][k]);
        }
        out.log_scale[j] =
            keep(inside, abs(log_scale[j]) <= (activated ? SCALE_LIMIT : LOG_SCALE_LIMIT));
    }
    for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 3; ++i)
            dr[i][j] = g.scale[j] * (dm[0][j] * g.a[0][i] + dm[1][j] * g.a[1][i]);
    rotation_gradient(g.q, g.q_scale, dr, out.quat);

    const float* w = c.rotation;
    const float focal[2] = {c.fx, c.fy};
    const bool apart = c.conventions.centres_apart;
    const F d2[2] = {apart ? F{} : d.x, apart ? F{} : d.y};
    auto& local = out.local;
    for (int k = 0; k < 3; ++k) local[k] = F{};
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

constexpr int SH_FLOATS = 3 * SH_REST;
constexpr int SH_ROW = 16;  // floats of a row of basis functions, 15 and one more

// Gradients of LANES splats; those of sh_rest are the outer product of `basis` and `colour`.
struct Gradients {
    F mean[3], log_scale[3], quat[4], logit, dc[3], extra;
    F basis[SH_ROW], colour[3];
    F centre[2], sums[SLOT_SIZE];
};

MATTGS_INLINE void colour_gradient(const float* kept, const Camera& c, int degree,
                                   const F mean[3], I visible, Gradients& out) {
    F d[3];
    if (c.conventions.plain_colours) {
        for (int k = 0; k < 3; ++k) out.dc[k] = keep(out.sums[SUM_RED + k], visible);
        return;
    }
    for (int k = 0; k < 3; ++k) {
        out.colour[k] = keep(out.sums[SUM_RED + k], (load(kept + k * LANES) > 0.0f) & visible);
        out.dc[k] = SH_0 * out.colour[k];
    }
    view_direction(mean, c, d);
    sh_basis(d, degree, out.basis);
    out.basis[SH_ROW - 1] = F{};
    if (degree == 0) return;
    for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 3; ++k)
            out.mean[k] += load(kept + (3 + 3 * j + k) * LANES) * out.colour[j];
}

// What splats sum up to for the camera, one vector over splats a number.
struct CameraGradients {
    F rotation[9], translation[3], centre[3];

    // `direction`: dL/d mean by way of the direction of view.
    MATTGS_INLINE void add(const Gradients3d& d, const Geometry& g, const F mean[3],
                           const F direction[3], I visible, const Camera& c) {
        const float focal[2] = {c.fx, c.fy};
        for (int j = 0; j < 3; ++j) {
            F toward = F{};
            for (int i = 0; i < 2; ++i) {
                const F moved = focal[i] / g.z * d.a[i][j];
                rotation[3 * i + j] += keep(moved, visible);
                toward -= moved * g.ratio[i];
            }
            rotation[6 + j] += keep(toward, visible);
            for (int k = 0; k < 3; ++k) rotation[3 * k + j] += keep(d.local[k] * mean[j], visible);
            translation[j] += keep(d.local[j], visible);
            centre[j] -= keep(direction[j], visible);
        }
    }

    MATTGS_INLINE void sum_up(double to[CAMERA_SUMS]) const {
        const auto put = [&](int at, F v) {
            to[at] = 0.0;
            for (int i = 0; i < LANES; ++i) to[at] += v[i];
        };
        for (int k = 0; k < 9; ++k) put(k, rotation[k]);
        for (int k = 0; k < 3; ++k) put(9 + k, translation[k]);
        for (int k = 0; k < 3; ++k) put(12 + k, centre[k]);
    }
};

// Of splats [n, n + lanes); all zero where none of them was seen.
MATTGS_INLINE Gradients gradients_of(const SplatArrays<const float>& s, const Camera& c, int degree,
                                     int64_t n, int64_t last, const SplatSums& in,
                                     CameraGradients* camera) {
    const int lanes = lanes_left(n, last);
    prefetch_slots(in, n, last);
    I visible = I{};
    for (int i = 0; i < lanes; ++i) visible[i] = in.of[n + i].count ? -1 : 0;
    if (!any(visible)) return Gradients{};
    Gradients out;
    sum_slots(in, n, lanes, out.sums);
    const Inputs splat = read_inputs(s, n, last);
    const Geometry g = geometry_of(splat.mean, splat.log_scale, splat.quat, c);
    const Gradients2d flat = gradients_2d(out.sums, covariance_of(g, c));
    const Gradients3d d = gradients_3d(g, flat, splat.log_scale, c);
    for (int k = 0; k < 3; ++k) out.mean[k] = d.mean[k];
    colour_gradient(in.colours + COLOUR_FLOATS * n, c, degree, splat.mean, visible, out);
    if (camera) {
        F direction[3];
        for (int k = 0; k < 3; ++k) direction[k] = out.mean[k] - d.mean[k];
        camera->add(d, g, splat.mean, direction, visible, c);
    }
    const F by_opacity = c.conventions.activated ? 1.0f / splat.logit : 1.0f - sigmoid(splat.logit);
    out.logit = keep(out.sums[SUM_Q] * by_opacity, visible);
    out.extra = keep(out.sums[SUM_EXTRA], visible);
    for (int k = 0; k < 3; ++k) {
        out.mean[k] = keep(out.mean[k], visible);
        out.log_scale[k] = keep(d.log_scale[k], visible);
    }
    for (int k = 0; k < 4; ++k) out.quat[k] = keep(d.quat[k], visible);
    out.centre[0] = keep(flat.x, visible);
    out.centre[1] = keep(flat.y, visible);
    return out;
}

}  // namespace
}  // namespace MATTGS_ISA
}  // namespace mattgs
