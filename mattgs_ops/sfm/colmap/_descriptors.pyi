"""Types of the compiled comparison of descriptors; see ``_kernels/nearest.h``."""

import numpy as np
from numpy.typing import NDArray

def instruction_sets() -> list[str]: ...
def nearest(
    rows: NDArray[np.uint8],
    columns: NDArray[np.uint8],
    column: NDArray[np.int32],
    best: NDArray[np.int32],
    second: NDArray[np.int32],
    instruction_set: str = "",
) -> None: ...
