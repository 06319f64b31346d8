// Between arrays of splats, a few floats of each side by side, and one vector per float over LANES of
// them.
#pragma once

#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

// An 8 by 8 block: row k of the result is column k of the argument.
MATTGS_INLINE void transpose(F8 v[8]) {
    F8 a[8], b[8];
    for (int i = 0; i < 4; ++i) {
        a[2 * i] = MATTGS_SHUFFLE(v[2 * i], v[2 * i + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        a[2 * i + 1] = MATTGS_SHUFFLE(v[2 * i], v[2 * i + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j) {
            const F8 x = a[4 * i + j], y = a[4 * i + 2 + j];
            b[4 * i + 2 * j] = MATTGS_SHUFFLE(x, y, 0, 1, 8, 9, 4, 5, 12, 13);
            b[4 * i + 2 * j + 1] = MATTGS_SHUFFLE(x, y, 2, 3, 10, 11, 6, 7, 14, 15);
        }
    for (int i = 0; i < 4; ++i) {
        v[i] = MATTGS_SHUFFLE(b[i], b[4 + i], 0, 1, 2, 3, 8, 9, 10, 11);
        v[4 + i] = MATTGS_SHUFFLE(b[i], b[4 + i], 4, 5, 6, 7, 12, 13, 14, 15);
    }
}

MATTGS_INLINE void set_part(F& v, int part, F8 x) {
    __builtin_memcpy(reinterpret_cast<char*>(&v) + 32 * part, &x, 32);
}

MATTGS_INLINE F8 part_of(const F& v, int part) {
    F8 x;
    __builtin_memcpy(&x, reinterpret_cast<const char*>(&v) + 32 * part, 32);
    return x;
}

// Indices 0 .. LANES - 1 as a type, to compute a shuffle's from. (std::integer_sequence would do; see
// vec.h on the standard library.)
template <int... L>
struct Numbers {};
template <int N, int... L>
struct Count : Count<N - 1, N - 1, L...> {};
template <int... L>
struct Count<0, L...> {
    typedef Numbers<L...> type;
};
typedef Count<LANES>::type Lanes;

// Float f of two vectors behind one another, or any where it lies in others.
constexpr int within(int f) { return f >= 0 && f < 2 * LANES ? f : 0; }

template <int ROWS, int K, int... L>
MATTGS_INLINE F apart_one(const F v[4], Numbers<L...>) {
    const F low = MATTGS_SHUFFLE(v[0], v[1], within(L * ROWS + K)...);
    if (ROWS <= 2) return low;
    const F high = MATTGS_SHUFFLE(v[2], v[3], within(L * ROWS + K - 2 * LANES)...);
    return MATTGS_SHUFFLE(low, high, (L * ROWS + K < 2 * LANES ? L : LANES + L)...);
}

// Two to four floats of each of LANES splats, side by side at p, to one vector per float.
template <int ROWS, int... L>
MATTGS_INLINE void apart(const float* p, F out[ROWS], Numbers<L...> lanes) {
    F v[4];
    for (int k = 0; k < 4; ++k) v[k] = load(p + (k < ROWS ? k : ROWS - 1) * LANES);
    if constexpr (ROWS == 1) {
        out[0] = v[0];
        return;
    }
    out[0] = apart_one<ROWS, 0>(v, lanes);
    out[1] = apart_one<ROWS, 1>(v, lanes);
    if constexpr (ROWS > 2) out[2] = apart_one<ROWS, 2>(v, lanes);
    if constexpr (ROWS > 3) out[3] = apart_one<ROWS, 3>(v, lanes);
}

// Which of two rows' lanes goes to place f: row K or K + 1, if it is one of them.
template <int ROWS, int K>
constexpr int from_rows(int f) {
    return f % ROWS == K ? f / ROWS : f % ROWS == K + 1 ? LANES + f / ROWS : 0;
}

template <int ROWS, int J, int... L>
MATTGS_INLINE F together_one(const F v[4], Numbers<L...>) {
    const F low = MATTGS_SHUFFLE(v[0], v[1], (from_rows<ROWS, 0>(J * LANES + L))...);
    if (ROWS <= 2) return low;
    const F high = MATTGS_SHUFFLE(v[2], v[3], (from_rows<ROWS, 2>(J * LANES + L))...);
    return MATTGS_SHUFFLE(low, high, ((J * LANES + L) % ROWS < 2 ? L : LANES + L)...);
}

// The other way.
template <int ROWS, int... L>
MATTGS_INLINE void together(const F rows[ROWS], float* p, Numbers<L...> lanes) {
    F v[4];
    for (int k = 0; k < 4; ++k) v[k] = rows[k < ROWS ? k : ROWS - 1];
    if constexpr (ROWS == 1) {
        store(p, v[0]);
        return;
    }
    store(p, together_one<ROWS, 0>(v, lanes));
    store(p + LANES, together_one<ROWS, 1>(v, lanes));
    if constexpr (ROWS > 2) store(p + 2 * LANES, together_one<ROWS, 2>(v, lanes));
    if constexpr (ROWS > 3) store(p + 3 * LANES, together_one<ROWS, 3>(v, lanes));
}

// ROWS floats of each of LANES splats, which lie one after the other at p, to and from one vector
// per float. Of fewer `lanes` the first is read in place of those that are missing.
template <int ROWS>
MATTGS_INLINE void gather_rows(const float* __restrict p, int lanes, F out[ROWS]) {
    alignas(64) float filled[LANES * ROWS];
    if (lanes < LANES) {
        for (int i = 0; i < LANES; ++i)
            for (int k = 0; k < ROWS; ++k) filled[i * ROWS + k] = p[(i < lanes ? i : 0) * ROWS + k];
        p = filled;
    }
    if constexpr (ROWS <= 4) {
        apart<ROWS>(p, out, Lanes{});
        return;
    }
    for (int part = 0; part < LANES / 8; ++part)
        for (int k = 0; k < ROWS; k += 8) {
            const int at = k + 8 <= ROWS ? k : ROWS - 8;  // the last block overlaps
            F8 v[8];
            for (int i = 0; i < 8; ++i)
                v[i] = *reinterpret_cast<const FU8*>(p + (8 * part + i) * ROWS + at);
            transpose(v);
            for (int i = 0; i < 8; ++i) set_part(out[at + i], part, v[i]);
        }
}

template <int ROWS>
MATTGS_INLINE void scatter_rows(const F v[ROWS], float* __restrict p, int lanes) {
    if (lanes < LANES) {
        alignas(64) float t[ROWS][LANES];
        for (int k = 0; k < ROWS; ++k) store(t[k], v[k]);
        for (int lane = 0; lane < lanes; ++lane)
            for (int k = 0; k < ROWS; ++k) p[lane * ROWS + k] = t[k][lane];
        return;
    }
    if constexpr (ROWS <= 4) {
        together<ROWS>(v, p, Lanes{});
        return;
    }
    for (int part = 0; part < LANES / 8; ++part)
        for (int k = 0; k < ROWS; k += 8) {
            const int at = k + 8 <= ROWS ? k : ROWS - 8;
            F8 x[8];
            for (int i = 0; i < 8; ++i) x[i] = part_of(v[at + i], part);
            transpose(x);
            for (int i = 0; i < 8; ++i)
                *reinterpret_cast<FU8*>(p + (8 * part + i) * ROWS + at) = x[i];
        }
}

}  // namespace
}  // namespace MATTGS_ISA
}  // namespace mattgs
