// Which tiles a splat touches, and in each which rows of each strip of 8 columns: exact bounds of
// the ellipse alpha >= 1/255, so that few lanes are wasted later.
//
// Splats are taken eight at a time: their ellipses side by side, then one flat list of the tiles
// within their bounding boxes, and no branch for what is found there: small splats' boxes differ
// too much for loops whose ends a processor could foresee.
#include "engine.h"
#include "kernels.h"
#include "rows.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

static_assert(LANES == 8 && STRIPS == 4);
constexpr int GROUP = LANES;
constexpr int LISTED = 16;  // tiles of a bounding box at most, for it to go through the list
typedef uint8_t B8 __attribute__((vector_size(8), may_alias));

// A tile of one of the group's splats: lane, column and row of tiles, in one number.
constexpr int TY_BITS = 12, LANE_SHIFT = 24;
static_assert(MAX_SIDE / TILE <= 1 << TY_BITS);

// Tiles of boxes 1 to LISTED high, column by column, from the box's first.
struct Boxes {
    alignas(64) int32_t tiles[LISTED + 1][LISTED];

    constexpr Boxes() : tiles() {
        for (int height = 1; height <= LISTED; ++height)
            for (int i = 0; i < LISTED; ++i)
                tiles[height][i] = (i / height) << TY_BITS | i % height;
    }
};
constexpr Boxes BOXES;

// Of each splat the ellipse u^2 + fall dy^2 <= level as dy = slope dx -+ sqrt(lift - bend dx^2),
// and the tiles [tx0, tx1) x [ty0, ty1) of its bounding box.
struct Group {
    alignas(32) float x[GROUP], y[GROUP], slope[GROUP], lift[GROUP], bend[GROUP], tip[GROUP];
    alignas(32) float slack[GROUP];
    alignas(32) int32_t tx0[GROUP], tx1[GROUP], ty0[GROUP], ty1[GROUP];
    uint32_t splat[GROUP], found[GROUP];  // which; how many pairs
};

MATTGS_INLINE I tile_of(F pixel, int32_t tiles) {
    const F tile = pixel * (1.0f / TILE), most = all((float)tiles);
    const F positive = tile > 0.0f ? tile : F{};  // not a number: 0
    return to_int(positive < most ? positive : most);
}

MATTGS_INLINE void set_ellipses(const F s[12], const BinningChunk& c, Group& g) {
    const F x = s[0], y = s[1], sx = s[2], sy = s[3], fall = s[4], peak = s[5];
    const F extent_x = s[9], extent_y = s[10];
    const F level = max(peak - LOG2_ALPHA_MIN, F{});
    const F steep = sy * sy + fall;
    // pixels added to the bounds against rounding
    const F slack = 0.01f + 4e-7f * (abs(x) + abs(y));
    // an ellipse that counts as covering the image: one that does, without large numbers squared
    const I bounded = (extent_x < FAR_TOO_BIG) & (extent_y < FAR_TOO_BIG);
    store(g.x, keep(x, bounded));
    store(g.y, keep(y, bounded));
    store(g.slope, keep(-sx * sy / steep, bounded));
    store(g.lift, select(bounded, level / steep, all(1e30f)));
    store(g.bend, keep(sx * sx * (fall / steep) / steep, bounded));
    store(g.tip, keep(-sy / sx * extent_y, bounded));  // dx where dy is greatest
    store(g.slack, slack);
    store(g.tx0, tile_of(x - extent_x - slack, c.tiles_x));
    store(g.tx1, tile_of(x + extent_x + slack + (float)TILE, c.tiles_x));
    store(g.ty0, tile_of(y - extent_y - slack, c.tiles_y));
    store(g.ty1, tile_of(y + extent_y + slack + (float)TILE, c.tiles_y));
}

// Ranks [rank, rank + lanes): their splats in depth order, and their ellipses.
MATTGS_INLINE void read_group(const BinningChunk& c, int64_t rank, int lanes, Group& g) {
    F low[GROUP], high[GROUP], s[12];
    for (int i = 0; i < GROUP; ++i) {
        g.splat[i] = c.order[rank + (i < lanes ? i : 0)];
        g.found[i] = 0;
        const float* from = &c.unsorted[g.splat[i]].x;
        low[i] = load(from);
        high[i] = load(from + 4);
        if (i >= lanes) continue;
        store(&c.sorted[rank + i].x, low[i]);
        store(&c.sorted[rank + i].x + 4, high[i]);
    }
    transpose(low);
    transpose(high);
    for (int k = 0; k < 8; ++k) s[k] = low[k];
    for (int k = 4; k < 8; ++k) s[4 + k] = high[k];
    set_ellipses(s, c, g);
}

