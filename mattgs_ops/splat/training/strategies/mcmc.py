"""3D Gaussian Splatting as Markov Chain Monte Carlo (Kheradmand et al. 2024, arXiv:2404.09591).

Splats are samples of a distribution, and training walks through it: after each step every centre is
shaken by noise that has the splat's own shape, the less the more opaque it is. Dead splats,
opacity 0.005 and less, are moved to live ones, drawn by opacity; as many as then share one place
get opacities and scales with which they look together as the one did before (eq. 9). So are a few
more splats at each relocation, up to ``max_splats``. Opacities and scales weigh in the loss, so
that what is not needed dies. Nothing is split, pruned or reset.

Constants as released (github.com/ubc-vision/3dgs-mcmc), which has the noise's factor as a sigmoid
of 100 · (0.005 - opacity) and leaves Adam's moments of a splat that was moved as they were.
"""

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from mattgs_ops.config import TrainConfig
from mattgs_ops.method import McmcConfig
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.rasterize import Rendering, SplatStatistics
from mattgs_ops.splat.torch_threads import torch_threads
from mattgs_ops.splat.training.checkpoint import TrainingState
from mattgs_ops.splat.training.densify import Record, logit, rotation_matrices
from mattgs_ops.splat.training.optimise import FIELDS, Adam, concatenate, select
from mattgs_ops.splat.training.schedule import Schedule
from mattgs_ops.splat.training.strategies.base import Strategy

MOST_COPIES = 51  # of one place; the release's table of binomials ends there
NOISE_STEEPNESS, NOISE_OPACITY = 100.0, 0.005  # of the sigmoid that switches the noise off
NO_NOISE = 0.25  # opacity from which the factor, 2e-11, moves no float32 coordinate
MOST_OPACITY = 1.0 - 2.0**-23
Array = NDArray[np.float64]


class McmcStrategy(Strategy):
    """Relocation, growth, noise and the two weights in the loss."""

    def __init__(
        self, settings: McmcConfig, config: TrainConfig, schedule: Schedule, rates: float
    ) -> None:
        self._settings, self._config, self._schedule = settings, config, schedule
        self._rates = rates  # times the positions' learning rate

    @override
    def statistics(self, step: int) -> bool:
        """Return False: nothing is observed."""
        return False

    @override
    def after_step(
        self, state: TrainingState, step: int, observed: SplatStatistics, rendering: Rendering
    ) -> None:
        """Relocate and add where that is due, then shake every centre."""
        rng = state.streams["mcmc"]
        if self._schedule.densifies(step):
            dead = self._settings.dead_opacity
            state.count("relocated", relocate(state.splats, state.adam, dead, rng))
            count = len(state.splats)
            more = min(self._config.max_splats, int((1 + self._settings.growth) * count)) - count
            state.splats = add(state.splats, state.adam, max(more, 0), dead, rng)
            state.count("added", len(state.splats) - count)
            state.count("capped", int(len(state.splats) >= self._config.max_splats))
            state.record = Record.empty(len(state.splats))
        rate = self._rates * self._schedule.position_rate(step)
        shake(state.splats, rate * self._settings.noise, rng)

    @override
    def penalties(self, count: int) -> tuple[float, float]:
        """Return the weights of a mean over all splats, and over all three scales of them."""
        return self._settings.opacity_loss / count, self._settings.scale_loss / (3 * count)

    @override
    def penalty(self, splats: Splats) -> float:
        """Return the weighted means of opacities and of scales."""
        opacity = float(splats.opacity_logits.sigmoid().mean(dtype=torch.float64))
        scale = float(splats.log_scales.exp().mean(dtype=torch.float64))
        return self._settings.opacity_loss * opacity + self._settings.scale_loss * scale


