// The memory of one rendering, from projected splats to sums over pixels.
#pragma once

#include <memory>
#include <vector>

#include "engine.h"
#include "rendering/buffer.h"

namespace mattgs {

struct Chunk {  // what one thread bins
    Buffer<Pair> pairs;
    std::vector<uint32_t> histogram;
    int64_t first = 0, last = 0, written = 0;
};

struct Workspace {
    Buffer<Projected> unsorted, sorted;
    Buffer<float> depths, colours, extra, slots;
    Buffer<uint64_t> keys, keys_spare;
    Buffer<uint32_t> order;
    Buffer<Slots> slots_of;
    Buffer<Pair> pairs;
    Buffer<TilePixels> pixels;
    std::vector<Chunk> chunks;
    std::vector<uint32_t> tile_start;
    std::vector<int32_t> processed, by_cost;

    int64_t bytes() const;
};

// Workspaces of renderings that are gone are kept, so that a training loop allocates nothing.
std::unique_ptr<Workspace> take_workspace();
void give_workspace(std::unique_ptr<Workspace> workspace);

}  // namespace mattgs
