// Which tiles a splat touches, and in each which rows of each strip of 8 columns: exact bounds of
// the ellipse alpha >= 1/255, so that few lanes are wasted later.
#include "engine.h"
#include "kernels.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

constexpr int PREFETCH_SPLATS = 12;
typedef int32_t I4 __attribute__((vector_size(16), may_alias));
typedef uint8_t B4 __attribute__((vector_size(4), may_alias));
static_assert(STRIPS == 4);

MATTGS_INLINE F8 all8(float x) { return x - F8{}; }
MATTGS_INLINE I8 all8(int32_t x) { return x - I8{}; }

MATTGS_INLINE int32_t clamp_tile(float pixel, int32_t tiles) {
    const float tile = pixel * (1.0f / TILE);
    if (!(tile > 0.0f)) return 0;
    return tile < (float)tiles ? (int32_t)tile : tiles;
}

MATTGS_INLINE F8 sqrt8(F8 v) {
    F8 r;
    for (int i = 0; i < 8; ++i) r[i] = __builtin_sqrtf(v[i]);
    return r;
}

// Pixels added to an ellipse's bounds against rounding.
MATTGS_INLINE float slack_of(const Projected& s) {
    return 0.01f + 4e-7f * (__builtin_fabsf(s.x) + __builtin_fabsf(s.y));
}

// The ellipse u^2 + fall dy^2 <= level as dy = slope dx -+ sqrt(lift - bend dx^2).
struct Ellipse {
    float x, y, slope, lift, bend, tip, slack;
    bool everywhere;
};

MATTGS_INLINE Ellipse ellipse_of(const Projected& s) {
    Ellipse e;
    const float level = s.peak - LOG2_ALPHA_MIN > 0.0f ? s.peak - LOG2_ALPHA_MIN : 0.0f;
    const float steep = s.sy * s.sy + s.fall;
    e.everywhere = !(s.extent_x < FAR_TOO_BIG && s.extent_y < FAR_TOO_BIG);
    e.x = s.x;
    e.y = s.y;
    e.slope = -s.sx * s.sy / steep;
    e.lift = level / steep;
    e.bend = s.sx * s.sx * (s.fall / steep) / steep;
    e.tip = -s.sy / s.sx * s.extent_y;  // dx where dy is greatest
    e.slack = slack_of(s);
    return e;
}

// Rows [first, last) of the image for the 4 strips of a tile's columns: lanes 0-3 first, 4-7 last.
MATTGS_INLINE I8 rows_of_strips(const Ellipse& e, int32_t x0, int32_t height) {
    const F8 sign = {-1, -1, -1, -1, 1, 1, 1, 1};
    const F8 column = {0.5f, 8.5f, 16.5f, 24.5f, 0.5f, 8.5f, 16.5f, 24.5f};
    if (e.everywhere) return (I8)((I8)(sign > 0.0f) & height);
    const F8 left = column + ((float)x0 - e.x), right = left + (float)(STRIP - 1);
    F8 dx = sign * e.tip;
    dx = dx < left ? left : dx;
    dx = dx > right ? right : dx;
    const F8 inside = e.lift - e.bend * dx * dx;
    // slack both ways: an ellipse that only just reaches the strip still counts
    const I8 reached = (left <= dx) & (inside >= -e.slack);
    const F8 root = sqrt8(inside > 0.0f ? inside : all8(0.0f));
    F8 row = e.y - 0.5f + e.slope * dx + sign * (root + e.slack);
    const F8 low = all8(-1.0f), high = all8((float)height);
    row = row > low ? row : low;
    row = row < high ? row : high;
    // floor(row) + 1, as row >= -1
    I8 rows = __builtin_convertvector(row + 1.0f, I8);
    const I8 top = all8(height);
    rows = rows < top ? rows : top;
    return rows & reached;
}

// Clips rows to the tile; says whether any are left.
MATTGS_INLINE bool set_rows(Pair& p, I8 rows) {
    const I8 zero = I8{}, most = all8(TILE);
    rows = rows > zero ? rows : zero;
    rows = rows < most ? rows : most;
    const I4 first = MATTGS_SHUFFLE(rows, rows, 0, 1, 2, 3);
    I4 last = MATTGS_SHUFFLE(rows, rows, 4, 5, 6, 7);
    last = last > first ? last : first;
    const B4 a = __builtin_convertvector(first, B4), b = __builtin_convertvector(last, B4);
    uint32_t from, to;
    __builtin_memcpy(&from, &a, STRIPS);
    __builtin_memcpy(&to, &b, STRIPS);
    __builtin_memcpy(p.first, &from, STRIPS);
    __builtin_memcpy(p.last, &to, STRIPS);
    return from != to;
}

}  // namespace

void bin(BinningChunk& c) {
    const int32_t width = c.tiles_x, height = c.tiles_y;
    int64_t n = c.written, rank = c.first;
    for (; rank < c.last; ++rank) {
        if (rank + PREFETCH_SPLATS < c.last) {  // in depth order they lie anywhere
            const Projected* next = c.unsorted + c.order[rank + PREFETCH_SPLATS];
            __builtin_prefetch(next);
            __builtin_prefetch(&next->curve);
        }
        const uint32_t splat = c.order[rank];
        const Projected s = c.unsorted[splat];
        const Ellipse e = ellipse_of(s);
        const int32_t tx0 = clamp_tile(s.x - s.extent_x - e.slack, width);
        const int32_t tx1 = clamp_tile(s.x + s.extent_x + e.slack + TILE, width);
        const int32_t ty0 = clamp_tile(s.y - s.extent_y - e.slack, height);
        const int32_t ty1 = clamp_tile(s.y + s.extent_y + e.slack + TILE, height);
        const int64_t bound = (int64_t)(tx1 - tx0) * (ty1 - ty0);
        if (n + (bound > 0 ? bound : 0) > c.capacity) break;
        const int64_t start = n;
        for (int32_t tx = tx0; tx < tx1; ++tx) {
            I8 rows = rows_of_strips(e, tx * TILE, c.height);
            // strips that begin beyond the image's right edge hold no pixels
            const int32_t strips = (c.width - tx * TILE + STRIP - 1) / STRIP;
            for (int i = 0; i < STRIPS; ++i)
                if (i >= strips) rows[i] = rows[i + STRIPS] = 0;
            for (int32_t ty = ty0; ty < ty1; ++ty) {
                Pair p;
                p.rank = (uint32_t)rank;
                if (!set_rows(p, rows - ty * TILE)) continue;
                const uint32_t tile = (uint32_t)(ty * width + tx);
                c.pairs[n] = p;
                c.tiles[n] = tile;
                ++c.histogram[tile];
                ++n;
            }
        }
        c.sorted[rank] = s;
        c.splat_pairs[splat] = (uint32_t)(n - start);
    }
    c.first = rank;
    c.written = n;
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
