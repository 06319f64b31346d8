"""Adam (Kingma & Ba 2015) in place, one pass over memory, by the compiled engine.

The same update as ``torch.optim.Adam`` without weight decay, up to rounding.
"""

from torch import Tensor

from mattgs_ops.errors import InputError
from mattgs_ops.splat import _engine
from mattgs_ops.splat.rasterize import MAX_THREADS, checked_array


def adam_step(
    value: Tensor,
    grad: Tensor,
    first_moment: Tensor,
    second_moment: Tensor,
    *,
    rate: float,
    step: int,
    betas: tuple[float, float] = (0.9, 0.999),
    epsilon: float = 1e-15,
    threads: int = 1,
) -> None:
    """Update ``value`` and its moments in place; all four float32, contiguous, of one shape.

    ``step`` counts from 1. Raises :class:`InputError` for other shapes, types or numbers.
    """
    tensors = {
        "value": value,
        "grad": grad,
        "first_moment": first_moment,
        "second_moment": second_moment,
    }
    for name, tensor in tensors.items():
        if not tensor.is_contiguous():
            raise InputError(f"{name}: expected a contiguous tensor, found strides")
    if step < 1:
        raise InputError(f"step: expected 1 or more, found {step}")
    if not 1 <= threads <= MAX_THREADS:
        raise InputError(f"threads: expected 1 to {MAX_THREADS}, found {threads}")
    shape = tuple(value.shape)
    p, g, m, v = (checked_array(name, tensor, shape) for name, tensor in tensors.items())
    _engine.adam(p, g, m, v, rate, betas[0], betas[1], epsilon, step, threads)
