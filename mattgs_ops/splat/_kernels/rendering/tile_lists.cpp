// From projected splats to each tile's list of pairs, nearest splat first.
#include <algorithm>
#include <cstring>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "rendering/rendering.h"
#include "rendering/threads.h"

namespace mattgs {
namespace {

constexpr int64_t PAIRS_AHEAD = 16, TILE_PAIRS_AHEAD = 6;  // prefetched

}  // namespace

uint64_t* radix_sort(uint64_t* keys, uint64_t* spare, int64_t count) {
    constexpr int BITS = 11, BUCKETS = 1 << BITS, PASSES = 3;
    static_assert(BITS * PASSES >= 32);
    std::vector<uint32_t> histogram(PASSES * BUCKETS);
    for (int64_t i = 0; i < count; ++i)
        for (int p = 0; p < PASSES; ++p)
            ++histogram[p * BUCKETS + ((keys[i] >> (32 + p * BITS)) & (BUCKETS - 1))];
    for (int p = 0; p < PASSES; ++p) {
        uint32_t* h = histogram.data() + p * BUCKETS;
        const int shift = 32 + p * BITS;
        // all keys alike in these bits: nothing to do
        if (count && h[(keys[0] >> shift) & (BUCKETS - 1)] == count) continue;
        uint32_t sum = 0;
        for (int b = 0; b < BUCKETS; ++b) {
            const uint32_t n = h[b];
            h[b] = sum;
            sum += n;
        }
        for (int64_t i = 0; i < count; ++i)
            spare[h[(keys[i] >> shift) & (BUCKETS - 1)]++] = keys[i];
        std::swap(keys, spare);
    }
    return keys;
}

void Rendering::sort() {
    Workspace& w = *work_;
    uint64_t* keys = w.keys.fit(count_);
    const float* depths = w.depths.data();
    int64_t n = 0;
    for (int64_t i = 0; i < count_; ++i) {
        uint32_t bits;  // of a positive float: ordered as the float is
        std::memcpy(&bits, depths + i, 4);
        keys[n] = static_cast<uint64_t>(bits) << 32 | static_cast<uint32_t>(i);
        n += bits != 0;
    }
    visible_ = n;
    keys = radix_sort(keys, w.keys_spare.fit(count_), n);
    uint32_t* order = w.order.fit(count_);
    for (int64_t i = 0; i < n; ++i) order[i] = static_cast<uint32_t>(keys[i]);
}

void Rendering::bin(float* radii) {
    Workspace& w = *work_;
    const std::size_t tiles = static_cast<std::size_t>(tiles_x_) * tiles_y_;
    w.sorted.fit(visible_);
    std::fill_n(w.slots_of.fit(count_), count_, Slots{});
    if (static_cast<int>(w.chunks.size()) < threads_) w.chunks.resize(threads_);
    parallel(threads_, threads_, [&](int64_t k) {
        Chunk& c = w.chunks[static_cast<std::size_t>(k)];
        c.first = visible_ * k / threads_;
        c.last = visible_ * (k + 1) / threads_;
        c.histogram.assign(tiles, 0);
        BinningChunk b{};
        b.unsorted = w.unsorted.data();
        b.order = w.order.data();
        b.first = c.first;
        b.last = c.last;
        b.width = camera_.width;
        b.height = camera_.height;
        b.tiles_x = tiles_x_;
        b.tiles_y = tiles_y_;
        b.sorted = w.sorted.data();
        b.slots = w.slots_of.data();
        b.radii = radii;
        b.histogram = c.histogram.data();
        while (b.first < b.last) {
            b.capacity = c.pairs.capacity();
            b.pairs = c.pairs.data();
            const int64_t before = b.first;
            kernels_.bin(b);
            if (b.first == b.last) break;
            // one splat fills at most every tile
            int64_t room = b.capacity + b.capacity / 2 + 4 * (b.last - b.first);
            if (b.first == before) room = std::max(room, b.written + static_cast<int64_t>(tiles));
            c.pairs.extend(room, b.written);
        }
        c.written = b.written;
    });
    pair_count_ = 0;
    for (int k = 0; k < threads_; ++k) pair_count_ += w.chunks[k].written;
    if (pair_count_ >= std::numeric_limits<uint32_t>::max())
        throw std::length_error("more than 2^32 pairs of splats and tiles");
}

void Rendering::scatter() {
    Workspace& w = *work_;
    const std::size_t tiles = static_cast<std::size_t>(tiles_x_) * tiles_y_;
    w.tile_start.resize(tiles + 1);
    uint32_t sum = 0;
    for (std::size_t t = 0; t < tiles; ++t) {
        w.tile_start[t] = sum;
        for (int k = 0; k < threads_; ++k) {
            const uint32_t n = w.chunks[k].histogram[t];
            w.chunks[k].histogram[t] = sum;
            sum += n;
        }
    }
    w.tile_start[tiles] = sum;
    Slots* slots = w.slots_of.data();
    sum = 0;
    for (int64_t n = 0; n < count_; ++n) {
        slots[n].end = sum;  // of the ones before, and when the pairs are placed of these
        sum += slots[n].count;
    }
    Pair* pairs = w.pairs.fit(pair_count_);
    const uint32_t* order = w.order.data();
    parallel(threads_, threads_, [&](int64_t k) {
        Chunk& c = w.chunks[static_cast<std::size_t>(k)];
        uint32_t* next = c.histogram.data();
        const Pair* from = c.pairs.data();
        for (int64_t i = 0; i < c.written; ++i) {
            const Pair& ahead = from[std::min(i + PAIRS_AHEAD, c.written - 1)];
            __builtin_prefetch(slots + order[ahead.rank], 1);
            Pair pair = from[i];
            Pair& to = pairs[next[pair.place]++];
            pair.place = slots[order[pair.rank]].end++;
            to = pair;
            __builtin_prefetch(&to + TILE_PAIRS_AHEAD, 1);  // as many streams as there are tiles
        }
    });
    // the costliest tiles first, so that no thread is left with one at the end
    w.by_cost.resize(tiles);
    std::iota(w.by_cost.begin(), w.by_cost.end(), 0);
    if (threads_ > 1)
        std::stable_sort(w.by_cost.begin(), w.by_cost.end(), [&](int32_t a, int32_t b) {
            return w.tile_start[a + 1] - w.tile_start[a] > w.tile_start[b + 1] - w.tile_start[b];
        });
}

}  // namespace mattgs
