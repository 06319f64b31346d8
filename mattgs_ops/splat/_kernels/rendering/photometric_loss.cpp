#include "rendering/photometric_loss.h"

#include <algorithm>
#include <vector>

#include "rendering/buffer.h"
#include "rendering/threads.h"

namespace mattgs {

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
