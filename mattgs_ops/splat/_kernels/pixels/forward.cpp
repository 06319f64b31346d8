// Front-to-back compositing of one tile.
//
// The list of splats is the outer loop; the tile's pixels stay in the first-level cache. A pixel
// whose transmittance would fall below T_MIN is finished: its transmittance is kept with the sign
// bit set, which makes every later weight fail the same test, without a branch.
#include "engine.h"
#include "kernels.h"
#include "pixels/pixel.h"
#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

constexpr int32_t NEVER = 0x7fffffff;
constexpr int CHECK_EVERY = 32;  // pairs between looks at whether every pixel is finished

template <int CHANNELS>
struct alignas(64) State {
    float v[STRIPS][TILE][1 + CHANNELS][LANES];  // transmittance, red, green, blue, extra
};

template <int CHANNELS>
MATTGS_INLINE void start(const TileView& view, State<CHANNELS>& state, TilePixels& pixels) {
    for (int s = 0; s < STRIPS; ++s) {
        const I column = lanes_from(view.x0 + s * LANES);
        for (int r = 0; r < TILE; ++r) {
            // pixels outside the image are finished from the start
            const I inside = (column < view.width) & all(view.y0 + r < view.height ? -1 : 0);
            float* p = state.v[s][r][0];
            store(p, inside ? all(1.0f) : all(-1.0f));
            for (int k = 1; k <= CHANNELS; ++k) store(p + k * LANES, F{});
            store(pixels.stop + (s * TILE + r) * LANES, inside ? all(NEVER) : I{});
        }
    }
}

template <int CHANNELS>
MATTGS_INLINE bool all_finished(const State<CHANNELS>& state) {
    F most = all(-1.0f);
    for (int s = 0; s < STRIPS; ++s)
        for (int r = 0; r < TILE; ++r) most = max(most, load(state.v[s][r][0]));
    return !any(most > 0.0f);
}

// Notes where pixels of rows [first, last) were finished by the pair at `position`.
template <int CHANNELS>
__attribute__((noinline)) void note_finished(const float* state, int32_t* stop, int rows,
                                             int position) {
    for (int r = 0; r < rows; ++r, state += (1 + CHANNELS) * LANES, stop += LANES) {
        const I old = load(stop);
        store(stop, (load(state) < 0.0f) & (old == NEVER) ? all(position) : old);
    }
}

template <bool BROAD_SPLAT, int CHANNELS>
MATTGS_INLINE void blend(const TileView& view, const Prepared& prepared, int position,
                         State<CHANNELS>& state, TilePixels& pixels) {
    const Projected& s = *prepared.splat;
    const F red = all(s.red), green = all(s.green), blue = all(s.blue);
    const F extra = CHANNELS > COLOURS ? all(view.extra[&s - view.splats]) : F{};
    const F alpha_max = all(view.alpha_max);
    for (int i = 0; i < prepared.count; ++i) {
        const int strip = prepared.used[i], first = prepared.first[strip];
        const int rows = prepared.rows[strip];
        Column<BROAD_SPLAT> column(prepared, strip);
        float* p = state.v[strip][first][0];
        I finished = I{};
        for (int r = 0; r < rows; ++r, p += (1 + CHANNELS) * LANES) {
            I counts;
            const F raw = column.next(counts);
            const F alpha = keep(min(raw, alpha_max), counts);
            const F before = load(p);
            F w = alpha * before;
            const F after = before - w;
            const I alive = after >= T_MIN;
            w = keep(w, alive);
            const F now = select(alive, after, (F)((I)before | (int32_t)0x80000000));
            finished |= (I)before ^ (I)now;  // the sign bit, where it changed
            store(p, now);
            store(p + LANES, load(p + LANES) + w * red);
            store(p + 2 * LANES, load(p + 2 * LANES) + w * green);
            store(p + 3 * LANES, load(p + 3 * LANES) + w * blue);
            if (CHANNELS > COLOURS) store(p + 4 * LANES, load(p + 4 * LANES) + w * extra);
        }
        if (any(finished))
            note_finished<CHANNELS>(state.v[strip][first][0],
                                    pixels.stop + (strip * TILE + first) * LANES, rows, position);
    }
}

template <int CHANNELS>
MATTGS_INLINE void finish(const ForwardTile& t, const State<CHANNELS>& state) {
    const TileView& v = t.view;
    const int rows = v.height - v.y0 < TILE ? v.height - v.y0 : TILE;
    const int columns = v.width - v.x0 < TILE ? v.width - v.x0 : TILE;
    alignas(64) float line[1 + CHANNELS][TILE];
    for (int r = 0; r < rows; ++r) {
        for (int s = 0; s < STRIPS; ++s) {
            const float* p = state.v[s][r][0];
            const F left = abs(load(p));
            store(t.pixels->transmittance + (s * TILE + r) * LANES, left);
            store(line[0] + s * LANES, 1.0f - left);
            for (int k = 0; k < 3; ++k)
                store(line[1 + k] + s * LANES, load(p + (1 + k) * LANES) + left * t.background[k]);
            if (CHANNELS > COLOURS) store(line[CHANNELS] + s * LANES, load(p + CHANNELS * LANES));
        }
        const int64_t pixel = (int64_t)(v.y0 + r) * v.width + v.x0;
        float* __restrict image = t.image + CHANNELS * pixel;
        float* __restrict alpha = t.alpha + pixel;
        for (int x = 0; x < columns; ++x) {
            for (int k = 0; k < CHANNELS; ++k) image[CHANNELS * x + k] = line[1 + k][x];
            alpha[x] = line[0][x];
        }
    }
}

template <int CHANNELS>
void run(ForwardTile& t) {
    State<CHANNELS> state;
    start(t.view, state, *t.pixels);
    Prepared prepared[2];
    if (t.view.pair_count) prepare(t.view, 0, prepared[0]);
    int i = 0;
    for (; i < t.view.pair_count; ++i) {
        if (i % CHECK_EVERY == CHECK_EVERY - 1 && all_finished(state)) break;
        prefetch(t.view, i + PREFETCH);
        if (i + 1 < t.view.pair_count) prepare(t.view, i + 1, prepared[(i + 1) % 2]);
        const Prepared& now = prepared[i % 2];
        if (now.splat->curve >= 0.0f)
            blend<true>(t.view, now, i, state, *t.pixels);
        else
            blend<false>(t.view, now, i, state, *t.pixels);
    }
    t.processed = i;
    finish(t, state);
}

}  // namespace

void forward(ForwardTile& t) {
    if (t.view.extra) run<COLOURS + 1>(t);
    else run<COLOURS>(t);
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
