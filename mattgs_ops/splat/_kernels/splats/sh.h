// Real spherical harmonics of degree 0 to 3 in the order and sign of the original 3DGS.
#pragma once

#include "vec.h"

namespace mattgs {
namespace MATTGS_ISA {
namespace {

constexpr float SH_0 = 0.28209479177387814f;
constexpr float SH_1 = 0.4886025119029199f;
constexpr float SH_2[5] = {1.0925484305920792f, -1.0925484305920792f, 0.31539156525252005f,
                           -1.0925484305920792f, 0.5462742152960396f};
constexpr float SH_3[7] = {-0.5900435899266435f, 2.890611442640554f, -0.4570457994644658f,
                           0.3731763325901154f, -0.4570457994644658f, 1.445305721320277f,
                           -0.5900435899266435f};

// The 15 functions after the constant one at unit direction d; zero above `degree`.
MATTGS_INLINE void sh_basis(const F d[3], int degree, F b[15]) {
    const F x = d[0], y = d[1], z = d[2];
    for (int k = 0; k < 15; ++k) b[k] = F{};
    if (degree < 1) return;
    b[0] = -SH_1 * y;
    b[1] = SH_1 * z;
    b[2] = -SH_1 * x;
    if (degree < 2) return;
    const F xx = x * x, yy = y * y, zz = z * z;
    b[3] = SH_2[0] * x * y;
    b[4] = SH_2[1] * y * z;
    b[5] = SH_2[2] * (2.0f * zz - xx - yy);
    b[6] = SH_2[3] * x * z;
    b[7] = SH_2[4] * (xx - yy);
    if (degree < 3) return;
    b[8] = SH_3[0] * y * (3.0f * xx - yy);
    b[9] = SH_3[1] * x * y * z;
    b[10] = SH_3[2] * y * (4.0f * zz - xx - yy);
    b[11] = SH_3[3] * z * (2.0f * zz - 3.0f * xx - 3.0f * yy);
    b[12] = SH_3[4] * x * (4.0f * zz - xx - yy);
    b[13] = SH_3[5] * z * (xx - yy);
    b[14] = SH_3[6] * x * (xx - 3.0f * yy);
}

// Gradient with respect to d of sum_k e[k] * b[k](d), d taken as three free variables.
MATTGS_INLINE void sh_basis_gradient(const F d[3], int degree, const F e[15], F g[3]) {
    const F x = d[0], y = d[1], z = d[2];
    g[0] = g[1] = g[2] = F{};
    if (degree < 1) return;
    g[0] = -SH_1 * e[2];
    g[1] = -SH_1 * e[0];
    g[2] = SH_1 * e[1];
    if (degree < 2) return;
    const F xx = x * x, yy = y * y, zz = z * z;
    g[0] += SH_2[0] * y * e[3] - 2.0f * SH_2[2] * x * e[5] + SH_2[3] * z * e[6] +
            2.0f * SH_2[4] * x * e[7];
    g[1] += SH_2[0] * x * e[3] + SH_2[1] * z * e[4] - 2.0f * SH_2[2] * y * e[5] -
            2.0f * SH_2[4] * y * e[7];
    g[2] += SH_2[1] * y * e[4] + 4.0f * SH_2[2] * z * e[5] + SH_2[3] * x * e[6];
    if (degree < 3) return;
    g[0] += SH_3[0] * 6.0f * x * y * e[8] + SH_3[1] * y * z * e[9] -
            SH_3[2] * 2.0f * x * y * e[10] - SH_3[3] * 6.0f * x * z * e[11] +
            SH_3[4] * (4.0f * zz - 3.0f * xx - yy) * e[12] + SH_3[5] * 2.0f * x * z * e[13] +
            SH_3[6] * 3.0f * (xx - yy) * e[14];
    g[1] += SH_3[0] * 3.0f * (xx - yy) * e[8] + SH_3[1] * x * z * e[9] +
            SH_3[2] * (4.0f * zz - xx - 3.0f * yy) * e[10] - SH_3[3] * 6.0f * y * z * e[11] -
            SH_3[4] * 2.0f * x * y * e[12] - SH_3[5] * 2.0f * y * z * e[13] -
            SH_3[6] * 6.0f * x * y * e[14];
    g[2] += SH_3[1] * x * y * e[9] + SH_3[2] * 8.0f * y * z * e[10] +
            SH_3[3] * (6.0f * zz - 3.0f * xx - 3.0f * yy) * e[11] + SH_3[4] * 8.0f * x * z * e[12] +
            SH_3[5] * (xx - yy) * e[13];
}

}  // namespace
}  // namespace MATTGS_ISA
}  // namespace mattgs
