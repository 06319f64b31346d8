"""One step of training: render a view, compare, go back, move the splats; then add and remove.

Gradients are analytic, from the engine; nothing here builds an autograd graph. The order within a
step is gsplat's: Adam moves the splats first, then the method's strategy adds and removes some
(:mod:`~mattgs_ops.splat.training.strategies`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mattgs_ops.config import TrainConfig
from mattgs_ops.errors import StageError
from mattgs_ops.frozen import Background
from mattgs_ops.method import MethodConfig
from mattgs_ops.splat.alpha_loss import alpha_loss
from mattgs_ops.splat.attention import attention_map, loss_weights, point_scores
from mattgs_ops.splat.exposure import as_photographed
from mattgs_ops.splat.memory import Memory
from mattgs_ops.splat.photos import (
    WHITE,
    Colour,
    Floats,
    StoredView,
    background_colour,
    recolour,
    unit_range,
)
from mattgs_ops.splat.rasterize import Rendering, SplatStatistics, render
from mattgs_ops.splat.ssim import photometric_loss, psnr
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.initialise import StartingPoints
from mattgs_ops.splat.training.schedule import Schedule
from mattgs_ops.splat.training.strategies.base import Strategy
from mattgs_ops.splat.training.strategies.gradient import GradientStrategy
from mattgs_ops.splat.training.strategies.mcmc import McmcStrategy


@dataclass(frozen=True)
class StepResult:
    """What a step saw before it moved the splats."""

    loss: float  # as optimised
    l1: float  # plain mean absolute difference
    ssim: float
    image: Tensor  # [H, W, 3] the rendering, with the photo's exposure where it has one
    target: Tensor  # [H, W, 3]

    @property
    def psnr(self) -> float:
        """Peak signal-to-noise ratio in dB of the unrounded rendering."""
        return psnr(self.image, self.target)


class Trainer:
    """What stays the same from step to step; the running state is handed in."""

    def __init__(
        self,
        views: Sequence[StoredView],
        background: Background,
        method: MethodConfig,
        config: TrainConfig,
        schedule: Schedule,
        extent: float,
        threads: int,
    ) -> None:
        self.views, self.background, self.method = views, background, method
        self.config, self.schedule, self.extent, self.threads = config, schedule, extent, threads
        self._maps: dict[int, Tensor] = {}
        self._weights: dict[int, Tensor | None] = {}
        self._memory = Memory()
        self._rates = method.rates_in(schedule.iterations)
        self._fixed_rates = {
            "log_scales": self._rates * config.lr_scale,
            "quaternions": self._rates * config.lr_rotation,
            "opacity_logits": config.lr_opacity,
            "sh_dc": self._rates * config.lr_sh_dc,
            "sh_rest": self._rates * config.lr_sh_rest,
        }
        self.strategy = self._strategy()

    def _strategy(self) -> Strategy:
        method, config, schedule = self.method, self.config, self.schedule
        if method.growth == "mcmc":
            return McmcStrategy(method.mcmc, config, schedule, self._rates)
        return GradientStrategy(
            method, config, schedule, self.extent, self.background, self._scores_at
        )

    def attention(self, index: int) -> Tensor:
        """Return the attention map of a view [H, W], computed once."""
        if index not in self._maps:
            view = self.views[index]
            arrays = [unit_range(a).numpy() for a in (view.image, view.photo, view.mask)]
            removed = self.background == "nobg"
            found = attention_map(*arrays, kind=self.method.attention, removed=removed)
            self._maps[index] = torch.from_numpy(found)
        return self._maps[index]

    def attended(self, points: StartingPoints, fewest: int) -> NDArray[np.bool_]:
        """Say which starting points have attention [P]; all, if fewer than ``fewest`` would.

        Every point starts with the same opacity, so attention alone decides here.
        """
        chosen = self._scores_at(points.xyz) >= self.method.prune_attention
        return chosen if int(chosen.sum()) >= fewest else np.ones_like(chosen)

    def step(self, state: TrainingState) -> StepResult:
        """Do one step; changes ``state``. Raises :class:`StageError` on NaN or infinity."""
        step = state.step + 1
        index = self._next_view(state)
        view = self.views[index]
        colour = self._colour(state)
        target = self.target(view, colour, self._memory)
        rendering = render(
            state.splats,
            view.camera,
            colour,
            sh_degree=self.schedule.degree(step),
            threads=self.threads,
            memory=self._memory,
        )
        exposures = state.exposures
        shown = as_photographed(exposures, index, rendering, colour)
        loss = photometric_loss(
            shown,
            target,
            ssim_lambda=self.config.ssim_lambda,
            weight=self.weights(index),
            weight_ssim=self.method.weight_ssim,
            threads=self.threads,
            memory=self._memory,
        )
        alpha, grad_alpha = self.alpha_loss(index, rendering)
        total = loss.loss + alpha + self.strategy.penalty(state.splats)
        if not math.isfinite(total):
            raise StageError(f"step {step}, view {view.name}: the loss is {total}")
        grad = loss.grad
        if exposures is not None:
            through = exposures.descend(index, rendering, colour, grad, step)
            grad, grad_alpha = through.image, through.with_alpha(grad_alpha)
        try:
            observed = self._descend(state, index, rendering, grad, grad_alpha)
        except StageError as error:
            raise StageError(f"step {step}: {error}") from error
        self.strategy.after_step(state, step, observed, rendering)
        state.step = step
        return StepResult(total, loss.plain_l1, loss.ssim, shown, target)

    def _descend(
        self,
        state: TrainingState,
        index: int,
        rendering: Rendering,
        grad: Tensor,
        grad_alpha: Tensor | None,
    ) -> SplatStatistics:
        """Move the splats, with the sums per splat that the method needs and no others."""
        method, step = self.method, state.step + 1
        blends = method.wants_blending and self.schedule.observes(step)
        share = self.schedule.rate_share(step, method.rates_final)
        rates = {name: share * rate for name, rate in self._fixed_rates.items()}
        rates["means"] = self._rates * self.schedule.position_rate(step)
        return state.adam.descend(
            rendering,
            grad,
            rates,
            grad_alpha=grad_alpha,
            pixel_map=self.attention(index) if blends else None,
            statistics=self.strategy.statistics(step),
            penalties=self.strategy.penalties(len(state.splats)),
            memory=self._memory,
        )

    def weights(self, index: int) -> Tensor | None:
        """Return the L1 weights of a view [H, W], or None; computed once."""
        if self.method.weighting == "none":
            return None
        if index not in self._weights:
            mask, attention = unit_range(self.views[index].mask).numpy(), self.attention(index)
            removed = self.background == "nobg"
            found = loss_weights(attention.numpy(), mask, self.method, removed=removed)
            self._weights[index] = None if found is None else torch.from_numpy(found)
        return self._weights[index]

    def alpha_loss(self, index: int, rendering: Rendering) -> tuple[float, Tensor | None]:
        """Return the alpha loss of a view and dL/d alpha [H, W]; 0 and None where there is none."""
        if self.method.alpha_loss == 0 or self.background == "original":
            return 0.0, None
        weight = self.weights(index) if self.method.keeps_scale else None
        mask = unit_range(self.views[index].mask)
        return alpha_loss(rendering.alpha, mask, self.method.alpha_loss, weight)

    def target(self, view: StoredView, colour: Colour, memory: Memory | None = None) -> Tensor:
        """Return what a view should look like on ``colour`` [H, W, 3], in ``memory`` if given."""
        image = unit_range(view.image, memory)
        if self.background == "original" or colour == WHITE:
            return image
        return torch.from_numpy(recolour(image.numpy(), unit_range(view.mask).numpy(), colour))

    def fixed_psnr(self, state: TrainingState) -> float:
        """Return PSNR in dB of the middle view, over the colour that splats are shown on."""
        index, colour = len(self.views) // 2, background_colour(self.config)
        view = self.views[index]
        rendering = render(state.splats, view.camera, colour, threads=self.threads)
        image = as_photographed(state.exposures, index, rendering, colour)
        return psnr(image, self.target(view, colour))

    def _next_view(self, state: TrainingState) -> int:
        if not state.order:
            state.order = [int(i) for i in state.streams["order"].permutation(len(self.views))]
        return state.order.pop()

    def _colour(self, state: TrainingState) -> Colour:
        if self.config.background == "random":
            red, green, blue = state.streams["background"].random(3)
            return float(red), float(green), float(blue)
        return background_colour(self.config)

    def _scores_at(self, points: NDArray[np.float64]) -> Floats:
        maps = [self.attention(i).numpy() for i in range(len(self.views))]
        return point_scores(points, [view.camera for view in self.views], maps)[0]
