#include "workspace.h"

#include <time.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <limits>
#include <mutex>
#include <numeric>
#include <stdexcept>

#include "threads.h"

namespace mattgs {
namespace {

constexpr int64_t SPLATS_PER_TASK = 1024;
constexpr int64_t MOST_LANES = 16;
constexpr int64_t PAIRS_AHEAD = 16, TILE_PAIRS_AHEAD = 6;  // prefetched

// Workspaces of renderings that are gone, kept so that a training loop allocates nothing.
std::mutex free_mutex;
std::vector<std::unique_ptr<Workspace>>& free_workspaces() {
    static auto* list = new std::vector<std::unique_ptr<Workspace>>;
    return *list;
}
constexpr std::size_t KEPT_WORKSPACES = 2;

std::unique_ptr<Workspace> take_workspace() {
    const std::lock_guard<std::mutex> lock(free_mutex);
    auto& list = free_workspaces();
    if (list.empty()) return std::make_unique<Workspace>();
    auto last = std::move(list.back());
    list.pop_back();
    return last;
}

void give_workspace(std::unique_ptr<Workspace> workspace) {
    const std::lock_guard<std::mutex> lock(free_mutex);
    auto& list = free_workspaces();
    if (list.size() < KEPT_WORKSPACES) list.push_back(std::move(workspace));
}

// Gives the time since the last call, or since it was made: of the calling thread's own processor
// time where it works alone, so that other programs' load does not count, else of the wall clock.
class Stopwatch {
public:
    explicit Stopwatch(int threads)
        : clock_(threads > 1 ? CLOCK_MONOTONIC : CLOCK_THREAD_CPUTIME_ID), last_(now()) {}

    void lap(double& seconds) {
        const double t = now();
        seconds = t - last_;
        last_ = t;
    }

private:
    double now() const {
        timespec t{};
        clock_gettime(clock_, &t);
        return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
    }

