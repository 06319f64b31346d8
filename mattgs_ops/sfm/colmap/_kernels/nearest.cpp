// Compiled once per instruction set. Whole numbers: every build gives the same answers.
//
// A product of two descriptors is a sum over 64 pairs of bytes. Columns are packed as 16-bit
// numbers so that one vector holds a pair of each of LANES columns; a multiply-add then serves
// LANES columns at once. ROWS rows share each load, and the two largest products stay in registers:
// the matrix of products is never written to memory.
#include "nearest.h"

#include <algorithm>
#include <memory>
#include <vector>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

namespace descriptors {
namespace MATTGS_ISA {
namespace {

constexpr int PAIRS = LENGTH / 2;
constexpr int ROWS = 6;   // sums of ROWS × 2 vectors fit the registers
constexpr int BYTES = 4 * MATTGS_LANES;
constexpr std::size_t ALIGNMENT = 64;

typedef int32_t Sums __attribute__((vector_size(BYTES)));
typedef int16_t Shorts __attribute__((vector_size(BYTES)));

// Adds to each sum the product of one pair: a[2i] b[2i] + a[2i + 1] b[2i + 1].
inline Sums multiply_add(Sums sum, Shorts a, Shorts b) {
#if defined(__AVX512VNNI__)
    return (Sums)_mm512_dpwssd_epi32((__m512i)sum, (__m512i)a, (__m512i)b);
#elif defined(__AVX512BW__)
    return sum + (Sums)_mm512_madd_epi16((__m512i)a, (__m512i)b);
#elif defined(__AVX2__)
    return sum + (Sums)_mm256_madd_epi16((__m256i)a, (__m256i)b);
#elif defined(__SSE2__)
    return sum + (Sums)_mm_madd_epi16((__m128i)a, (__m128i)b);
#else
    for (int i = 0; i < MATTGS_LANES; ++i)
        sum[i] += int32_t(a[2 * i]) * b[2 * i] + int32_t(a[2 * i + 1]) * b[2 * i + 1];
    return sum;
#endif
}

// The two largest sums that each lane has seen, and the column of the larger.
struct Largest {
    Sums best = Sums{} - 1, second = Sums{} - 1, column = Sums{};

    void see(Sums sum, Sums columns) {
        const Sums larger = sum > best;
        second = larger ? best : (sum > second ? sum : second);
        best = larger ? sum : best;
        column = larger ? columns : column;
    }
};

// Columns as 16-bit numbers, LANES side by side; what is left of the last group is zero.
class Packed {
  public:
    explicit Packed(const Job& job)
        : groups((job.m + MATTGS_LANES - 1) / MATTGS_LANES),
          storage(groups * PAIRS * BYTES / sizeof(int16_t) + ALIGNMENT) {
        void* start = storage.data();
        std::size_t room = storage.size() * sizeof(int16_t);
        data = static_cast<int16_t*>(std::align(ALIGNMENT, 1, start, room));
        for (int64_t j = 0; j < job.m; ++j) {
            const uint8_t* from = job.columns + j * LENGTH;
            int16_t* to = data + (j / MATTGS_LANES) * PAIRS * 2 * MATTGS_LANES +
                          2 * (j % MATTGS_LANES);
            for (int p = 0; p < PAIRS; ++p, to += 2 * MATTGS_LANES) {
                to[0] = from[2 * p];
                to[1] = from[2 * p + 1];
            }
        }
    }
    const Shorts* group(int64_t g) const {
        return reinterpret_cast<const Shorts*>(data) + g * PAIRS;
    }
    const int64_t groups;

  private:
    std::vector<int16_t> storage;
    int16_t* data;
};

// Compares ROWS rows from `first` on, of which `count` are there, with all columns.
void some_rows(const Job& job, const Packed& packed, int64_t first, int count) {
    int32_t pairs[ROWS][PAIRS];
    for (int r = 0; r < ROWS; ++r) {
        const uint8_t* row = job.rows + (first + std::min(r, count - 1)) * LENGTH;
        for (int p = 0; p < PAIRS; ++p) pairs[r][p] = row[2 * p] | row[2 * p + 1] << 16;
    }
    Sums lanes;
    for (int i = 0; i < MATTGS_LANES; ++i) lanes[i] = i;
    Largest found[ROWS];
    for (int64_t g = 0; g < packed.groups; g += 2) {
        const bool two = g + 1 < packed.groups;
        const Shorts *left = packed.group(g), *right = two ? packed.group(g + 1) : left;
        Sums near[ROWS] = {}, far[ROWS] = {};
        for (int p = 0; p < PAIRS; ++p)
            for (int r = 0; r < ROWS; ++r) {
                const Shorts pair = (Shorts)(Sums{} + pairs[r][p]);
                near[r] = multiply_add(near[r], pair, left[p]);
                far[r] = multiply_add(far[r], pair, right[p]);
            }
        const Sums columns = lanes + static_cast<int32_t>(g * MATTGS_LANES);
        for (int r = 0; r < ROWS; ++r) {
            found[r].see(near[r], columns);
            if (two) found[r].see(far[r], columns + MATTGS_LANES);
        }
    }
    for (int r = 0; r < count; ++r) {
        int32_t best = -1, second = -1, column = 0;
        for (int i = 0; i < MATTGS_LANES; ++i) {
            const int32_t sum = found[r].best[i], where = found[r].column[i];
            if (where >= job.m) continue;  // a lane of zeros beyond the last column
            if (sum > best || (sum == best && where < column)) {
                second = std::max(second, best);
                best = sum;
                column = where;
            } else {
                second = std::max(second, sum);
            }
            second = std::max(second, found[r].second[i]);
        }
        job.column[first + r] = column;
        job.best[first + r] = best;
        job.second[first + r] = second;
    }
}

}  // namespace

void nearest(const Job& job) {
    const Packed packed(job);
    for (int64_t first = 0; first < job.n; first += ROWS)
        some_rows(job, packed, first, static_cast<int>(std::min<int64_t>(ROWS, job.n - first)));
}

}  // namespace MATTGS_ISA
}  // namespace descriptors
