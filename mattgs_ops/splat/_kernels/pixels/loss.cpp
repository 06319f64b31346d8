// L1 + structural dissimilarity, and its gradient, in one sweep over the rows.
//
// SSIM after Wang et al. 2004 with an 11x11 Gaussian window (sigma 1.5) and zeros outside the
// image, as 3DGS trains. Only four blurred maps are needed, because the variances enter as a sum:
// the images' sum and difference, and the squares of both; three more carry the gradient back. The window is separable; rows stay
// interleaved (red, green, blue), so that a neighbour in x is three floats away. Rows are taken
// four at a time: their windows overlap, so that most of what a column needs is in registers.
#include "engine.h"
#include "kernels.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

constexpr int RADIUS = 5, BLOCK = LOSS_BLOCK, WINDOW_ROWS = 2 * RADIUS + BLOCK;
// exp(-i^2 / (2 * 1.5^2)), normalised over the 11 taps
constexpr float WINDOW[RADIUS + 1] = {0.2660117248617943f,  0.21300553771125366f,
                                      0.1093606895097f,     0.03600077212843082f,
                                      0.007598758135239184f, 0.0010283800844791099f};
constexpr float C1 = 0.01f * 0.01f, C2 = 0.03f * 0.03f;  // for values in [0, 1]

enum Derivative { D_MEAN, D_SQUARE, D_PRODUCT, DERIVATIVES };
static_assert(LOSS_MAPS == DERIVATIVES);

struct Rows {
    const LossImages& in;
    int64_t stride, values;  // floats of a padded row; 3 * width
    float* ring;             // [DERIVATIVES][LOSS_RING][stride]: rows of SSIM's derivatives
    float* blurred;          // [4 maps][BLOCK][stride]: vertically blurred, zero padded
    float* zero;             // [stride]

    MATTGS_INLINE float* derivative(int which, int row) const {
        return ring + ((int64_t)which * LOSS_RING + row % LOSS_RING) * stride + LOSS_PAD;
    }
    MATTGS_INLINE float* row(int map, int k) const {
        return blurred + ((int64_t)map * BLOCK + k) * stride + LOSS_PAD;
    }
    MATTGS_INLINE bool inside(int row) const { return row >= 0 && row < in.height; }
};

// Of values in rows r, r+1, ...: the window centred on row r + RADIUS.
MATTGS_INLINE F vertical(const F* v) {
    F sum = WINDOW[0] * v[RADIUS];
    for (int k = 1; k <= RADIUS; ++k) sum += WINDOW[k] * (v[RADIUS - k] + v[RADIUS + k]);
    return sum;
}

#if defined(__AVX512F__) && MATTGS_LANES == 16
// Floats [first, first + LANES) of two vectors behind one another.
template <int FIRST>
MATTGS_INLINE F between(F a, F b) {
    return (F)_mm512_alignr_epi32((__m512i)b, (__m512i)a, FIRST);
}

// At aligned p. Loads that cross a cache line take twice the time, and here nearly all would.
MATTGS_INLINE F horizontal(const float* p) {
    const F a = load(p - LANES), b = load(p), c = load(p + LANES);
    F sum = WINDOW[0] * b;
    sum += WINDOW[1] * (between<LANES - 3>(a, b) + between<3>(b, c));
    sum += WINDOW[2] * (between<LANES - 6>(a, b) + between<6>(b, c));
    sum += WINDOW[3] * (between<LANES - 9>(a, b) + between<9>(b, c));
    sum += WINDOW[4] * (between<LANES - 12>(a, b) + between<12>(b, c));
    sum += WINDOW[5] * (between<LANES - 15>(a, b) + between<15>(b, c));
    return sum;
}
#else
MATTGS_INLINE F horizontal(const float* p) {
    F sum = WINDOW[0] * load(p);
    for (int k = 1; k <= RADIUS; ++k) sum += WINDOW[k] * (load(p - 3 * k) + load(p + 3 * k));
    return sum;
}
#endif

// The first `count` floats at p, then zeros.
MATTGS_INLINE F load_some(const float* p, int64_t count) {
    alignas(64) float v[LANES] = {};
    for (int i = 0; i < count; ++i) v[i] = p[i];
    return load(v);
}

MATTGS_INLINE F load_row(const float* p, int64_t left) {
    return left >= LANES ? load(p) : load_some(p, left);
}