def shared(opacity: Array, copies: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return opacity [K] and factor of the scales [K] of splats that stand for one, eq. 9.

    ``opacity`` [K] was the one's, ``copies`` [K] says how many share it (51 count at most). The
    paper's double sum over i and k is one over m = k + 1, as binomials of a column add up:
    sum over i from 1 to N of C(i - 1, k) is C(N, k + 1).
    """
    copies = np.clip(copies, 1, MOST_COPIES)
    each = 1 - (1 - opacity) ** (1 / copies)
    m = np.arange(1, MOST_COPIES + 1)
    signs = np.where(m % 2 == 1, 1.0, -1.0) / np.sqrt(m)
    binomials = np.array([[math.comb(n, k) for k in m] for n in range(MOST_COPIES + 1)], np.float64)
    total = (binomials[copies] * signs * each[:, None] ** m).sum(axis=1)
    return each, opacity / total


def relocate(splats: Splats, adam: Adam, dead_opacity: float, rng: np.random.Generator) -> int:
    """Move splats of ``dead_opacity`` and less to live ones, in place; return how many."""
    is_dead = splats.opacity_logits <= logit(dead_opacity)
    dead, alive = (torch.nonzero(t)[:, 0] for t in (is_dead, ~is_dead))
    if len(dead) == 0 or len(alive) == 0:
        return 0
    chosen = alive[_drawn(splats.opacity_logits[alive], len(dead), rng)]
    _share(splats, adam, chosen, dead_opacity)
    for name in FIELDS:
        values = getattr(splats, name)
        values[dead] = values[chosen]
    return len(dead)


def add(
    splats: Splats, adam: Adam, count: int, dead_opacity: float, rng: np.random.Generator
) -> Splats:
    """Return the splats and ``count`` more, each beside one that was drawn by opacity."""
    if count == 0:
        return splats
    chosen = _drawn(splats.opacity_logits, count, rng)
    _share(splats, adam, chosen, dead_opacity)
    adam.join(count)
    return concatenate(splats, select(splats, chosen))


def shake(splats: Splats, strength: float, rng: np.random.Generator) -> None:
    """Move centres by covariance times normal noise, times ``strength`` and a factor of opacity."""
    moved = torch.nonzero(splats.opacity_logits < logit(NO_NOISE))[:, 0]
    if len(moved) == 0 or strength == 0:
        return
    noise = torch.from_numpy(rng.standard_normal((len(moved), 3), dtype=np.float32))
    with torch_threads(1):  # more would round some of the exponentials otherwise
        opacity = splats.opacity_logits[moved].sigmoid()
        factor = strength * torch.sigmoid(NOISE_STEEPNESS * (NOISE_OPACITY - opacity))
        axes = rotation_matrices(splats.quaternions[moved])  # columns are the splat's axes
        along = (axes.transpose(1, 2) @ noise[:, :, None])[:, :, 0]
        along = along * (2 * splats.log_scales[moved]).exp() * factor[:, None]
        splats.means[moved] += (axes @ along[:, :, None])[:, :, 0]


def _drawn(logits: Tensor, count: int, rng: np.random.Generator) -> Tensor:
    """Return ``count`` indices, drawn by opacity with repetition."""
    weights = logits.double().sigmoid().numpy()
    chosen = rng.choice(len(weights), size=count, p=weights / weights.sum())
    return torch.from_numpy(chosen)


def _share(splats: Splats, adam: Adam, chosen: Tensor, least: float) -> None:
    """Give the splats of ``chosen`` [K] what they have when so many more share their places."""
    places, counts = torch.unique(chosen, return_counts=True)
    opacity = splats.opacity_logits[places].double().sigmoid().numpy()
    each, factor = shared(opacity, counts.numpy() + 1)
    each = np.clip(each, least, MOST_OPACITY)
    splats.opacity_logits[places] = torch.from_numpy(np.log(each / (1 - each))).float()
    splats.log_scales[places] += torch.from_numpy(np.log(factor)).float()[:, None]
    for moments in (adam.first, adam.second):
        for name in FIELDS:
            moments[name][places] = 0
