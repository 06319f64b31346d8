// Python bindings, and the choice among the instruction sets that were compiled in.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <limits>
#include <string>
#include <vector>

#include "nearest.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace descriptors {
namespace {

using Descriptors = nb::ndarray<const uint8_t, nb::shape<-1, LENGTH>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

struct Variant {
    const char* name;
    void (*nearest)(const Job&);
};

// Those that run on this processor, the fastest first.
std::vector<Variant> variants() {
    std::vector<Variant> found;
#if defined(__x86_64__)
    __builtin_cpu_init();
    const bool wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq");
    if (wide && __builtin_cpu_supports("avx512vnni")) found.push_back({"vnni", vnni::nearest});
    if (wide) found.push_back({"avx512", avx512::nearest});
    if (__builtin_cpu_supports("avx2")) found.push_back({"avx2", avx2::nearest});
#endif
    found.push_back({"baseline", baseline::nearest});
    return found;
}

void nearest(const Descriptors& rows, const Descriptors& columns, const Out& column,
             const Out& best, const Out& second, const std::string& name) {
    for (const Out* out : {&column, &best, &second})
        if (out->shape(0) != rows.shape(0)) throw nb::value_error("results: unexpected length");
    if (columns.shape(0) > std::size_t(std::numeric_limits<int32_t>::max() / 2))
        throw nb::value_error("columns: too many");
    const Job job{rows.data(), int64_t(rows.shape(0)), columns.data(), int64_t(columns.shape(0)),
                  column.data(), best.data(), second.data()};
    for (const Variant& variant : variants())
        if (name.empty() || name == variant.name) {
            nb::gil_scoped_release release;
            variant.nearest(job);
            return;
        }
    throw nb::value_error("instruction set: not available on this processor");
}

}  // namespace
}  // namespace descriptors

NB_MODULE(_descriptors, module) {
    module.def("instruction_sets", [] {
        std::vector<std::string> names;
        for (const auto& variant : descriptors::variants()) names.emplace_back(variant.name);
        return names;
    });
    module.def("nearest", descriptors::nearest, "rows"_a, "columns"_a, "column"_a, "best"_a,
               "second"_a, "instruction_set"_a = "");
}