// Blurs four maps vertically at float i, rows [first, first + BLOCK): with s the sum and d the
// difference of the two images, s, s^2, d and d^2. Fourteen rows of one of them fit the registers.
template <bool WHOLE>
MATTGS_INLINE void blur_column(const Rows& r, const float* const image[WINDOW_ROWS],
                               const float* const target[WINDOW_ROWS], int64_t i) {
    const int64_t left = r.values - i;
    for (int map = 0; map < 4; map += 2) {
        F v[WINDOW_ROWS];
#pragma GCC unroll 14
        for (int k = 0; k < WINDOW_ROWS; ++k) {
            const F x = WHOLE ? load(image[k] + i) : load_some(image[k] + i, left);
            const F y = WHOLE ? load(target[k] + i) : load_some(target[k] + i, left);
            v[k] = map == 0 ? x + y : x - y;
        }
#pragma GCC unroll 4
        for (int k = 0; k < BLOCK; ++k) store(r.row(map, k) + i, vertical(v + k));
#pragma GCC unroll 14
        for (int k = 0; k < WINDOW_ROWS; ++k) v[k] *= v[k];
#pragma GCC unroll 4
        for (int k = 0; k < BLOCK; ++k) store(r.row(map + 1, k) + i, vertical(v + k));
    }
}

MATTGS_INLINE void blur_images(const Rows& r, int32_t first) {
    const float *image[WINDOW_ROWS], *target[WINDOW_ROWS];
    for (int k = 0; k < WINDOW_ROWS; ++k) {
        const int32_t at = first + k - RADIUS;
        image[k] = r.inside(at) ? r.in.image + at * r.values : r.zero;
        target[k] = r.inside(at) ? r.in.target + at * r.values : r.zero;
    }
    int64_t i = 0;
    for (; i + LANES <= r.values; i += LANES) blur_column<true>(r, image, target, i);
    if (i < r.values) blur_column<false>(r, image, target, i);
}

// A row's weights, three times over as its values are.
MATTGS_INLINE void spread_weights(const Rows& r, int32_t y, float* out) {
    const float* given = r.in.weight + (int64_t)y * r.in.width;
    for (int32_t i = 0; i < r.in.width; ++i) out[3 * i] = out[3 * i + 1] = out[3 * i + 2] = given[i];
}

struct SsimSums {
    double plain, weighted;
};

// SSIM of row y, the block's k-th, and its derivatives with respect to the blurred maps.
MATTGS_INLINE SsimSums ssim_row(const Rows& r, int32_t y, int k) {
    float* d_mean = r.derivative(D_MEAN, y);
    float* d_square = r.derivative(D_SQUARE, y);
    float* d_product = r.derivative(D_PRODUCT, y);
    F total = F{}, weighted = F{};
    const F count = to_float(lanes_from(0));
    const bool given = r.in.weight && r.in.weight_ssim;
    if (given) spread_weights(r, y, d_mean);  // each is read before its derivative takes its place
    for (int64_t i = 0; i < r.values; i += LANES) {
        const F w = given ? load(d_mean + i) : all(1.0f);
        const F ms = 0.5f * horizontal(r.row(0, k) + i), ss = horizontal(r.row(1, k) + i);
        const F md = 0.5f * horizontal(r.row(2, k) + i), dd = horizontal(r.row(3, k) + i);
        const F mx = ms + md, my = ms - md;
        const F squared = 0.5f * (ss + dd), crossed = 0.25f * (ss - dd);
        const F mm = mx * my, m2 = mx * mx + my * my;
        const F a1 = 2.0f * mm + C1, a2 = 2.0f * (crossed - mm) + C2;
        const F b1 = m2 + C1, b2 = max(squared - m2, F{}) + C2;
        const F inverse = 1.0f / (b1 * b2);
        const I inside = count < (float)(r.values - i);
        const F s = a1 * a2 * inverse;
        total += keep(s, inside);
        weighted += keep(w * s, inside);
        // 1/b1 = b2 * inverse, 1/b2 = b1 * inverse
        store(d_mean + i, keep(2.0f * w * inverse * (my * (a2 - a1) + mx * s * (b1 - b2)), inside));
        store(d_square + i, keep(-w * s * b1 * inverse, inside));
        store(d_product + i, keep(2.0f * w * a1 * inverse, inside));
    }
    SsimSums sums{0, 0};
    for (int i = 0; i < LANES; ++i) {
        sums.plain += total[i];
        sums.weighted += weighted[i];
    }
    return sums;
}