// Rows [first, last) of the image for the 4 strips of a tile's columns: lanes 0-3 first, 4-7 last.
MATTGS_INLINE I rows_of_strips(const Group& g, int i, int32_t x0, const BinningChunk& c) {
    const F sign = {-1, -1, -1, -1, 1, 1, 1, 1};
    const I strip = {0, 8, 16, 24, 0, 8, 16, 24};
    const F left = to_float(strip) + ((float)x0 + 0.5f - g.x[i]);
    const F right = left + (float)(STRIP - 1);
    const F dx = min(max(sign * g.tip[i], left), right);
    const F inside = g.lift[i] - g.bend[i] * dx * dx;
    // slack both ways: an ellipse that only just reaches the strip still counts; strips that begin
    // beyond the image's right edge hold no pixels
    const I reached = (left <= dx) & (inside >= -g.slack[i]) & (strip + x0 < c.width);
    const F root = sqrt(max(inside, F{}));
    const F row = g.y[i] - 0.5f + g.slope[i] * dx + sign * (root + g.slack[i]);
    const F height = all((float)c.height);
    // floor(row) + 1, as row >= -1
    const I rows = to_int(min(max(row, all(-1.0f)), height) + 1.0f), most = all(c.height);
    return (rows < most ? rows : most) & reached;
}

// Writes a pair, and counts it if it has rows; the next one overwrites it if not.
MATTGS_INLINE void write_pair(BinningChunk& c, Group& g, int i, int64_t rank, int32_t tx,
                              int32_t ty, I rows) {
    rows -= ty * TILE;
    rows = rows > 0 ? rows : I{};
    const I most = all(TILE);
    rows = rows < most ? rows : most;
    const I first = MATTGS_SHUFFLE(rows, rows, 0, 1, 2, 3, 0, 1, 2, 3);
    const B8 bytes = __builtin_convertvector(rows > first ? rows : first, B8);
    uint32_t spans[2];
    __builtin_memcpy(spans, &bytes, 8);
    const uint32_t tile = (uint32_t)(ty * c.tiles_x + tx), any_rows = spans[0] != spans[1];
    const U4 pair = {(uint32_t)(rank + i), tile, spans[0], spans[1]};
    __builtin_memcpy(c.pairs + c.written, &pair, sizeof(Pair));
    c.written += any_rows;
    c.histogram[tile] += any_rows;
    g.found[i] += any_rows;
}

MATTGS_INLINE void write_listed(BinningChunk& c, Group& g, int64_t rank, const int32_t* list,
                                int64_t count) {
    for (int64_t k = 0; k < count; ++k) {
        const int32_t i = list[k] >> LANE_SHIFT, ty = list[k] & ((1 << TY_BITS) - 1);
        const int32_t tx = list[k] >> TY_BITS & ((1 << (LANE_SHIFT - TY_BITS)) - 1);
        write_pair(c, g, i, rank, tx, ty, rows_of_strips(g, i, tx * TILE, c));
    }
}

__attribute__((noinline)) void write_large(BinningChunk& c, Group& g, int i, int64_t rank) {
    for (int32_t tx = g.tx0[i]; tx < g.tx1[i]; ++tx) {
        const I rows = rows_of_strips(g, i, tx * TILE, c);
        for (int32_t ty = g.ty0[i]; ty < g.ty1[i]; ++ty) write_pair(c, g, i, rank, tx, ty, rows);
    }
}

// Writes the pairs of splats [0, lanes) of a group, or of the first for which there is room.
MATTGS_INLINE int write_group(BinningChunk& c, Group& g, int64_t rank, int lanes) {
    alignas(64) int32_t list[GROUP * LISTED];
    int64_t listed = 0;
    int i = 0;
    for (; i < lanes; ++i) {
        const int32_t height = g.ty1[i] - g.ty0[i];
        const int64_t tiles = (int64_t)(g.tx1[i] - g.tx0[i]) * height;
        if (c.written + listed + tiles > c.capacity) break;
        if (tiles <= LISTED) {
            const int32_t first = i << LANE_SHIFT | g.tx0[i] << TY_BITS | g.ty0[i];
            const int32_t* box = BOXES.tiles[tiles ? height : 0];
            for (int k = 0; k < LISTED; k += LANES) store(list + listed + k, first + load(box + k));
            listed += tiles;
        } else {
            write_listed(c, g, rank, list, listed);
            listed = 0;
            write_large(c, g, i, rank);
        }
    }
    write_listed(c, g, rank, list, listed);
    return i;
}

}  // namespace

void bin(BinningChunk& given) {
    BinningChunk c = given;  // a copy: nothing that is written can alias it
    int64_t rank = c.first;
    while (rank < c.last) {
        const int lanes = c.last - rank < GROUP ? (int)(c.last - rank) : GROUP;
        for (int64_t r = rank + 2 * GROUP; r < rank + 3 * GROUP && r < c.last; ++r) {
            // in depth order they lie anywhere
            __builtin_prefetch(c.unsorted + c.order[r]);
            __builtin_prefetch(&c.unsorted[c.order[r]].curve);
            __builtin_prefetch(c.slots + c.order[r], 1);
        }
        Group g;
        read_group(c, rank, lanes, g);
        const int done = write_group(c, g, rank, lanes);
        for (int i = 0; i < done; ++i) {
            c.slots[g.splat[i]].count = g.found[i];
            if (!g.found[i]) c.radii[g.splat[i]] = 0.0f;
        }
        rank += done;
        if (done < lanes) break;
    }
    given.first = rank;
    given.written = c.written;
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
