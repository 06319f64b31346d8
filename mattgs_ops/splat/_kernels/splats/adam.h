// Adam (Kingma and Ba 2015): `count` values of one kind, one pass over memory.
#pragma once

#include "engine.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

struct Moving {
    float* values;
    const float* grads;
    float* first_moments;
    float* second_moments;
};

// What one kind of value needs, worked out once: m and v move by shares of their distance from the
// gradient and its square, and the corrections of both go into one factor.
struct Rates {
    F share1, share2, factor, epsilon;
};

MATTGS_INLINE Rates rates_of(const AdamSettings& s, float rate) {
    const float root = __builtin_sqrtf(s.correction2);
    return {all(1.0f - s.beta1), all(1.0f - s.beta2), all(rate * s.correction1 / root),
            all(s.epsilon / root)};
}

MATTGS_INLINE void update(const Rates& r, F& value, F grad, F& m, F& v) {
    m = m + (grad - m) * r.share1;
    v = v + (grad * grad - v) * r.share2;
    value -= r.factor * m / (sqrt(v) + r.epsilon);
}

MATTGS_INLINE void update_all(const AdamSettings& s, float rate, const Moving& p, int64_t count) {
    const Rates r = rates_of(s, rate);
    int64_t i = 0;
    for (; i + LANES <= count; i += LANES) {
        F value = load(p.values + i), m = load(p.first_moments + i), v = load(p.second_moments + i);
        update(r, value, load(p.grads + i), m, v);
        store(p.values + i, value);
        store(p.first_moments + i, m);
        store(p.second_moments + i, v);
    }
    if (i == count) return;
    float rest[4][LANES] = {};
    const float* in[4] = {p.values, p.grads, p.first_moments, p.second_moments};
    for (int k = 0; k < 4; ++k)
        for (int64_t j = i; j < count; ++j) rest[k][j - i] = in[k][j];
    F value = load(rest[0]), m = load(rest[2]), v = load(rest[3]);
    update(r, value, load(rest[1]), m, v);
    for (int64_t j = i; j < count; ++j) {
        p.values[j] = value[j - i];
        p.first_moments[j] = m[j - i];
        p.second_moments[j] = v[j - i];
    }
}

}  // namespace
}  // namespace MATTGS_ISA
}  // namespace mattgs
