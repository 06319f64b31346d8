// One instruction set's kernels by name.
#include "kernels.h"
#include "vec.h"

#define MATTGS_TEXT_(x) #x
#define MATTGS_TEXT(x) MATTGS_TEXT_(x)

namespace mattgs {
namespace MATTGS_ISA {

const Kernels& table() {
    static constexpr Kernels kernels = {MATTGS_TEXT(MATTGS_ISA),
                                        LANES,
                                        project,
                                        project_backward,
                                        descend,
                                        bin,
                                        forward,
                                        backward,
                                        loss,
                                        multiply_add};
    return kernels;
}

}  // namespace MATTGS_ISA
}  // namespace mattgs
