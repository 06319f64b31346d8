// A loop of nothing but fused multiply-adds: what one core can do at most, to measure others by.
#include "engine.h"
#include "kernels.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

constexpr int CHAINS = 10;  // independent: more than latency times units, fewer than registers

}  // namespace

double multiply_add(int64_t rounds, float* sink) {
    F v[CHAINS];
    for (int k = 0; k < CHAINS; ++k) v[k] = all(1.0f + (float)k);
    const F a = all(sink[0]), b = all(sink[1]);
    for (int64_t i = 0; i < rounds; ++i)
        for (int k = 0; k < CHAINS; ++k) v[k] = v[k] * a + b;
    F sum = v[0];
    for (int k = 1; k < CHAINS; ++k) sum += v[k];
    sink[2] = sum[0];
    return 2.0 * CHAINS * LANES * (double)rounds;
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
