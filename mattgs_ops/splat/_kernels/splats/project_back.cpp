// What becomes of the splats' gradients: they are written out, or Adam uses them at once.
#include "kernels.h"
#include "splats/adam.h"
#include "splats/gradients.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

MATTGS_INLINE void write_statistics(const Gradients& g, bool all_of_them, int64_t n, int lanes,
                                    const SplatStatistics& to) {
    scatter_rows<2>(g.centre, to.means2d + 2 * n, lanes);
    if (!all_of_them) return;
    const F absolute[2] = {2.0f * LN2 * g.sums[SUM_ABS_X], 2.0f * LN2 * g.sums[SUM_ABS_Y]};
    scatter_rows<2>(absolute, to.means2d_abs + 2 * n, lanes);
    scatter_rows<1>(&g.sums[SUM_W], to.weight + n, lanes);
    scatter_rows<1>(&g.sums[SUM_WMAP], to.weighted_map + n, lanes);
}

// The gradients of sh_rest, [LANES][45]; writes one float beyond.
MATTGS_INLINE void write_rest(const Gradients& g, float* to) {
    alignas(64) float basis[LANES][SH_ROW], colour[LANES * 3 + 1];
    scatter_rows<SH_ROW>(g.basis, basis[0], LANES);
    scatter_rows<3>(g.colour, colour, LANES);
    for (int i = 0; i < LANES; ++i, to += SH_FLOATS) {
        F4 one;
        __builtin_memcpy(&one, colour + 3 * i, 16);
        const F8 c = MATTGS_SHUFFLE(one, one, 0, 1, 2, 0, 1, 2, 0, 1);
        const F8 d = MATTGS_SHUFFLE(one, one, 2, 0, 1, 2, 0, 1, 2, 0);
        // fifteen floats at a time, five functions by three channels; the sixteenth is overwritten
        for (int k = 0; k < SH_REST; k += 5) {
            const F8 b = *reinterpret_cast<const FU8*>(k < 10 ? basis[i] + k : basis[i] + 8);
            const F8 low = k < 10 ? MATTGS_SHUFFLE(b, b, 0, 0, 0, 1, 1, 1, 2, 2)
                                  : MATTGS_SHUFFLE(b, b, 2, 2, 2, 3, 3, 3, 4, 4);
            const F8 high = k < 10 ? MATTGS_SHUFFLE(b, b, 2, 3, 3, 3, 4, 4, 4, 5)
                                   : MATTGS_SHUFFLE(b, b, 4, 5, 5, 5, 6, 6, 6, 7);
            *reinterpret_cast<FU8*>(to + 3 * k) = low * c;
            *reinterpret_cast<FU8*>(to + 3 * k + 8) = high * d;
        }
    }
}

// Gradients of some splats, laid out like their parameters. They stay in the second-level cache, and
// are many enough for Adam to go through memory in long runs, as hardware prefetchers like it.
constexpr int BLOCK = 256;
static_assert(BLOCK % LANES == 0);

struct Block {
    alignas(64) float means[3 * BLOCK], log_scales[3 * BLOCK], quats[4 * BLOCK], logits[BLOCK];
    alignas(64) float dc[3 * BLOCK], rest[SH_FLOATS * BLOCK + 16];

    MATTGS_INLINE void set(const Gradients& g, int degree, int at) {
        scatter_rows<3>(g.mean, means + 3 * at, LANES);
        scatter_rows<3>(g.log_scale, log_scales + 3 * at, LANES);
        scatter_rows<4>(g.quat, quats + 4 * at, LANES);
        scatter_rows<1>(&g.logit, logits + at, LANES);
        scatter_rows<3>(g.dc, dc + 3 * at, LANES);
        if (degree > 0) write_rest(g, rest + SH_FLOATS * at);
    }
};

// Adds what opacities and scales weigh in the loss, of splats that no pixel saw, too.
MATTGS_INLINE void add_penalties(const SplatArrays<const float>& s, int64_t n, int64_t last,
                                 const Descent& to, Gradients& g) {
    const Inputs splat = read_inputs(s, n, last);
    const F opacity = sigmoid(splat.logit);
    g.logit += to.opacity_loss * opacity * (1.0f - opacity);
    for (int k = 0; k < 3; ++k) {
        const F scale = exp_accurate(min(splat.log_scale[k], all(LOG_SCALE_LIMIT)));
        g.log_scale[k] += to.scale_loss * scale;
    }
}

