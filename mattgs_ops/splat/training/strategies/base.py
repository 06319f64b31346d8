"""What a trainer asks of a strategy, between two steps."""

from abc import ABC, abstractmethod

from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import Rendering, SplatStatistics
from mattgs_ops.splat.training.checkpoint import TrainingState


class Strategy(ABC):
    """Adds, removes and moves splats after each step; keeps no state of its own."""

    @abstractmethod
    def statistics(self, step: int) -> bool:
        """Tell whether ``step`` must sum absolute gradients and blending weights per splat."""

    @abstractmethod
    def after_step(
        self, state: TrainingState, step: int, observed: SplatStatistics, rendering: Rendering
    ) -> None:
        """Change the splats of ``state`` after Adam has moved them."""

    def penalties(self, count: int) -> tuple[float, float]:
        """Return the weights in the loss of one splat's opacity and of one of its scales."""
        del count
        return 0.0, 0.0

    def penalty(self, splats: Splats) -> float:
        """Return what opacities and scales add to the loss."""
        del splats
        return 0.0
