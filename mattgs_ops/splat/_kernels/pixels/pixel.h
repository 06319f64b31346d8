// Alpha along a strip of 8 pixels, row by row, the same for forward and backward, so that
// both see the same bits.
//
// log2(alpha) is quadratic in the row, so alpha itself obeys a recurrence: with a = alpha and
// b = the ratio to the next row, the next row's are a * b and b * curve, where curve is one number
// for the whole splat. Two multiplications a row instead of an exponential. It needs every lane's
// value to stay a normal number, which holds unless the splat is thin: every row of a strip's span
// has a point inside the ellipse, where log2(alpha) >= -8 and |u| <= sqrt(8); the other lanes are
// less than 8 pixels away, so log2(alpha) >= -8 - (sqrt(8) + 7 * sx)^2. Thinner ones
// take an exponential a row.
#pragma once

#include "engine.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

static_assert(LANES == STRIP, "compile the kernels over pixels with vectors of 8");
constexpr int PREFETCH = 6;                 // pairs ahead

// The rows of a tile as numbers, and their squares, to be broadcast from memory.
#define MATTGS_ROWS(f)                                                                       \
    {f(0),  f(1),  f(2),  f(3),  f(4),  f(5),  f(6),  f(7),  f(8),  f(9),  f(10), f(11), f(12), \
     f(13), f(14), f(15), f(16), f(17), f(18), f(19), f(20), f(21), f(22), f(23), f(24), f(25), \
     f(26), f(27), f(28), f(29), f(30), f(31), f(32)}
#define MATTGS_SELF(i) i
#define MATTGS_SQUARE(i) i* i
alignas(64) constexpr float ROW[TILE + 1] = MATTGS_ROWS(MATTGS_SELF);
alignas(64) constexpr float ROW_SQUARED[TILE + 1] = MATTGS_ROWS(MATTGS_SQUARE);

// A pair ready for its rows: made one pair ahead, so that nothing waits for the exponentials.
struct Prepared {
    alignas(64) float alpha[STRIPS][LANES], ratio[STRIPS][LANES];
    float lanes[LANES];                        // u of a strip's columns, from its first
    alignas(16) float u[4], dy[4];             // of a strip's first column and row
    int32_t first[STRIPS], rows[STRIPS];
    int32_t used[STRIPS + 1], count;      // the strips that have rows
    const Projected* splat;

    MATTGS_INLINE F columns(int strip) const { return u[strip] + load(lanes); }
};

MATTGS_INLINE void prepare(const TileView& view, int position, Prepared& out) {
    static_assert(STRIPS == 4);
    const Pair& pair = view.pairs[position];
    const Projected& s = view.splats[pair.rank];
    out.splat = &s;
    int count = 0;
    F4 row = {};
    for (int i = 0; i < STRIPS; ++i) {
        const int first = pair.first[i], last = pair.last[i];
        out.first[i] = first;
        out.rows[i] = last - first;
        out.used[count] = i;
        count += last > first;
        row[i] = ROW[first];
    }
    out.count = count;
    // what depends on the strip alone, four at a time
    const F4 strip = {0.0f, LANES, 2.0f * LANES, 3.0f * LANES};
    const F4 dy = row + ((float)view.y0 + 0.5f - s.y);
    const F4 u = s.sx * (strip + ((float)view.x0 + 0.5f - s.x)) + s.sy * dy;
    const F4 level = s.peak - s.fall * dy * dy;
    const float twice = -2.0f * s.sy;
    const F4 ratio = exp2_fine<F4, U4>(twice * u - (s.fall * (dy + dy + 1.0f) + s.sy * s.sy));
    __builtin_memcpy(out.u, &u, 16);
    __builtin_memcpy(out.dy, &dy, 16);
    const F lanes = s.sx * to_float(lanes_from(0));
    store(out.lanes, lanes);
    // the ratio to the next row is geometric along a row
    const F ratio_lanes = exp2_fine<F, U>(twice * lanes);
    for (int k = 0; k < count; ++k) {
        const int i = out.used[k];
        const F c = u[i] + lanes;
        store(out.alpha[i], exp2_fast(level[i] - c * c));
        store(out.ratio[i], ratio[i] * ratio_lanes);
    }
}

template <bool BROAD_SPLAT>
struct Column;

template <>
struct Column<true> {
    F alpha, ratio, curve;

    MATTGS_INLINE Column(const Prepared& p, int strip)
        : alpha(load(p.alpha[strip])), ratio(load(p.ratio[strip])), curve(all(p.splat->curve)) {}

    // Alpha before the clamp and whether it counts; goes on to the next row.
    MATTGS_INLINE F next(I& counts) {
        const F a = alpha;
        counts = a >= ALPHA_MIN;
        alpha = a * ratio;
        ratio *= curve;
        return a;
    }
};

template <>
struct Column<false> {
    F u, dy, sy, fall, peak;

    MATTGS_INLINE Column(const Prepared& p, int strip)
        : u(p.columns(strip)),
          dy(all(p.dy[strip])),
          sy(all(p.splat->sy)),
          fall(all(p.splat->fall)),
          peak(all(p.splat->peak)) {}

    MATTGS_INLINE F next(I& counts) {
        const F log_alpha = (peak - fall * dy * dy) - u * u;
        counts = log_alpha >= LOG2_ALPHA_MIN;
        dy += 1.0f;
        u += sy;
        return exp2_fast(log_alpha);
    }
};

MATTGS_INLINE void prefetch(const TileView& v, int position) {
    if (position < 0 || position >= v.pair_count) return;
    // splats of a tile lie far apart; a hardware prefetcher sees no pattern
    const char* p = reinterpret_cast<const char*>(v.splats + v.pairs[position].rank);
    __builtin_prefetch(p);
    __builtin_prefetch(p + sizeof(Projected) - 1);
}

}  // namespace
}  // namespace MATTGS_ISA
}  // namespace mattgs
