// Vectors across pixels or splats, written with compiler vector types (GCC and Clang).
//
// Every translation unit that includes this header is compiled once per instruction set, inside a
// namespace of its own (MATTGS_ISA), and uses no inline function of the standard library: the
// linker could otherwise keep a copy with instructions that an older CPU does not have.
#pragma once

#include <cstdint>

#if defined(__AVX2__)
#include <immintrin.h>  // always-inline functions only
#endif

#ifndef MATTGS_ISA
#error "compile with -DMATTGS_ISA=<name of the instruction set>"
#endif
#ifndef MATTGS_LANES
#define MATTGS_LANES 8
#endif

#define MATTGS_INLINE inline __attribute__((always_inline))

namespace mattgs {
namespace MATTGS_ISA {
namespace {

constexpr int LANES = MATTGS_LANES;
constexpr float BROAD = 0.95f;  // greatest Projected::sx, see pixel.h

typedef float F __attribute__((vector_size(4 * MATTGS_LANES), may_alias));
typedef float FU __attribute__((vector_size(4 * MATTGS_LANES), aligned(4), may_alias));
typedef int32_t I __attribute__((vector_size(4 * MATTGS_LANES), may_alias));
typedef uint32_t U __attribute__((vector_size(4 * MATTGS_LANES), may_alias));  // wraps around
typedef int32_t IU __attribute__((vector_size(4 * MATTGS_LANES), aligned(4), may_alias));
typedef double D __attribute__((vector_size(8 * MATTGS_LANES), may_alias));

// x - 0 is x for every x, so that this folds to a broadcast (x + 0 would not, because of -0)
MATTGS_INLINE F all(float x) { return x - F{}; }
MATTGS_INLINE I all(int32_t x) { return x - I{}; }

MATTGS_INLINE F load(const float* p) { return *reinterpret_cast<const FU*>(p); }
MATTGS_INLINE I load(const int32_t* p) { return *reinterpret_cast<const IU*>(p); }
MATTGS_INLINE void store(float* p, F v) { *reinterpret_cast<FU*>(p) = v; }
MATTGS_INLINE void store(int32_t* p, I v) { *reinterpret_cast<IU*>(p) = v; }

// Asks for the cache lines of `count` floats at p, into the second-level cache: the first is too
// small for what is asked for this early.
MATTGS_INLINE void prefetch_floats(const float* p, int64_t count) {
    constexpr int LINE = 16;
    for (int64_t i = 0; i < count; i += LINE) __builtin_prefetch(p + i, 0, 2);
}

// The compilers turn these into two instructions unless told which one it is.
#if defined(__AVX2__) && MATTGS_LANES == 8
MATTGS_INLINE F min(F a, F b) { return (F)_mm256_min_ps((__m256)a, (__m256)b); }
MATTGS_INLINE F max(F a, F b) { return (F)_mm256_max_ps((__m256)a, (__m256)b); }
MATTGS_INLINE F select(I mask, F a, F b) {
    return (F)_mm256_blendv_ps((__m256)b, (__m256)a, (__m256)mask);
}
MATTGS_INLINE bool any(I mask) { return _mm256_movemask_ps((__m256)mask) != 0; }
#else
MATTGS_INLINE F min(F a, F b) { return a < b ? a : b; }
MATTGS_INLINE F max(F a, F b) { return a > b ? a : b; }
MATTGS_INLINE F select(I mask, F a, F b) { return mask ? a : b; }
// Whether a lane's sign bit is set, as it is in a comparison's true lanes.
MATTGS_INLINE bool any(I mask) {
    int32_t bits = 0;
    for (int i = 0; i < LANES; ++i) bits |= mask[i];
    return bits < 0;
}
#endif
MATTGS_INLINE F keep(F v, I mask) { return (F)((I)v & mask); }
MATTGS_INLINE F abs(F v) { return (F)((I)v & 0x7fffffff); }

MATTGS_INLINE I lanes_from(int32_t first) {
    I v;
    for (int i = 0; i < LANES; ++i) v[i] = first + i;
    return v;
}

MATTGS_INLINE F to_float(I v) { return __builtin_convertvector(v, F); }
MATTGS_INLINE I to_int(F v) { return __builtin_convertvector(v, I); }  // towards zero

MATTGS_INLINE F sqrt(F v) {
    F r;
    for (int i = 0; i < LANES; ++i) r[i] = __builtin_sqrtf(v[i]);
    return r;
}

MATTGS_INLINE F ceil(F v) {
    F r;
    for (int i = 0; i < LANES; ++i) r[i] = __builtin_ceilf(v[i]);
    return r;
}

// 2^p for p in [-126, 127], relative error below 3e-6 (minimax polynomial of degree 4 on half an
// octave to either side, found by Lawson's algorithm); other p give garbage, never a trap.
MATTGS_INLINE F exp2_fast(F p) {
    const float round = 12582912.0f;  // 1.5 * 2^23: adding it rounds to an integer
    const F r = p + round;
    const F f = p - (r - round);
    F y = all(0.009570102207362652f);
    y = y * f + 0.05591786280274391f;
    y = y * f + 0.240247443318367f;
    y = y * f + 0.6931217908859253f;
    y = y * f + 0.9999992847442627f;
    return (F)((U)y + ((U)r << 23));
}

// Degree 5: relative error below 1.5e-7, as good as float32 gets. For vectors of any width.
template <class Vector, class Unsigned>
MATTGS_INLINE Vector exp2_fine(Vector p) {
    const float round = 12582912.0f;
    const Vector r = p + round;
    const Vector f = p - (r - round);
    Vector y = 0.0013276472454890609f * f + 0.009675541892647743f;
    y = y * f + 0.05550713092088699f;
    y = y * f + 0.24022120237350464f;
    y = y * f + 0.6931469440460205f;
    y = y * f + 1.0000001192092896f;
    return (Vector)((Unsigned)y + ((Unsigned)r << 23));
}

// e^x for finite x, clamped to [-87, 87]; relative error about 2e-7 (degree 6).
MATTGS_INLINE F exp_accurate(F x) {
    const float round = 12582912.0f;
    x = min(max(x, all(-87.0f)), all(87.0f));
    const F r = x * 1.44269504088896341f + round;
    const F n = r - round;
    F f = x - n * 0.693359375f;            // ln 2 in two parts (Cody and Waite)
    f = f - n * -2.12194440e-4f;
    F y = all(1.0f / 720.0f);
    y = y * f + 1.0f / 120.0f;
    y = y * f + 1.0f / 24.0f;
    y = y * f + 1.0f / 6.0f;
    y = y * f + 0.5f;
    y = y * f + 1.0f;
    y = y * f + 1.0f;
    return (F)((U)y + ((U)r << 23));
}

typedef float F4 __attribute__((vector_size(16), may_alias));
typedef uint32_t U4 __attribute__((vector_size(16), may_alias));
typedef float F8 __attribute__((vector_size(32), may_alias));
typedef float FU8 __attribute__((vector_size(32), aligned(4), may_alias));
typedef int32_t I8 __attribute__((vector_size(32), may_alias));

#define MATTGS_SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)

// Lane k of the result is the sum of vector k's lanes.
MATTGS_INLINE F8 sums_of_eight(const F8 v[8]) {
    F8 a[4], b[2];
    for (int i = 0; i < 4; ++i) {
        const F8 x = v[2 * i], y = v[2 * i + 1];
        a[i] = MATTGS_SHUFFLE(x, y, 0, 8, 2, 10, 4, 12, 6, 14) +
               MATTGS_SHUFFLE(x, y, 1, 9, 3, 11, 5, 13, 7, 15);
    }
    for (int i = 0; i < 2; ++i) {
        const F8 x = a[2 * i], y = a[2 * i + 1];
        b[i] = MATTGS_SHUFFLE(x, y, 0, 1, 8, 9, 4, 5, 12, 13) +
               MATTGS_SHUFFLE(x, y, 2, 3, 10, 11, 6, 7, 14, 15);
    }
    return MATTGS_SHUFFLE(b[0], b[1], 0, 1, 2, 3, 8, 9, 10, 11) +
           MATTGS_SHUFFLE(b[0], b[1], 4, 5, 6, 7, 12, 13, 14, 15);
}

}  // namespace
}  // namespace MATTGS_ISA
}  // namespace mattgs
