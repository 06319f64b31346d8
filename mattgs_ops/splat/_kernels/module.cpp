// Python bindings: plain buffers in, plain buffers out. Shapes are checked here a second time, so
// that no caller can make the kernels read beyond an array; messages for people are Python's job.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <array>
#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <tuple>

#include "rendering/photometric_loss.h"
#include "rendering/rendering.h"
#include "rendering/threads.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace mattgs {
namespace {

using In = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<float, nb::c_contig, nb::device::cpu>;
using Sums = nb::ndarray<double, nb::c_contig, nb::device::cpu>;
using SplatsIn = std::tuple<In, In, In, In, In, In>;
using SplatsOut = std::tuple<Out, Out, Out, Out, Out, Out>;
using StatisticsOut = std::tuple<Out, Out, Out, Out>;

const Kernels* active = nullptr;
constexpr int MAX_THREADS = 1024;

template <class Array>
auto data_of(const Array& a, std::initializer_list<int64_t> shape, const char* name) {
    bool same = a.ndim() == shape.size();
    std::size_t i = 0;
    for (const int64_t n : shape) same = same && static_cast<int64_t>(a.shape(i++)) == n;
    if (!same) throw nb::value_error((std::string(name) + ": unexpected shape").c_str());
    return a.data();
}

template <class T, class Tuple>
SplatArrays<T> splats_of(const Tuple& t) {
    const auto& means = std::get<0>(t);
    if (means.ndim() != 2) throw nb::value_error("means: unexpected shape");
    const int64_t n = static_cast<int64_t>(means.shape(0));
    return {data_of(means, {n, 3}, "means"),
            data_of(std::get<1>(t), {n, 3}, "log_scales"),
            data_of(std::get<2>(t), {n, 4}, "quaternions"),
            data_of(std::get<3>(t), {n}, "opacity_logits"),
            data_of(std::get<4>(t), {n, 3}, "sh_dc"),
            // none where nothing depends on the direction of view
            std::get<5>(t).shape(0) ? data_of(std::get<5>(t), {n, SH_REST, 3}, "sh_rest") : nullptr,
            n};
}

int checked_threads(int threads) {
    if (threads < 1 || threads > MAX_THREADS) throw nb::value_error("threads: expected 1 to 1024");
    return threads;
}

// World to camera as 9 + 3 floats; fx, fy, cx, cy.
Camera camera_of(const std::array<double, 9>& r, const std::array<double, 3>& t,
                 const std::array<double, 4>& k, int width, int height) {
    if (width < 1 || height < 1 || width > MAX_SIDE || height > MAX_SIDE)
        throw nb::value_error("camera: expected 1 to 32768 pixels a side");
    Camera c{};
    for (int i = 0; i < 9; ++i) c.rotation[i] = static_cast<float>(r[i]);
    for (int i = 0; i < 3; ++i) {
        c.translation[i] = static_cast<float>(t[i]);
        c.centre[i] = static_cast<float>(-(r[i] * t[0] + r[3 + i] * t[1] + r[6 + i] * t[2]));
    }
    c.fx = static_cast<float>(k[0]);
    c.fy = static_cast<float>(k[1]);
    c.cx = static_cast<float>(k[2]);
    c.cy = static_cast<float>(k[3]);
    c.width = width;
    c.height = height;
    const double half_x = 0.5 * width / k[0], half_y = 0.5 * height / k[1];
    c.x_low = static_cast<float>(-k[2] / k[0] - FOV_MARGIN * half_x);
    c.x_high = static_cast<float>((width - k[2]) / k[0] + FOV_MARGIN * half_x);
    c.y_low = static_cast<float>(-k[3] / k[1] - FOV_MARGIN * half_y);
    c.y_high = static_cast<float>((height - k[3]) / k[1] + FOV_MARGIN * half_y);
    return c;
}

// What gsplat does: parameters after their activation; the camera's centre; near plane, far plane,
// low pass, largest alpha, radius clip; and whether colours are plain.
using OtherConventionsIn = std::tuple<std::array<double, 3>, std::array<double, 5>, bool>;

void take_conventions(Camera& c, const OtherConventionsIn& given) {
    const auto& [centre, limits, plain_colours] = given;
    for (int i = 0; i < 3; ++i) c.centre[i] = static_cast<float>(centre[i]);
    Conventions& to = c.conventions;
    to.near_plane = static_cast<float>(limits[0]);
    to.far_plane = static_cast<float>(limits[1]);
    to.low_pass = static_cast<float>(limits[2]);
    to.alpha_max = static_cast<float>(limits[3]);
    to.radius_clip = static_cast<float>(limits[4]);
    to.plain_colours = plain_colours;
    to.activated = to.centres_apart = true;
}

void render(Rendering& rendering, const SplatsIn& splats, const Out& image, const Out& alpha,
            const Out& radii, const Out& means2d, const std::optional<Out>& extents,
            const std::optional<In>& extra, int64_t* bad) {
    const auto s = splats_of<const float>(splats);
    const Camera& c = rendering.camera();
    if (!s.sh_rest && s.count && rendering.uses_rest())
        throw nb::value_error("sh_rest: expected coefficients");
    const RenderOutputs out{
        data_of(image, {c.height, c.width, extra ? COLOURS + 1 : COLOURS}, "image"),
        data_of(alpha, {c.height, c.width}, "alpha"), data_of(radii, {s.count}, "radii"),
        data_of(means2d, {s.count, 2}, "means2d"),
        extents ? data_of(*extents, {s.count, 2}, "extents") : nullptr};
    const float* fourth = extra ? data_of(*extra, {s.count}, "extra") : nullptr;
    const nb::gil_scoped_release release;
    *bad = rendering.forward(s, out, fourth);
}

AdamSettings adam_settings(const std::array<double, 5>& settings, int64_t step) {
    const double beta1 = settings[0], beta2 = settings[1], epsilon = settings[2];
    const auto correction = [&](double beta) {
        return static_cast<float>(1.0 / (1.0 - std::pow(beta, static_cast<double>(step))));
    };
    return {static_cast<float>(beta1), static_cast<float>(beta2), static_cast<float>(epsilon),
            correction(beta1), correction(beta2)};
}

BackwardInputs pixels_of(const Rendering& rendering, int64_t count, const In& grad_image,
                         const std::optional<In>& grad_alpha,
                         const std::optional<In>& pixel_map) {
    if (count != rendering.count())
        throw nb::value_error("another number of splats than was rendered");
    if (!rendering.differentiable()) throw nb::value_error("rendered without a way back");
    const Camera& c = rendering.camera();
    BackwardInputs in{data_of(grad_image, {c.height, c.width, rendering.channels()}, "grad_image"),
                      nullptr, nullptr};
    if (grad_alpha) in.grad_alpha = data_of(*grad_alpha, {c.height, c.width}, "grad_alpha");
    if (pixel_map) in.pixel_map = data_of(*pixel_map, {c.height, c.width}, "pixel_map");
    return in;
}

SplatStatistics statistics_of(const StatisticsOut& seen, int64_t count, bool statistics) {
    const int64_t kept = statistics ? count : 0;
    return {data_of(std::get<0>(seen), {count, 2}, "means2d"),
            data_of(std::get<1>(seen), {kept, 2}, "means2d_abs"),
            data_of(std::get<2>(seen), {kept}, "weight"),
            data_of(std::get<3>(seen), {kept}, "weighted_map")};
}

void backward(Rendering& rendering, const SplatsIn& splats, const In& grad_image,
              const std::optional<In>& grad_alpha, const std::optional<In>& pixel_map,
              const SplatsOut& grads, const StatisticsOut& seen, bool statistics,
              const std::optional<Out>& grad_extra, const std::optional<Sums>& grad_camera) {
    const auto s = splats_of<const float>(splats);
    const auto out = splats_of<float>(grads);
    const BackwardInputs in = pixels_of(rendering, s.count, grad_image, grad_alpha, pixel_map);
    const GradientOutputs to{out,
                             grad_extra ? data_of(*grad_extra, {s.count}, "grad_extra") : nullptr,
                             statistics_of(seen, s.count, statistics)};
    double* camera = grad_camera ? data_of(*grad_camera, {CAMERA_SUMS}, "grad_camera") : nullptr;
    if (out.count != s.count) throw nb::value_error("gradients: unexpected shape");
    const nb::gil_scoped_release release;
    rendering.backward(s, in, to, statistics, camera);
}

uint32_t descend(Rendering& rendering, const SplatsOut& splats, const In& grad_image,
                 const std::optional<In>& grad_alpha, const std::optional<In>& pixel_map,
                 const SplatsOut& first, const SplatsOut& second, const std::array<double, FIELDS>& rates,
                 // beta1, beta2, epsilon; weights of opacities and of scales in the loss
                 const std::array<double, 5>& settings, int64_t step, const StatisticsOut& seen,
                 bool statistics) {
    Descent to{splats_of<float>(splats), splats_of<float>(first), splats_of<float>(second), {},
               adam_settings(settings, step), static_cast<float>(settings[3]),
               static_cast<float>(settings[4])};
    const int64_t count = to.values.count;
    if (to.first_moments.count != count || to.second_moments.count != count)
        throw nb::value_error("moments: unexpected shape");
    for (const auto* s : {&to.values, &to.first_moments, &to.second_moments})
        if (count && !s->sh_rest) throw nb::value_error("sh_rest: unexpected shape");
    std::copy(rates.begin(), rates.end(), to.rates);
    if (rendering.channels() != COLOURS || rendering.plain())
        throw nb::value_error("descend: expected a rendering of 3DGS's own kind");
    const BackwardInputs in = pixels_of(rendering, count, grad_image, grad_alpha, pixel_map);
    const SplatStatistics out = statistics_of(seen, count, statistics);
    const nb::gil_scoped_release release;
    return rendering.descend(in, to, out, statistics);
}

std::tuple<double, double, double, double> loss(const In& image, const In& target,
                                                const std::optional<In>& weight, bool weight_ssim,
                                                double ssim_lambda, int threads, const Out& grad) {
    if (image.ndim() != 3) throw nb::value_error("image: unexpected shape");
    const int64_t h = static_cast<int64_t>(image.shape(0));
    const int64_t w = static_cast<int64_t>(image.shape(1));
    if (h < 1 || w < 1) throw nb::value_error("image: expected at least one pixel");
    const LossImages images{data_of(image, {h, w, 3}, "image"),
                            data_of(target, {h, w, 3}, "target"),
                            weight ? data_of(*weight, {h, w}, "weight") : nullptr,
                            weight_ssim,
                            static_cast<int32_t>(w),
                            static_cast<int32_t>(h),
                            static_cast<float>(ssim_lambda),
                            data_of(grad, {h, w, 3}, "grad")};
    checked_threads(threads);
    const nb::gil_scoped_release release;
    const LossSums sums = photometric_loss(*active, images, threads);
    const double values = 3.0 * static_cast<double>(h) * static_cast<double>(w);
    return {sums.weighted / values, sums.l1 / values, sums.ssim / values,
            sums.weighted_ssim / values};
}

bool use(const std::string& name) {
    const Kernels* kernels = choose_kernels(name.c_str());
    if (kernels) active = kernels;
    return kernels != nullptr;
}

}  // namespace
}  // namespace mattgs

