// Results of one rendering, and the passes over its memory.
#pragma once

#include <array>
#include <memory>

#include "engine.h"
#include "rendering/workspace.h"

namespace mattgs {

struct RenderOutputs {
    float *image, *alpha, *radii, *means2d;  // image [height, width, channels()]
    float* extents = nullptr;               // see ProjectOutputs
};

struct BackwardInputs {
    const float *grad_image, *grad_alpha, *pixel_map;
};

// One rendering: what backward() needs to know of it.
class Rendering {
public:
    // `differentiable`: whether one of the ways back will follow.
    Rendering(const Kernels& kernels, const Camera& camera, const float background[3],
              int sh_degree, int threads, bool differentiable);
    ~Rendering();
    Rendering(const Rendering&) = delete;
    Rendering& operator=(const Rendering&) = delete;

    // Returns the number of splats with a NaN or infinite parameter; if any, nothing was drawn.
    // `extra` [n], unless null, is composited as a fourth channel.
    int64_t forward(const SplatArrays<const float>& splats, const RenderOutputs& out,
                    const float* extra = nullptr);
    // `camera` [CAMERA_SUMS] or null.
    void backward(const SplatArrays<const float>& splats, const BackwardInputs& in,
                  const GradientOutputs& out, bool statistics, double* camera = nullptr);
    // The same with a step of Adam, see Kernels::descend; not with an extra channel.
    uint32_t descend(const BackwardInputs& in, const Descent& to, const SplatStatistics& seen,
                     bool statistics);

    int64_t count() const { return count_; }
    bool differentiable() const { return differentiable_; }
    const Camera& camera() const { return camera_; }
    bool plain() const { return camera_.conventions.plain_colours; }
    bool uses_rest() const { return !plain() && sh_degree_ > 0; }
    int channels() const { return extra_ ? COLOURS + 1 : COLOURS; }
    int64_t pairs() const { return pair_count_; }
    int64_t evaluated() const;  // splat-pixel pairs looked at, both sides of the ellipse's rim
    int64_t bytes() const { return work_->bytes(); }
    // Seconds of the latest passes: project, sort, bin, forward; backward, project_backward.
    const std::array<double, 6>& seconds() const { return seconds_; }

private:
    int64_t project(const SplatArrays<const float>& splats, const RenderOutputs& out);
    void sort();
    void bin(float* radii);
    void scatter();
    SplatSums composite_back(const BackwardInputs& in, bool statistics);
    TileView tile(int64_t t) const;

    const Kernels& kernels_;
    Camera camera_;
    float background_[3];
    int sh_degree_, threads_;
    bool differentiable_, extra_ = false;
    int32_t tiles_x_, tiles_y_;
    int64_t count_ = 0, visible_ = 0, pair_count_ = 0;
    std::unique_ptr<Workspace> work_;
    std::array<double, 6> seconds_{};
};

// Sorts by the upper 32 bits, stable; the result is in `keys` or `spare`, which is returned.
uint64_t* radix_sort(uint64_t* keys, uint64_t* spare, int64_t count);

}  // namespace mattgs
