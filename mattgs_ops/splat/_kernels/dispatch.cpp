// Which instruction sets were compiled in, and which of them this CPU has.
#include <cstring>

#include "engine.h"

namespace mattgs {

#if defined(__x86_64__)
namespace avx512 {
const Kernels& table();
}
namespace avx2 {
const Kernels& table();
}
#endif
namespace baseline {  // SSE2 on x86-64, NEON on aarch64
const Kernels& table();
}

namespace {

bool runs_here(const char* name) {
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (!std::strcmp(name, "avx512"))
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
               __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
               __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    if (!std::strcmp(name, "avx2"))
        return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#endif
    return !std::strcmp(name, "baseline");
}

}  // namespace

const Kernels* choose_kernels(const char* name) {
    const Kernels& (*const tables[])() = {
#if defined(__x86_64__)
        &avx512::table, &avx2::table,
#endif
        &baseline::table,  // best first
    };
    for (const auto table : tables) {
        const Kernels& kernels = table();
        if ((!name || !std::strcmp(name, kernels.name)) && runs_here(kernels.name)) return &kernels;
    }
    return nullptr;
}

}  // namespace mattgs