// Blurs the derivatives vertically, rows [first, first + BLOCK).
MATTGS_INLINE void blur_derivatives(const Rows& r, int32_t first) {
    for (int which = 0; which < DERIVATIVES; ++which) {
        const float* p[WINDOW_ROWS];
        for (int k = 0; k < WINDOW_ROWS; ++k) {
            const int32_t at = first + k - RADIUS;
            p[k] = r.inside(at) ? r.derivative(which, at) : r.zero;
        }
        for (int64_t i = 0; i < r.values; i += LANES) {
            F v[WINDOW_ROWS];
#pragma GCC unroll 14
            for (int k = 0; k < WINDOW_ROWS; ++k) v[k] = load(p[k] + i);
#pragma GCC unroll 4
            for (int k = 0; k < BLOCK; ++k) store(r.row(which, k) + i, vertical(v + k));
        }
    }
}

MATTGS_INLINE void gradient_row(const Rows& r, int32_t y, int k, LossSums& sums) {
    const double all_values = (double)r.values * r.in.height;
    const float l1_scale = (float)((1.0 - r.in.ssim_lambda) / all_values);
    const float ssim_scale = (float)(-r.in.ssim_lambda / all_values);
    float* weight = r.row(3, k);  // where the fourth map was
    const bool given = r.in.weight;
    if (given) spread_weights(r, y, weight);
    const float* x = r.in.image + y * r.values;
    const float* t = r.in.target + y * r.values;
    float* out = r.in.grad + y * r.values;
    F l1 = F{}, weighted = F{};
    for (int64_t i = 0; i < r.values; i += LANES) {
        const int64_t left = r.values - i;
        const F a = load_row(x + i, left), b = load_row(t + i, left);
        const F w = given ? load_row(weight + i, left) : all(1.0f);
        const F difference = a - b;  // zero beyond the row's end
        l1 += abs(difference);
        weighted += w * abs(difference);
        const F sign = select(difference > 0.0f, w, keep(-w, difference < 0.0f));
        const F d_ssim = horizontal(r.row(0, k) + i) + 2.0f * a * horizontal(r.row(1, k) + i) +
                         b * horizontal(r.row(2, k) + i);
        const F g = l1_scale * sign + ssim_scale * d_ssim;
        if (left >= LANES)
            store(out + i, g);
        else
            for (int j = 0; j < left; ++j) out[i + j] = g[j];
    }
    for (int i = 0; i < LANES; ++i) {
        sums.l1 += l1[i];
        sums.weighted += weighted[i];
    }
}

// Zeros beyond the ends of the blurred rows, which horizontal() reads.
MATTGS_INLINE void clear_ends(const Rows& r) {
    for (int row = 0; row < 4 * BLOCK; ++row)
        for (int64_t i = r.values; i < r.stride - LOSS_PAD; ++i)
            r.row(0, 0)[row * r.stride + i] = 0.0f;
}

}  // namespace

void loss(const LossImages& in, int32_t first, int32_t last, LossSums* sums, float* scratch) {
    const int64_t stride = loss_stride(in.width);
    Rows r{in, stride, 3 * (int64_t)in.width, scratch, nullptr, nullptr};
    r.blurred = r.ring + DERIVATIVES * LOSS_RING * stride;
    r.zero = r.blurred + 4 * BLOCK * stride;
    __builtin_memset(r.blurred, 0, sizeof(float) * (4 * BLOCK + 1) * stride);
    // row y of the gradient needs SSIM of rows y -+ 5, those need pixels of rows y -+ 10
    for (int32_t y = first - RADIUS; y < last + RADIUS; y += BLOCK) {
        blur_images(r, y);
        clear_ends(r);
        for (int k = 0; k < BLOCK; ++k) {
            if (!r.inside(y + k)) continue;
            const SsimSums ssim = ssim_row(r, y + k, k);
            if (y + k < first || y + k >= last) continue;
            sums[y + k].ssim = ssim.plain;
            sums[y + k].weighted_ssim = ssim.weighted;
        }
        const int32_t done = y - RADIUS;
        if (done + BLOCK <= first || done >= last) continue;
        blur_derivatives(r, done);
        clear_ends(r);
        for (int k = 0; k < BLOCK; ++k) {
            if (done + k < first || done + k >= last) continue;
            sums[done + k].l1 = sums[done + k].weighted = 0;
            gradient_row(r, done + k, k, sums[done + k]);
        }
    }
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
