// The kernels of one instruction set; each is defined in the file named beside it.
#pragma once

#include "engine.h"

namespace mattgs {
namespace MATTGS_ISA {

// splats/project.cpp
int64_t project(const SplatArrays<const float>&, const Camera&, int sh_degree, int64_t first,
                int64_t last, const ProjectOutputs&);
// splats/project_back.cpp
void project_backward(const SplatArrays<const float>&, const Camera&, int sh_degree, int64_t first,
                      int64_t last, const SplatSums&, const GradientOutputs&, double* camera);
uint32_t descend(const Camera&, int sh_degree, int64_t first, int64_t last, const SplatSums&,
                 const Descent&, const SplatStatistics&);
// pixels/binning.cpp
void bin(BinningChunk&);
// pixels/forward.cpp, pixels/backward.cpp
void forward(ForwardTile&);
void backward(const BackwardTile&);
// pixels/loss.cpp
void loss(const LossImages&, int32_t first, int32_t last, LossSums*, float* scratch);
// peak.cpp
double multiply_add(int64_t rounds, float* sink);

const Kernels& table();

}  // namespace MATTGS_ISA
}  // namespace mattgs