    clockid_t clock_;
    double last_;
};

int64_t ceil_div(int64_t a, int64_t b) { return (a + b - 1) / b; }

}  // namespace

int64_t Workspace::bytes() const {
    int64_t sum = unsorted.bytes() + sorted.bytes() + depths.bytes() + colours.bytes() +
                  extra.bytes() + slots.bytes() + scratch.bytes() + keys.bytes() + keys_spare.bytes() + order.bytes() +
                  slots_of.bytes() + pairs.bytes() + pixels.bytes();
    for (const Chunk& c : chunks) sum += c.pairs.bytes();
    return sum;
}

Rendering::Rendering(const Kernels& kernels, const Camera& camera, const float background[3],
                     int sh_degree, int threads, bool differentiable)
    : kernels_(kernels),
      camera_(camera),
      sh_degree_(sh_degree),
      threads_(threads),
      differentiable_(differentiable),
      tiles_x_(static_cast<int32_t>(ceil_div(camera.width, TILE))),
      tiles_y_(static_cast<int32_t>(ceil_div(camera.height, TILE))),
      work_(take_workspace()) {
    std::copy_n(background, 3, background_);
}

Rendering::~Rendering() { give_workspace(std::move(work_)); }

int64_t Rendering::project(const SplatArrays<const float>& splats, const RenderOutputs& out) {
    Workspace& w = *work_;
    const ProjectOutputs to{
        w.unsorted.fit(count_), w.depths.fit(count_), out.radii, out.means2d, out.extents,
        differentiable_ ? w.colours.fit(COLOUR_FLOATS * (count_ + MOST_LANES)) : nullptr};
    const int64_t tasks = ceil_div(count_, SPLATS_PER_TASK);
    std::vector<int64_t> bad(static_cast<std::size_t>(tasks));
    parallel(threads_, tasks, [&](int64_t t) {
        const int64_t first = t * SPLATS_PER_TASK;
        bad[static_cast<std::size_t>(t)] = kernels_.project(
            splats, camera_, sh_degree_, first, std::min(first + SPLATS_PER_TASK, count_),
            to);
    });
    return std::accumulate(bad.begin(), bad.end(), int64_t{0});
}

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

TileView Rendering::tile(int64_t t) const {
    const Workspace& w = *work_;
    TileView v{};
    v.splats = w.sorted.data();
    v.extra = extra_ ? w.extra.data() : nullptr;
    v.alpha_max = camera_.conventions.alpha_max;
    v.pairs = w.pairs.data() + w.tile_start[t];
    v.pair_count = static_cast<int32_t>(w.tile_start[t + 1] - w.tile_start[t]);
    v.x0 = static_cast<int32_t>(t % tiles_x_) * TILE;
    v.y0 = static_cast<int32_t>(t / tiles_x_) * TILE;
    v.width = camera_.width;
    v.height = camera_.height;
    return v;
}

int64_t Rendering::forward(const SplatArrays<const float>& splats, const RenderOutputs& out,
                           const float* extra) {
    count_ = splats.count;
    extra_ = extra != nullptr;
    Stopwatch watch(threads_);
    const int64_t bad = project(splats, out);
    if (bad) return bad;
    watch.lap(seconds_[0]);
    sort();
    watch.lap(seconds_[1]);
    bin(out.radii);
    scatter();
    Workspace& w = *work_;
    if (extra_) {
        float* sorted = w.extra.fit(visible_);
        for (int64_t i = 0; i < visible_; ++i) sorted[i] = extra[w.order.data()[i]];
    }
    watch.lap(seconds_[2]);
    const int64_t tiles = static_cast<int64_t>(tiles_x_) * tiles_y_;
    w.pixels.fit(tiles);
    w.processed.resize(static_cast<std::size_t>(tiles));
    parallel(threads_, tiles, [&](int64_t i) {
        const int32_t t = w.by_cost[static_cast<std::size_t>(i)];
        ForwardTile job{};
        job.view = tile(t);
        job.pixels = w.pixels.data() + t;
        std::copy_n(background_, 3, job.background);
        job.image = out.image;
        job.alpha = out.alpha;
        kernels_.forward(job);
        w.processed[static_cast<std::size_t>(t)] = job.processed;
    });
    watch.lap(seconds_[3]);
    return 0;
}

SplatSums Rendering::composite_back(const BackwardInputs& in, bool statistics) {
    Workspace& w = *work_;
    const int size = statistics || extra_ ? SLOT_SIZE : SLOT_SIZE_PLAIN;
    w.slots.fit(pair_count_ * size + SLOT_SIZE);
    const int64_t tiles = static_cast<int64_t>(tiles_x_) * tiles_y_;
    parallel(threads_, tiles, [&](int64_t i) {
        const int32_t t = w.by_cost[static_cast<std::size_t>(i)];
        BackwardTile job{};
        job.view = tile(t);
        job.pixels = w.pixels.data() + t;
        std::copy_n(background_, 3, job.background);
        job.grad_image = in.grad_image;
        job.grad_alpha = in.grad_alpha;
        job.pixel_map = in.pixel_map;
        job.slots = w.slots.data();
        job.statistics = statistics;
        job.processed = w.processed[static_cast<std::size_t>(t)];
        kernels_.backward(job);
    });
    return {w.slots_of.data(), w.slots.data(), w.colours.data(), statistics, size};
}

void Rendering::backward(const SplatArrays<const float>& splats, const BackwardInputs& in,
                         const GradientOutputs& out, bool statistics, double* camera) {
    Stopwatch watch(threads_);
    const SplatSums sums = composite_back(in, statistics);
    watch.lap(seconds_[4]);
    const int64_t tasks = ceil_div(count_, SPLATS_PER_TASK);
    std::vector<double> of_tasks(camera ? static_cast<std::size_t>(tasks * CAMERA_SUMS) : 0);
    parallel(threads_, tasks, [&](int64_t t) {
        const int64_t first = t * SPLATS_PER_TASK;
        kernels_.project_backward(splats, camera_, sh_degree_, first,
                                  std::min(first + SPLATS_PER_TASK, count_), sums, out,
                                  camera ? of_tasks.data() + t * CAMERA_SUMS : nullptr);
    });
    for (int k = 0; camera && k < CAMERA_SUMS; ++k) {  // in one order, whatever the threads
        camera[k] = 0.0;
        for (int64_t t = 0; t < tasks; ++t) camera[k] += of_tasks[t * CAMERA_SUMS + k];
    }
    watch.lap(seconds_[5]);
}

uint32_t Rendering::descend(const BackwardInputs& in, const Descent& to,
                            const SplatStatistics& seen, bool statistics) {
    Stopwatch watch(threads_);
    const SplatSums sums = composite_back(in, statistics);
    watch.lap(seconds_[4]);
    std::atomic<uint32_t> broken{0};
    parallel(threads_, ceil_div(count_, SPLATS_PER_TASK), [&](int64_t t) {
        const int64_t first = t * SPLATS_PER_TASK;
        broken |= kernels_.descend(camera_, sh_degree_, first,
                                   std::min(first + SPLATS_PER_TASK, count_), sums, to, seen);
    });
    watch.lap(seconds_[5]);
    return broken;
}

int64_t Rendering::evaluated() const {
    const Workspace& w = *work_;
    int64_t sum = 0;
    for (int64_t t = 0; t < static_cast<int64_t>(tiles_x_) * tiles_y_; ++t) {
        const TileView v = tile(t);
        for (int32_t i = 0; i < w.processed[static_cast<std::size_t>(t)]; ++i)
            for (int s = 0; s < STRIPS; ++s) {
                const int left = v.x0 + s * STRIP;
                const int columns = std::clamp(v.width - left, 0, STRIP);
                sum += columns * (v.pairs[i].last[s] - v.pairs[i].first[s]);
            }
    }
    return sum;
}

LossSums photometric_loss(const Kernels& kernels, const LossImages& images, int threads) {
    static thread_local Buffer<float> scratch;
    static thread_local std::vector<LossSums> rows;
    rows.assign(static_cast<std::size_t>(images.height), LossSums{});
    // a band recomputes ten rows at either end, so bands are few: one a thread; they begin at
    // whole blocks of rows, so that every row is computed alike whatever the bands
    const int64_t bands = std::max<int64_t>(1, std::min<int64_t>(threads, images.height / 32));
    const int64_t size = loss_scratch(images.width);
    float* memory = scratch.fit(size * bands);
    LossSums* sums = rows.data();
    const auto start = [&](int64_t b) {
        const int64_t row = images.height * b / bands;
        return static_cast<int32_t>(b == bands ? row : row / LOSS_BLOCK * LOSS_BLOCK);
    };
    parallel(threads, bands, [&](int64_t b) {
        kernels.loss(images, start(b), start(b + 1), sums, memory + size * b);
    });
    LossSums total{};
    for (const LossSums& r : rows) {
        total.l1 += r.l1;
        total.weighted += r.weighted;
        total.ssim += r.ssim;
        total.weighted_ssim += r.weighted_ssim;
    }
    return total;
}

}  // namespace mattgs
