// Adam (Kingma and Ba 2015), one pass over memory.
#include "engine.h"
#include "kernels.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

MATTGS_INLINE void update(const AdamStep& s, F& value, F grad, F& m, F& v) {
    m = m + (grad - m) * (1.0f - s.beta1);
    v = v + (grad * grad - v) * (1.0f - s.beta2);
    value -= s.rate * s.correction1 * m / (sqrt(v * s.correction2) + s.epsilon);
}

}  // namespace

void adam(const AdamStep& s) {
    int64_t i = 0;
    for (; i + LANES <= s.count; i += LANES) {
        F value = load(s.values + i), m = load(s.first_moments + i), v = load(s.second_moments + i);
        update(s, value, load(s.grads + i), m, v);
        store(s.values + i, value);
        store(s.first_moments + i, m);
        store(s.second_moments + i, v);
    }
    if (i == s.count) return;
    float rest[4][LANES] = {};
    const float* in[4] = {s.values, s.grads, s.first_moments, s.second_moments};
    for (int k = 0; k < 4; ++k)
        for (int64_t j = i; j < s.count; ++j) rest[k][j - i] = in[k][j];
    F value = load(rest[0]), m = load(rest[2]), v = load(rest[3]);
    update(s, value, load(rest[1]), m, v);
    for (int64_t j = i; j < s.count; ++j) {
        s.values[j] = value[j - i];
        s.first_moments[j] = m[j - i];
        s.second_moments[j] = v[j - i];
    }
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
