// What the parts of the engine share: plain structs, plain pointers, one table of kernels per
// instruction set.
#pragma once

#include <cstddef>
#include <cstdint>

namespace mattgs {

constexpr int MAX_SIDE = 1 << 15;               // of an image, pixels
constexpr int TILE = 32;                        // pixels, both ways
constexpr int STRIP = 8;                        // columns that share a span of rows
constexpr int STRIPS = TILE / STRIP;
constexpr float LOW_PASS = 0.3f;                // px^2 added to the projected covariance (3DGS)
constexpr float ALPHA_MAX = 0.99f;              // 3DGS
constexpr float ALPHA_MIN = 1.0f / 255.0f;      // 3DGS
constexpr float LOG2_ALPHA_MIN = -7.994353436858858f;
constexpr float T_MIN = 1e-4f;                  // transmittance at which a pixel is finished (3DGS)
constexpr float NEAR_PLANE = 0.2f;              // 3DGS
constexpr float FOV_MARGIN = 0.3f;              // of tan(fov/2): where the Jacobian is clamped (3DGS)
constexpr float FAR_TOO_BIG = 1e6f;             // px: an ellipse that counts as covering the image
constexpr float HALF_LOG2E = 0.7213475204444817f;
constexpr float LN2 = 0.6931471805599453f;
constexpr float LOG_SCALE_LIMIT = 40.0f;        // e^40: keeps float32 finite, far beyond any scene
constexpr float SCALE_LIMIT = 2.35e17f;         // about e^40, of scales themselves
constexpr float EXTENT_LIMIT = 1e9f;            // px that are reported; fits gsplat's int32 radii
constexpr int SH_REST = 15;
constexpr int FIELDS = 6;                       // of SplatArrays
constexpr int COLOUR_FLOATS = 12;               // colour, and its derivatives by the mean
constexpr int COLOURS = 3;                      // channels of every image
constexpr int CAMERA_SUMS = 15;                 // dL/d rotation [9], translation [3], centre [3]

// Where renderers of splats differ, and in which form parameters come. The defaults are 3DGS's own,
// with parameters as they are optimised.
struct Conventions {
    float near_plane = NEAR_PLANE, far_plane = 3e38f, low_pass = LOW_PASS, alpha_max = ALPHA_MAX;
    float radius_clip = 0.0f;    // px: splats that reach no further are left out
    bool activated = false;      // scales and opacities themselves, not logarithms and logits
    bool plain_colours = false;  // `sh_dc` holds colours: no harmonics, no clamp at 0
    bool centres_apart = false;  // dL/d centre is handed out and not carried on to the mean
};

struct Camera {
    float rotation[9];     // world to camera, row major
    float translation[3];
    float centre[3];       // of the camera, in the world
    float fx, fy, cx, cy;
    int32_t width, height;
    float x_low, x_high, y_low, y_high;  // limits of x/z and y/z in the Jacobian
    Conventions conventions;
};

// Parameters, or their gradients: [n,3], [n,3], [n,4], [n], [n,3], [n,15,3].
template <class T>
struct SplatArrays {
    T* means;
    T* log_scales;
    T* quaternions;
    T* opacity_logits;
    T* sh_dc;
    T* sh_rest;
    int64_t count;
};

// A projected splat. With dx, dy the offset of a pixel from (x, y):
// u = sx*dx + sy*dy, log2(alpha) = peak - u^2 - fall*dy^2. This is the Cholesky form of
// -log2(e)/2 * d^T Sigma^-1 d: it does not lose digits when the splat is a thin needle.
struct alignas(16) Projected {
    float x, y, sx, sy, fall, peak;
    float red, green, blue;
    float extent_x, extent_y;   // half sizes of the ellipse alpha >= 1/255, px
    float curve;                // alpha's second ratio from row to row, 2^(-2 (sy^2 + fall)); or
                                // -1: too thin for that, see pixel.h
};
static_assert(sizeof(Projected) == 48);

// A splat in a tile: for each strip of 8 columns the rows [first, last) it may touch.
struct alignas(16) Pair {
    uint32_t rank;              // position in depth order
    uint32_t place;             // the tile, and when pairs are sorted by tile the slot of its sums
    uint8_t first[STRIPS], last[STRIPS];
};
static_assert(sizeof(Pair) == 16);

// The slots of one splat, one a pair.
struct Slots {
    uint32_t end, count;        // one after the last; how many
};

// Sums over the pixels of one pair; q = alpha * dL/dalpha, w = blending weight.
enum Slot {
    SUM_Q, SUM_QU, SUM_QUU, SUM_QY, SUM_QUY, SUM_QYY, SUM_RED, SUM_GREEN,
    SUM_BLUE, SUM_ABS_X, SUM_ABS_Y, SUM_W, SUM_WMAP, SUM_EXTRA, SLOT_SIZE = 16
};
constexpr int SLOT_SIZE_PLAIN = 12;  // without statistics and extra only the first nine are kept

// What the forward pass leaves behind for each pixel of a tile, strips of LANES columns first.
struct TilePixels {
    float transmittance[TILE * TILE];
    int32_t stop[TILE * TILE];  // pairs before this position of the tile's list were blended
};

struct TileView {
    const Projected* splats;    // by rank
    const float* extra;         // by rank: a fourth channel, without a background; or null
    const Pair* pairs;          // this tile's, front to back
    int32_t pair_count;
    int32_t x0, y0;             // first pixel
    int32_t width, height;      // of the whole image
    float alpha_max;
};

struct ForwardTile {
    TileView view;
    TilePixels* pixels;
    float background[3];
    float* image;               // [height, width, 3, or 4 with extra]
    float* alpha;               // [height, width]
    int32_t processed;          // out: pairs looked at before every pixel was finished
};

struct BackwardTile {
    TileView view;
    const TilePixels* pixels;
    float background[3];
    const float* grad_image;    // [height, width, 3, or 4 with extra]
    const float* grad_alpha;    // [height, width] or null
    const float* pixel_map;     // [height, width] or null
    float* slots;               // of all tiles, those of one splat one after the other
    bool statistics;
    int32_t processed;
};

struct BinningChunk {
    const Projected* unsorted;  // by splat
    const uint32_t* order;      // splat of each rank
    int64_t first, last;        // ranks; first advances as far as the capacity allows
    int32_t width, height, tiles_x, tiles_y;
    Projected* sorted;          // out, by rank
    Pair* pairs;                // out
    int64_t capacity, written;  // of pairs
    Slots* slots;               // by splat; out: their count
    float* radii;               // by splat; out: 0 where there is no pair
    uint32_t* histogram;        // [tiles_x * tiles_y], added to
};

struct LossImages {
    const float* image;         // [height, width, 3]
    const float* target;
    const float* weight;        // of L1, [height, width] or null: all ones
    bool weight_ssim;           // whether SSIM's map has the same weight
    int32_t width, height;
    float ssim_lambda;
    float* grad;                // out, [height, width, 3]
};

struct LossSums {               // over one row's values
    double l1, weighted, ssim, weighted_ssim;
};

struct ProjectOutputs {
    Projected* projected;
    float *depths, *radii, *means2d;
    float* extents;             // [n, 2] half sizes of the ellipse, px, rounded up; or null
    float* colours;
};

// What going back needs from the pixels and from project().
struct SplatSums {
    const Slots* of;            // by splat: which
    const float* slots;
    const float* colours;       // as project() left them
    bool statistics;
    int slot_size;
};

struct SplatStatistics {
    float *means2d, *means2d_abs, *weight, *weighted_map;
};

struct GradientOutputs {
    SplatArrays<float> splats;  // sh_rest may be null
    float* extra;               // [n] or null
    SplatStatistics seen;
};

struct AdamSettings {
    float beta1, beta2, epsilon;
    float correction1, correction2;  // 1 / (1 - beta^t)
};

// Adam on all parameters of the splats: one rate each, in the order of SplatArrays.
struct Descent {
    SplatArrays<float> values, first_moments, second_moments;
    float rates[FIELDS];
    AdamSettings adam;
    // weights of every splat's opacity and of each of its scales in the loss
    float opacity_loss = 0.0f, scale_loss = 0.0f;
};

// One instruction set's kernels; all work on ranges, none allocates or throws.
struct Kernels {
    const char* name;
    int lanes;
    // Splats [first, last): fills projected, depths, radii, means2d; depth 0 = not visible. Unless
    // null, `colours` gets what going back needs, COLOUR_FLOATS a splat; `first` is a multiple of
    // 16 then. Returns how many have a parameter that is NaN or infinite.
    int64_t (*project)(const SplatArrays<const float>&, const Camera&, int sh_degree, int64_t first,
                       int64_t last, const ProjectOutputs&);
    // dL/dparameters of splats [first, last) from the sums of their pairs; unless null, `camera`
    // [CAMERA_SUMS] gets what they sum up to for the camera.
    void (*project_backward)(const SplatArrays<const float>&, const Camera&, int sh_degree,
                             int64_t first, int64_t last, const SplatSums&, const GradientOutputs&,
                             double* camera);
    // The same, and at once a step of Adam: gradients never leave the cache. At degree 0 `sh_rest`
    // is left alone. Returns a bit for each field that has a gradient which is not finite.
    uint32_t (*descend)(const Camera&, int sh_degree, int64_t first, int64_t last,
                        const SplatSums&, const Descent&, const SplatStatistics&);
    void (*bin)(BinningChunk&);
    void (*forward)(ForwardTile&);
    void (*backward)(const BackwardTile&);
    // Rows [first, last): gradient and one LossSums a row; scratch holds loss_scratch(width).
    void (*loss)(const LossImages&, int32_t first, int32_t last, LossSums*, float* scratch);
    // Multiply-adds on registers alone; returns how many floating-point operations.
    double (*multiply_add)(int64_t rounds, float* sink);
};

// The best table that this CPU can run, or the one called `name`; null when there is none such.
const Kernels* choose_kernels(const char* name);

// Floats of scratch that loss() needs for one thread.
constexpr int LOSS_PAD = 16;        // floats either side of a row: 5 pixels of 3 values, and one
constexpr int LOSS_BLOCK = 4;       // rows at a time
constexpr int LOSS_MAPS = 3;        // derivatives of SSIM
constexpr int LOSS_RING = 16;       // rows of each that are kept: 2 * 5 + LOSS_BLOCK, and some
constexpr int LOSS_ROWS = LOSS_MAPS * LOSS_RING + 4 * LOSS_BLOCK + 1;
inline int64_t loss_stride(int64_t width) { return (3 * width + 2 * LOSS_PAD + 31) / 16 * 16; }
inline int64_t loss_scratch(int64_t width) { return LOSS_ROWS * loss_stride(width); }

}  // namespace mattgs
