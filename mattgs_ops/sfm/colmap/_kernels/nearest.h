// The two largest inner products of each SIFT descriptor with all descriptors of another photo.
#pragma once
#include <cstdint>

namespace descriptors {

constexpr int LENGTH = 128;  // of a descriptor

// rows [n, LENGTH], columns [m, LENGTH]; per row: the column of the largest product, the first one
// of several; that product; and the largest product with any other column, -1 where there is none.
struct Job {
    const uint8_t* rows;
    int64_t n;
    const uint8_t* columns;
    int64_t m;
    int32_t *column, *best, *second;  // [n]
};

#if defined(__x86_64__)
namespace vnni { void nearest(const Job&); }
namespace avx512 { void nearest(const Job&); }
namespace avx2 { void nearest(const Job&); }
#endif
namespace baseline { void nearest(const Job&); }  // SSE2 on x86-64, plain C++ elsewhere

}  // namespace descriptors
