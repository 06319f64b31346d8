// Drives the kernels without Python, built with address and undefined-behaviour sanitizers: random
// and degenerate scenes of awkward sizes, every instruction set that this machine has, and vectors
// of 16 lanes on any machine: AVX-512's, else in baseline instructions (MATTGS_WIDE). Exits with 1
// and says where when a result is not finite, or when two instruction sets or thread counts disagree.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "rendering/photometric_loss.h"
#include "rendering/rendering.h"

namespace mattgs::wide { const Kernels& table(); }  // 16 lanes in baseline instructions

namespace {

using namespace mattgs;
using Floats = std::vector<float>;

int failures = 0;

void expect(bool ok, const std::string& what) {
    if (ok) return;
    std::printf("FAILED: %s\n", what.c_str());
    ++failures;
}

bool finite(const Floats& v) {
    return std::all_of(v.begin(), v.end(), [](float x) { return std::isfinite(x); });
}

bool close(const Floats& a, const Floats& b) {
    float most = 0;
    for (const float x : a) most = std::max(most, std::fabs(x));
    for (std::size_t i = 0; i < a.size(); ++i)
        if (std::fabs(a[i] - b[i]) > 2e-3f * (std::fabs(a[i]) + 0.02f * most) + 1e-6f) return false;
    return true;
}

struct Scene {
    Floats means, log_scales, quaternions, logits, dc, rest;
    int64_t count;

    Scene(std::mt19937& rng, int64_t n, float spread, float scale, float logit) : count(n) {
        std::normal_distribution<float> normal;
        const auto fill = [&](Floats& v, int64_t size, float by, float plus) {
            v.resize(static_cast<std::size_t>(size));
            for (float& x : v) x = plus + by * normal(rng);
        };
        fill(means, 3 * n, spread, 0);
        fill(log_scales, 3 * n, 0.7f, scale);
        fill(quaternions, 4 * n, 1, 0);
        fill(logits, n, 1.5f, logit);
        fill(dc, 3 * n, 1, 0);
        fill(rest, 45 * n, 0.3f, 0);
    }

    SplatArrays<float> mutable_arrays() {
        return {means.data(),  log_scales.data(), quaternions.data(),
                logits.data(), dc.data(),         rest.data(),
                count};
    }

