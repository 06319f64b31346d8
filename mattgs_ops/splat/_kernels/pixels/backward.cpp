// Gradients of compositing for one tile, back to front.
//
// With B the value of what lies behind a splat (its colour dotted with the pixel's gradient) and s
// the splat's own: alpha * dL/dalpha = w * (s - B), and B of the next splat forward is
// B + alpha * (s - B). Nothing is subtracted from a running total, so far splats keep their digits.
#include "engine.h"
#include "kernels.h"
#include "pixels/pixel.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

enum { TRANSMITTANCE, BEHIND, GRAD_RED, GRAD_GREEN, GRAD_BLUE, MAP, GRAD_EXTRA };

template <int CHANNELS>
struct alignas(64) State {
    static constexpr int FIELDS = CHANNELS > COLOURS ? GRAD_EXTRA + 1 : MAP + 1;
    float v[STRIPS][TILE][FIELDS][LANES];
    int32_t deepest[STRIPS];  // greatest stop of the strip's pixels
};

template <int CHANNELS>
MATTGS_INLINE void start(const BackwardTile& t, State<CHANNELS>& state) {
    const TileView& v = t.view;
    const int rows = v.height - v.y0 < TILE ? v.height - v.y0 : TILE;
    const int columns = v.width - v.x0 < TILE ? v.width - v.x0 : TILE;
    for (int s = 0; s < STRIPS; ++s) state.deepest[s] = 0;
    alignas(64) float line[2 + CHANNELS][TILE] = {};
    for (int r = 0; r < TILE; ++r) {
        if (r < rows) {
            const int64_t pixel = (int64_t)(v.y0 + r) * v.width + v.x0;
            const float* __restrict grad = t.grad_image + CHANNELS * pixel;
            for (int x = 0; x < columns; ++x) {
                line[0][x] = grad[CHANNELS * x];
                line[1][x] = grad[CHANNELS * x + 1];
                line[2][x] = grad[CHANNELS * x + 2];
                if (CHANNELS > COLOURS) line[1 + CHANNELS][x] = grad[CHANNELS * x + 3];
            }
            for (int x = 0; x < columns; ++x) line[3][x] = t.grad_alpha ? t.grad_alpha[pixel + x] : 0.0f;
            for (int x = 0; x < columns; ++x) line[4][x] = t.pixel_map ? t.pixel_map[pixel + x] : 0.0f;
        }
        for (int s = 0; s < STRIPS; ++s) {
            float* p = state.v[s][r][0];
            const int at = (s * TILE + r) * LANES, x = s * LANES;
            const F red = load(line[0] + x), green = load(line[1] + x), blue = load(line[2] + x);
            store(p + TRANSMITTANCE * LANES,
                  r < rows ? load(t.pixels->transmittance + at) : all(1.0f));
            store(p + BEHIND * LANES, red * t.background[0] + green * t.background[1] +
                                          blue * t.background[2] - load(line[3] + x));
            store(p + GRAD_RED * LANES, red);
            store(p + GRAD_GREEN * LANES, green);
            store(p + GRAD_BLUE * LANES, blue);
            store(p + MAP * LANES, load(line[4] + x));
            if (CHANNELS > COLOURS) store(p + GRAD_EXTRA * LANES, load(line[1 + CHANNELS] + x));
            const I stop = load(t.pixels->stop + at);
            for (int i = 0; i < LANES; ++i)
                if (stop[i] > state.deepest[s]) state.deepest[s] = stop[i];
        }
    }
}

// Sums over a strip's rows for each column, with the row counted from the strip's first.
struct RowSums {
    F q, qr, qrr;

    // Adds them to the sums over pixels; u at the first row, dy of that row.
    MATTGS_INLINE void add_to(F sums[SLOT_SIZE], const Projected& s, F u, float dy) const {
        const F qy = q * dy + qr, qry = qr * dy + qrr;
        sums[SUM_Q] += q;
        sums[SUM_QY] += qy;
        sums[SUM_QYY] += qy * dy + qry;
        const F qu = q * u + qr * s.sy;
        sums[SUM_QU] += qu;
        sums[SUM_QUU] += qu * u + (qr * u + qrr * s.sy) * s.sy;
        sums[SUM_QUY] += qy * u + qry * s.sy;
    }
};