NB_MODULE(_engine, m) {
    using namespace mattgs;
    active = choose_kernels(nullptr);
    nb::set_leak_warnings(false);  // a graph of torch's may hold a rendering to the program's end
    m.attr("TILE") = TILE;
    m.def("instruction_set", [] { return std::string(active->name); });
    m.def("multiply_add", [](int64_t rounds) {
        float sink[3] = {0.999f, 0.001f, 0.0f};
        return active->multiply_add(rounds, sink);
    }, "rounds"_a);
    m.def("use_instruction_set", &use, "name"_a);
    nb::class_<Rendering>(m, "Rendering")
        .def(
            "__init__",
            [](Rendering* self, const std::array<double, 9>& r, const std::array<double, 3>& t,
               const std::array<double, 4>& k, int width, int height,
               const std::array<float, 3>& background, int sh_degree, int threads,
               bool differentiable, const std::optional<OtherConventionsIn>& conventions) {
                if (sh_degree < 0 || sh_degree > 3)
                    throw nb::value_error("sh_degree: expected 0 to 3");
                Camera camera = camera_of(r, t, k, width, height);
                if (conventions) take_conventions(camera, *conventions);
                new (self) Rendering(*active, camera, background.data(), sh_degree,
                                     checked_threads(threads), differentiable);
            },
            "rotation"_a, "translation"_a, "intrinsics"_a, "width"_a, "height"_a, "background"_a,
            "sh_degree"_a, "threads"_a, "differentiable"_a, "conventions"_a.none() = nb::none())
        .def("forward",
             [](Rendering& self, const SplatsIn& splats, const Out& image, const Out& alpha,
                const Out& radii, const Out& means2d, const std::optional<Out>& extents,
                const std::optional<In>& extra) {
                 int64_t bad = 0;
                 render(self, splats, image, alpha, radii, means2d, extents, extra, &bad);
                 return bad;
             },
             "splats"_a, "image"_a, "alpha"_a, "radii"_a, "means2d"_a,
             "extents"_a.none() = nb::none(), "extra"_a.none() = nb::none())
        .def("backward", &backward, nb::arg("splats"), nb::arg("grad_image"),
             nb::arg("grad_alpha").none(), nb::arg("pixel_map").none(), nb::arg("grads"),
             nb::arg("seen"), nb::arg("statistics"), nb::arg("grad_extra").none() = nb::none(),
             nb::arg("grad_camera").none() = nb::none())
        .def("descend", &descend, nb::arg("splats"), nb::arg("grad_image"),
             nb::arg("grad_alpha").none(), nb::arg("pixel_map").none(), nb::arg("first_moments"),
             nb::arg("second_moments"), nb::arg("rates"), nb::arg("settings"), nb::arg("step"),
             nb::arg("seen"), nb::arg("statistics"))
        .def_prop_ro("pairs", &Rendering::pairs)
        .def_prop_ro("evaluated", &Rendering::evaluated)
        .def_prop_ro("seconds", &Rendering::seconds)
        .def_prop_ro("workspace_bytes", &Rendering::bytes);
    m.def("photometric_loss", &loss, nb::arg("image"), nb::arg("target"), nb::arg("weight").none(),
          nb::arg("weight_ssim"), nb::arg("ssim_lambda"), nb::arg("threads"), nb::arg("grad"));
}