    SplatArrays<const float> arrays() const {
        return {means.data(),  log_scales.data(), quaternions.data(),
                logits.data(), dc.data(),         rest.data(),
                count};
    }
};

Camera camera(int width, int height) {
    Camera c{};
    c.rotation[0] = c.rotation[4] = c.rotation[8] = 1;
    c.translation[2] = 4;
    c.centre[2] = -4;
    c.fx = c.fy = 1.2f * static_cast<float>(std::max(width, height));
    c.cx = 0.52f * static_cast<float>(width);
    c.cy = 0.47f * static_cast<float>(height);
    c.width = width;
    c.height = height;
    c.x_low = c.y_low = -0.6f;
    c.x_high = c.y_high = 0.6f;
    return c;
}

struct Result {
    Floats image, means, log_scales, quaternions, logits, dc, rest, statistics;
};

// One step from moments of zero moves each value by the rate, against its gradient's sign.
void check_descent(Rendering& rendering, const Scene& scene, const BackwardInputs& pixels,
                   const Result& r, bool statistics) {
    Scene moved = scene, first = scene, second = scene;
    for (Scene* s : {&first, &second})
        for (Floats* v : {&s->means, &s->log_scales, &s->quaternions, &s->logits, &s->dc, &s->rest})
            std::fill(v->begin(), v->end(), 0.0f);
    const auto n = static_cast<std::size_t>(scene.count);
    Floats centres(2 * n), absolute(2 * n), weight(n), weighted(n);
    const Descent to{moved.mutable_arrays(),
                     first.mutable_arrays(),
                     second.mutable_arrays(),
                     {0.1f, 0.1f, 0.1f, 0.1f, 0.1f, 0.1f},
                     {0.9f, 0.999f, 1e-15f, 10.0f, 1000.0f}};
    const uint32_t broken = rendering.descend(
        pixels, to, {centres.data(), absolute.data(), weight.data(), weighted.data()}, statistics);
    expect(broken == 0, "a gradient was taken for not finite");
    const auto stepped = [](const Floats& from, const Floats& by, const Floats& at) {
        for (std::size_t i = 0; i < from.size(); ++i) {
            const float least = 1e-6f * std::fabs(from[i]);  // where rounding swallows a step
            const float size = std::fabs(by[i]);  // beyond these, epsilon or an overflow counts
            if (size > 1e-10f && size < 1e15f && least < 0.01f &&
                std::fabs(from[i] - std::copysign(0.1f, by[i]) - at[i]) > 1e-3f + least)
                return false;
        }
        return true;
    };
    expect(stepped(scene.means, r.means, moved.means), "step of means");
    expect(stepped(scene.log_scales, r.log_scales, moved.log_scales), "step of scales");
    expect(stepped(scene.quaternions, r.quaternions, moved.quaternions), "step of quaternions");
    expect(stepped(scene.logits, r.logits, moved.logits), "step of opacities");
    expect(stepped(scene.dc, r.dc, moved.dc), "step of colours");
    expect(stepped(scene.rest, r.rest, moved.rest), "step of spherical harmonics");
}

Result run(const Kernels& kernels, const Scene& s, const Camera& c, int threads, bool statistics) {
    const auto size = static_cast<std::size_t>(c.width) * c.height;
    const auto n = static_cast<std::size_t>(s.count);
    const float background[3] = {0.9f, 0.4f, 0.2f};
    Rendering rendering(kernels, c, background, 3, threads, true);
    Result r;
    r.image.resize(3 * size);
    Floats alpha(size), radii(n), means2d(2 * n);
    const int64_t bad =
        rendering.forward(s.arrays(), {r.image.data(), alpha.data(), radii.data(), means2d.data()});
    expect(bad == 0, "a splat was taken for not finite");
    expect(rendering.evaluated() >= 0, "count of pairs");
    Floats grad(3 * size), map(size, 0.5f);
    // of one sign, so that sums of colour do not cancel down to their rounding errors
    for (std::size_t i = 0; i < grad.size(); ++i)
        grad[i] = 1.0f + 0.5f * std::sin(static_cast<float>(i));
    r.means.resize(3 * n);
    r.log_scales.resize(3 * n);
    r.quaternions.resize(4 * n);
    r.logits.resize(n);
    r.dc.resize(3 * n);
    r.rest.resize(45 * n);
    Floats absolute(2 * n), weight(n), weighted(n);
    const SplatArrays<float> out{r.means.data(),  r.log_scales.data(), r.quaternions.data(),
                                 r.logits.data(), r.dc.data(),         r.rest.data(),
                                 s.count};
    const SplatStatistics seen{means2d.data(), absolute.data(), weight.data(), weighted.data()};
    const BackwardInputs pixels{grad.data(), alpha.data(), map.data()};
    rendering.backward(s.arrays(), pixels, {out, nullptr, seen}, statistics);
    r.statistics = absolute;
    r.statistics.insert(r.statistics.end(), weight.begin(), weight.end());
    r.statistics.insert(r.statistics.end(), weighted.begin(), weighted.end());
    for (const Floats* v : {&r.image, &alpha, &radii, &means2d, &r.means, &r.log_scales,
                            &r.quaternions, &r.logits, &r.dc, &r.rest, &r.statistics})
        expect(finite(*v), std::string(kernels.name) + ": a result is not finite");
    check_descent(rendering, s, pixels, r, statistics);
    return r;
}

void check_scene(const std::vector<const Kernels*>& all, const Scene& s, int width, int height,
                 const std::string& name) {
    const Camera c = camera(width, height);
    const Result first = run(*all[0], s, c, 1, true);
    for (const Kernels* k : all)
        for (const int threads : {1, 3}) {
            const Result r = run(*k, s, c, threads, threads == 1);
            const std::string where = name + ", " + k->name + ", threads " + std::to_string(threads);
            if (k == all[0]) {
                expect(r.image == first.image && r.means == first.means && r.rest == first.rest,
                       where + ": other bits");
                continue;
            }
            // a pixel at the 1/255 cut may fall on either side of it
            std::size_t different = 0;
            for (std::size_t i = 0; i < r.image.size(); ++i)
                different += std::fabs(r.image[i] - first.image[i]) > 1e-4f;
            expect(different <= r.image.size() / 1000 + 3, where + ": another image");
            if (different == 0) {
                expect(close(first.means, r.means), where + ": another gradient of means");
                expect(close(first.logits, r.logits), where + ": another gradient of opacity");
                expect(close(first.rest, r.rest), where + ": another gradient of colour");
            }
        }
}

// The other conventions: parameters after their activation, a fourth channel, sums for the camera.
void check_other_conventions(const std::vector<const Kernels*>& all, Scene s, bool plain,
                             const std::string& name) {
    for (float& x : s.log_scales) x = std::exp(std::min(x, 40.0f));
    for (float& x : s.logits) x = 1.0f / (1.0f + std::exp(-x));
    Camera c = camera(61, 45);
    c.conventions.near_plane = 0.01f;
    c.conventions.far_plane = 1e10f;
    c.conventions.alpha_max = 0.999f;
    c.conventions.plain_colours = plain;
    c.conventions.activated = c.conventions.centres_apart = true;
    const auto size = static_cast<std::size_t>(c.width) * c.height;
    const auto n = static_cast<std::size_t>(s.count);
    const float background[3] = {0, 0, 0};
    Floats expected;
    for (const Kernels* k : all)
        for (const bool statistics : {true, false}) {
            Rendering rendering(*k, c, background, 3, statistics ? 1 : 3, true);
            Floats image(4 * size), alpha(size), radii(n), centres(2 * n), extents(2 * n), grads(n);
            auto in = s.arrays();
            if (plain) in.sh_rest = nullptr;
            const int64_t bad = rendering.forward(
                in, {image.data(), alpha.data(), radii.data(), centres.data(), extents.data()},
                s.dc.data());
            expect(bad == 0, name + ": a splat was taken for not finite");
            Scene out = s;
            auto to = out.mutable_arrays();
            if (plain) to.sh_rest = nullptr;
            const std::size_t kept = statistics ? n : 0;
            Floats absolute(2 * kept), weight(kept), weighted(kept);
            double sums[CAMERA_SUMS];
            rendering.backward(
                in, {image.data(), alpha.data(), nullptr},
                {to, grads.data(),
                 {centres.data(), absolute.data(), weight.data(), weighted.data()}},
                statistics, sums);
            for (const Floats* v : {&image, &alpha, &extents, &out.means, &out.log_scales,
                                    &out.quaternions, &out.logits, &out.dc, &grads, &absolute})
                expect(finite(*v), name + ", " + k->name + ": a result is not finite");
            for (const double x : sums)
                expect(std::isfinite(x), name + ": a sum for the camera is not finite");
            if (expected.empty()) expected = out.dc;
            expect(close(expected, out.dc), name + ", " + k->name + ": another gradient");
        }
}

void check_loss(const std::vector<const Kernels*>& all, std::mt19937& rng, int width, int height) {
    std::uniform_real_distribution<float> uniform;
    const auto size = static_cast<std::size_t>(width) * height;
    Floats image(3 * size), target(3 * size), weight(size), expected;
    for (Floats* v : {&image, &target, &weight})
        for (float& x : *v) x = uniform(rng);
    for (const Kernels* k : all)
        for (const int threads : {1, 2}) {
            Floats grad(3 * size);
            const LossImages images{image.data(), target.data(), threads == 1 ? weight.data() : nullptr,
                                    true,         width,        height,        0.2f,
                                    grad.data()};
            const LossSums sums = photometric_loss(*k, images, threads);
            expect(std::isfinite(sums.l1 + sums.ssim + sums.weighted), "loss is not finite");
            expect(finite(grad), "gradient of the loss is not finite");
            if (threads > 1) continue;
            if (expected.empty()) expected = grad;
            expect(close(expected, grad), std::string(k->name) + ": another gradient of the loss");
        }
}

}  // namespace