template <bool STATISTICS, bool BROAD_SPLAT, int CHANNELS>
MATTGS_INLINE void one_pair(const TileView& view, const Prepared& prepared, int position,
                            State<CHANNELS>& state, const TilePixels& pixels, float* slot) {
    const Projected& s = *prepared.splat;
    const F red = all(s.red), green = all(s.green), blue = all(s.blue);
    const F extra = CHANNELS > COLOURS ? all(view.extra[&s - view.splats]) : F{};
    const F alpha_max = all(view.alpha_max);
    const I here = all(position);
    F sums[SLOT_SIZE];
    for (int k = 0; k < SLOT_SIZE; ++k) sums[k] = F{};
    for (int i = 0; i < prepared.count; ++i) {
        const int strip = prepared.used[i], first = prepared.first[strip];
        const int count = prepared.rows[strip];
        if (state.deepest[strip] <= position) continue;
        const float dy = prepared.dy[strip];
        const F start = prepared.columns(strip);
        // d log2(alpha) by x and by y, but for factors, are linear in the row
        const F by_row_x = all(s.sy), by_row_y = all(s.sy * s.sy + s.fall);
        const F start_y = s.sy * start + s.fall * dy;
        Column<BROAD_SPLAT> column(prepared, strip);
        RowSums rows{F{}, F{}, F{}};
        float* p = state.v[strip][first][0];
        const int32_t* stop = pixels.stop + (strip * TILE + first) * LANES;
        for (int r = 0; r < count; ++r, p += State<CHANNELS>::FIELDS * LANES, stop += LANES) {
            I counts;
            const F raw = column.next(counts);
            const F alpha = keep(min(raw, alpha_max), counts & (load(stop) > here));
            const F before = load(p + TRANSMITTANCE * LANES) / (1.0f - alpha);
            const F w = alpha * before;
            store(p + TRANSMITTANCE * LANES, before);
            const F g0 = load(p + GRAD_RED * LANES), g1 = load(p + GRAD_GREEN * LANES),
                    g2 = load(p + GRAD_BLUE * LANES);
            const F behind = load(p + BEHIND * LANES);
            F ahead = g0 * red + g1 * green + g2 * blue - behind;
            if (CHANNELS > COLOURS) {
                const F g3 = load(p + GRAD_EXTRA * LANES);
                ahead += g3 * extra;
                sums[SUM_EXTRA] += w * g3;
            }
            store(p + BEHIND * LANES, behind + alpha * ahead);
            sums[SUM_RED] += w * g0;
            sums[SUM_GREEN] += w * g1;
            sums[SUM_BLUE] += w * g2;
            // a clamped alpha does not change with the splat's shape or opacity
            const F q = keep(w * ahead, raw <= alpha_max);
            if (BROAD_SPLAT) {
                rows.q += q;
                rows.qr += q * ROW[r];
                rows.qrr += q * ROW_SQUARED[r];
            }
            if (!BROAD_SPLAT) {
                const F u = start + s.sy * ROW[r];
                const float y = dy + ROW[r];
                const F qu = q * u, qy = q * y;
                sums[SUM_Q] += q;
                sums[SUM_QU] += qu;
                sums[SUM_QUU] += qu * u;
                sums[SUM_QY] += qy;
                sums[SUM_QUY] += qu * y;
                sums[SUM_QYY] += qy * y;
            }
            if (STATISTICS) {
                const F size = abs(q);
                sums[SUM_ABS_X] += size * abs(start + by_row_x * ROW[r]);
                sums[SUM_ABS_Y] += size * abs(start_y + by_row_y * ROW[r]);
                sums[SUM_W] += w;
                sums[SUM_WMAP] += w * load(p + MAP * LANES);
            }
        }
        if (BROAD_SPLAT) rows.add_to(sums, s, start, dy);
    }
    sums[SUM_ABS_X] *= s.sx;
    const F8 low = sums_of_eight(sums), high = sums_of_eight(sums + 8);
    __builtin_memcpy(slot, &low, 32);
    __builtin_memcpy(slot + 8, &high, STATISTICS || CHANNELS > COLOURS ? 32 : 16);
}

template <bool STATISTICS, int CHANNELS>
void run(const BackwardTile& t) {
    constexpr int size = STATISTICS || CHANNELS > COLOURS ? SLOT_SIZE : SLOT_SIZE_PLAIN;
    State<CHANNELS> state;
    start(t, state);
    const auto slot_at = [&](int i) { return t.slots + (int64_t)t.view.pairs[i].place * size; };
    for (int i = t.processed; i < t.view.pair_count; ++i) {
        float* slot = slot_at(i);
        for (int k = 0; k < size; ++k) slot[k] = 0.0f;
    }
    Prepared prepared[2];
    if (t.processed) prepare(t.view, t.processed - 1, prepared[(t.processed - 1) % 2]);
    for (int i = t.processed - 1; i >= 0; --i) {
        prefetch(t.view, i - PREFETCH);
        if (i >= PREFETCH) {  // a tile's slots lie as far apart as its splats
            __builtin_prefetch(slot_at(i - PREFETCH), 1);
            __builtin_prefetch(slot_at(i - PREFETCH) + SLOT_SIZE_PLAIN - 1, 1);
        }
        if (i > 0) prepare(t.view, i - 1, prepared[(i - 1) % 2]);
        const Prepared& now = prepared[i % 2];
        float* slot = slot_at(i);
        if (now.splat->curve >= 0.0f)
            one_pair<STATISTICS, true>(t.view, now, i, state, *t.pixels, slot);
        else
            one_pair<STATISTICS, false>(t.view, now, i, state, *t.pixels, slot);
    }
}

}  // namespace

void backward(const BackwardTile& t) {
    if (t.view.extra) {
        if (t.statistics) run<true, COLOURS + 1>(t);
        else run<false, COLOURS + 1>(t);
    } else {
        if (t.statistics) run<true, COLOURS>(t);
        else run<false, COLOURS>(t);
    }
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
