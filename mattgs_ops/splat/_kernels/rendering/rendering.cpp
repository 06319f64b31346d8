#include "rendering/rendering.h"

#include <algorithm>
#include <atomic>
#include <numeric>
#include <utility>

#include "rendering/stopwatch.h"
#include "rendering/threads.h"

namespace mattgs {
namespace {

constexpr int64_t SPLATS_PER_TASK = 1024;
constexpr int64_t MOST_LANES = 16;

int64_t ceil_div(int64_t a, int64_t b) { return (a + b - 1) / b; }

}  // namespace

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
        // never null, also where nothing is visible: tiles take null for three channels
        float* sorted = w.extra.fit(std::max<int64_t>(visible_, 1));
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

}  // namespace mattgs
