// The loss kernel over a whole image, on several threads.
#pragma once

#include "engine.h"

namespace mattgs {

// Loss of H x W x 3 values; fills grad.
LossSums photometric_loss(const Kernels& kernels, const LossImages& images, int threads);

}  // namespace mattgs