int main() {
    std::vector<const Kernels*> all = {choose_kernels("baseline")};
    for (const char* name : {"avx2", "avx512"})
        if (const Kernels* k = choose_kernels(name)) all.push_back(k);
#ifdef MATTGS_WIDE
    all.push_back(&wide::table());
#endif
    expect(all.back()->lanes == 16, "no vectors of 16 lanes were checked");
    std::mt19937 rng(7);
    const int sizes[][2] = {{1, 1}, {1, 70}, {70, 1}, {32, 32}, {33, 31}, {45, 38}, {100, 67}};
    for (const auto& size : sizes) {
        const std::string at = std::to_string(size[0]) + "x" + std::to_string(size[1]);
        check_scene(all, Scene(rng, 40, 0.7f, -2.0f, 0.0f), size[0], size[1], "random " + at);
        check_loss(all, rng, size[0], size[1]);
    }
    check_scene(all, Scene(rng, 0, 1, 0, 0), 40, 40, "empty");
    check_scene(all, Scene(rng, 700, 0.7f, -3.5f, 0.0f), 150, 90, "many");
    check_scene(all, Scene(rng, 300, 0.3f, -1.0f, 4.0f), 64, 64, "opaque");
    check_scene(all, Scene(rng, 30, 0.7f, -15.0f, 0.0f), 50, 50, "tiny");
    check_scene(all, Scene(rng, 30, 0.7f, 4.0f, 0.0f), 50, 50, "huge");
    check_scene(all, Scene(rng, 30, 0.7f, 60.0f, 0.0f), 50, 50, "beyond the limit of scales");
    check_scene(all, Scene(rng, 60, 1e4f, 0.0f, 0.0f), 50, 50, "far away");
    check_scene(all, Scene(rng, 60, 1e18f, 5.0f, 0.0f), 50, 50, "at the end of the world");
    check_scene(all, Scene(rng, 30, 0.7f, -2.0f, 90.0f), 50, 50, "opacity 1");
    check_scene(all, Scene(rng, 30, 0.7f, -2.0f, -90.0f), 50, 50, "opacity 0");
    for (const bool plain : {true, false}) {
        check_other_conventions(all, Scene(rng, 90, 0.7f, -2.0f, 0.0f), plain, "activated");
        check_other_conventions(all, Scene(rng, 0, 0.7f, -2.0f, 0.0f), plain, "activated, none");
        check_other_conventions(all, Scene(rng, 30, 0.7f, 60.0f, 90.0f), plain, "activated, huge");
    }
    Scene needles(rng, 40, 0.7f, -9.0f, 1.0f);
    for (std::size_t i = 0; i < needles.log_scales.size(); i += 3) needles.log_scales[i] = 1.0f;
    check_scene(all, needles, 60, 60, "needles");
    for (float& x : needles.quaternions) x = 0;
    check_scene(all, needles, 60, 60, "quaternions without length");
    if (!failures) std::printf("%zu instruction sets agree\n", all.size());
    return failures ? EXIT_FAILURE : EXIT_SUCCESS;
}