// A bit for each field that has a gradient which is not finite.
MATTGS_INLINE uint32_t broken_fields(const Gradients& g) {
    F zero[FIELDS] = {F{}, F{}, F{}, g.logit * 0.0f, F{}, F{}};
    for (int k = 0; k < 3; ++k) {
        zero[0] += g.mean[k] * 0.0f;
        zero[1] += g.log_scale[k] * 0.0f;
        zero[4] += g.dc[k] * 0.0f;
    }
    for (int k = 0; k < 4; ++k) zero[2] += g.quat[k] * 0.0f;
    uint32_t bits = 0;
    for (int f = 0; f < FIELDS; ++f) bits |= any(zero[f] != zero[f]) ? 1u << f : 0u;
    return bits;
}

}  // namespace

void project_backward(const SplatArrays<const float>& s, const Camera& c, int degree, int64_t first,
                      int64_t last, const SplatSums& in, const GradientOutputs& to,
                      double* camera) {
    const SplatArrays<float>& out = to.splats;
    CameraGradients moved{};
    for (int64_t n = first; n < last; n += LANES) {
        const int lanes = lanes_left(n, last);
        const Gradients g = gradients_of(s, c, degree, n, last, in, camera ? &moved : nullptr);
        scatter_rows<3>(g.mean, out.means + 3 * n, lanes);
        scatter_rows<3>(g.log_scale, out.log_scales + 3 * n, lanes);
        scatter_rows<4>(g.quat, out.quaternions + 4 * n, lanes);
        scatter_rows<1>(&g.logit, out.opacity_logits + n, lanes);
        scatter_rows<3>(g.dc, out.sh_dc + 3 * n, lanes);
        if (to.extra) scatter_rows<1>(&g.extra, to.extra + n, lanes);
        write_statistics(g, in.statistics, n, lanes, to.seen);
        if (!out.sh_rest) continue;
        float rest[SH_FLOATS * LANES + 16];
        write_rest(g, rest);
        __builtin_memcpy(out.sh_rest + SH_FLOATS * n, rest, sizeof(float) * SH_FLOATS * lanes);
    }
    if (camera) moved.sum_up(camera);
}

uint32_t descend(const Camera& c, int degree, int64_t first, int64_t last, const SplatSums& in,
                 const Descent& to, const SplatStatistics& statistics) {
    const SplatArrays<float>&v = to.values, &m = to.first_moments, &w = to.second_moments;
    const SplatArrays<const float> s = {v.means,          v.log_scales, v.quaternions,
                                        v.opacity_logits, v.sh_dc,      v.sh_rest, v.count};
    const bool penalised = to.opacity_loss > 0.0f || to.scale_loss > 0.0f;
    uint32_t broken = 0;
    Block block;
    for (int64_t start = first; start < last; start += BLOCK) {
        const int64_t end = start + BLOCK < last ? start + BLOCK : last;
        for (int64_t n = start; n < end; n += LANES) {
            // for Adam, while the gradients are worked out: its short runs, without the harmonics
            prefetch_splats(v, 0, n);
            prefetch_splats(m, 0, n);
            prefetch_splats(w, 0, n);
            Gradients g = gradients_of(s, c, degree, n, last, in, nullptr);
            if (penalised) add_penalties(s, n, last, to, g);
            broken |= broken_fields(g);
            block.set(g, degree, (int)(n - start));
            write_statistics(g, in.statistics, n, lanes_left(n, last), statistics);
        }
        const auto move = [&](int field, float* values, const float* grads, float* first_moments,
                              float* second_moments, int size) {
            const int64_t at = size * start;
            update_all(to.adam, to.rates[field],
                       {values + at, grads, first_moments + at, second_moments + at},
                       size * (end - start));
        };
        move(0, v.means, block.means, m.means, w.means, 3);
        move(1, v.log_scales, block.log_scales, m.log_scales, w.log_scales, 3);
        move(2, v.quaternions, block.quats, m.quaternions, w.quaternions, 4);
        move(3, v.opacity_logits, block.logits, m.opacity_logits, w.opacity_logits, 1);
        move(4, v.sh_dc, block.dc, m.sh_dc, w.sh_dc, 3);
        if (degree > 0) move(5, v.sh_rest, block.rest, m.sh_rest, w.sh_rest, SH_FLOATS);
    }
    return broken;
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
