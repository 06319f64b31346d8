"""When training does what: learning rates, SH degree, densification, opacity resets.

The published schedule (Kerbl et al. 2023) is written for 30,000 steps. With ``scale_schedule``
its step counts are multiplied by ``iterations / 30,000``, as gsplat's ``steps_scaler`` does. A
plain factor ruins short runs, so floors apply; none of them binds at 30,000 steps:

* Densification is at least 100 steps or a tenth of the run apart, whichever is less, and starts no
  earlier than that: the mean gradient needs some views, and splats must have settled a little.
  Steps of 25 or 50 in a run of 1,000 were measured: many more splats, hardly better or worse.
* It goes on for three quarters of the run, to step 2,500 at most, where half the run would end
  sooner: a short run is short of splats, not of time to polish them.
* An opacity reset needs time to heal: from 0.01 back to 0.5 takes at least 200 steps of Adam at
  the published rate, more for splats that few views see. Resets are at least 1,000 steps apart
  and leave 1,000 steps after the last one; a run with no room for that has none.
* SH degrees rise at least 25 steps apart.

3DGS-MCMC relocates from step 500 to 25,000 of 30,000 and never resets opacities. In a short run
relocations are at least 20 steps apart, no earlier than the first 20: each adds 5 % at most, and a
run of 1,000 steps would otherwise grow by half only.

Without ``scale_schedule`` the step counts stand as configured, and a shorter run simply ends
before they are reached. The last step never densifies or resets.
"""

import math
from dataclasses import dataclass, replace

from mattgs_ops.config import TrainConfig

PUBLISHED_ITERATIONS = 30_000
SHORTEST_DENSIFY_EVERY = 100  # also the earliest
SHORTEST_DENSIFY_SHARE = 0.1  # of a run so short that step 100 would be late
SHORT_DENSIFY_SHARE = 0.75
LATEST_SHORT_DENSIFY = 2500
SHORTEST_RESET_EVERY = 1000
SHORTEST_SH_EVERY = 25
MCMC_UNTIL = 25_000  # Kheradmand et al. 2024, released code: `densify_until_iter`
SHORTEST_RELOCATE_EVERY = 20
SETTLE_FROM = 0.3  # of the steps: from there on the learning rates may fall
SETTLE_EARLIEST = (
    2000  # step; measured: falling rates cost a training of 1,000 steps half a decibel
)


@dataclass(frozen=True)
class Schedule:
    """Steps are counted from 1 to ``iterations``; ``reset_every`` 0 means never."""

    iterations: int
    sh_degree: int
    sh_every: int
    densify_from: int
    densify_until: int
    densify_every: int
    reset_every: int
    lr_position: float  # world units: the configured rate times the scene's extent
    lr_position_final: float
    lr_steps: int  # over which the position's rate falls

    @classmethod
    def of(
        cls, config: TrainConfig, iterations: int, extent: float, *, mcmc: bool = False
    ) -> "Schedule":
        """Derive the schedule of one run; ``extent`` as :func:`initialise.scene_extent`.

        With ``mcmc`` splats are relocated where they would be densified, and opacities never reset.
        """
        schedule = cls._of_densification(config, iterations, extent)
        if not mcmc:
            return schedule
        factor = iterations / PUBLISHED_ITERATIONS if config.scale_schedule else 1.0
        return replace(
            schedule,
            densify_from=_scaled(config.densify_from, factor, SHORTEST_RELOCATE_EVERY - 1),
            densify_until=_scaled(MCMC_UNTIL, factor, 1),
            densify_every=_scaled(config.densify_every, factor, SHORTEST_RELOCATE_EVERY),
            reset_every=0,
        )

    @classmethod
    def _of_densification(cls, config: TrainConfig, iterations: int, extent: float) -> "Schedule":
        rates = (config.lr_position * extent, config.lr_position_final * extent)
        if not config.scale_schedule:
            return cls(
                iterations,
                config.sh_degree,
                config.sh_every,
                config.densify_from,
                config.densify_until,
                config.densify_every,
                config.opacity_reset_every,
                *rates,
                PUBLISHED_ITERATIONS,
            )
        factor = iterations / PUBLISHED_ITERATIONS
        rest = min(SHORTEST_DENSIFY_EVERY, round(SHORTEST_DENSIFY_SHARE * iterations))
        return cls(
            iterations,
            config.sh_degree,
            _scaled(config.sh_every, factor, SHORTEST_SH_EVERY),
            _scaled(config.densify_from, factor, rest - 1),
            _scaled_until(config, factor, iterations),
            _scaled(config.densify_every, factor, rest),
            _scaled_reset(config, factor, iterations),
            *rates,
            iterations,
        )

    def position_rate(self, step: int) -> float:
        """Return the learning rate of positions, falling exponentially over the run."""
        share = min(step / self.lr_steps, 1.0)
        first, last = math.log(self.lr_position), math.log(self.lr_position_final)
        return math.exp(first + (last - first) * share)

    def rate_share(self, step: int, final: float) -> float:
        """Return the share of the other learning rates that is left: falls to ``final`` at the end.

        3DGS keeps them constant, and what it ends with is noisy: one view a step moves the splats
        to and fro. Exponentially over the last ``1 - SETTLE_FROM`` of the steps, but not before
        ``SETTLE_EARLIEST``: a short training has no steps to give away.
        """
        begin = max(SETTLE_FROM * self.iterations, min(SETTLE_EARLIEST, self.iterations))
        if step <= begin:
            return 1.0
        return math.exp(math.log(final) * (step - begin) / (self.iterations - begin))

    def degree(self, step: int) -> int:
        """Return the SH degree in use: one more every ``sh_every`` steps."""
        return min(step // self.sh_every, self.sh_degree)

    @property
    def densify_end(self) -> int:
        """The step from which on nothing is added, removed or reset.

        Never after the last one: what is split or reset there would be saved as it is.
        """
        return min(self.densify_until, self.iterations)

    def densifies(self, step: int) -> bool:
        """Tell whether splats are added and removed after ``step``."""
        return step % self.densify_every == 0 and self.densify_from < step < self.densify_end

    def observes(self, step: int) -> bool:
        """Tell whether gradients of ``step`` count for densification."""
        return step < self.densify_end

    def resets(self, step: int) -> bool:
        """Tell whether opacities are reset after ``step``."""
        return self.reset_every > 0 and step % self.reset_every == 0 and step < self.densify_end

    def since_reset(self, step: int) -> int:
        """Return how many steps ago opacities were last reset; ``step`` if never."""
        if not self.reset_every:
            return step
        last = min(step, self.densify_end - 1) // self.reset_every * self.reset_every
        return step - last

    def settled(self, step: int) -> bool:
        """Tell whether low opacity means something: half a reset interval after the last reset.

        Splats that were reset are all at 0.01 or less; removing low ones by another rule than
        3DGS's own 0.005 must wait until the useful ones have recovered.
        """
        return self.since_reset(step) >= self.reset_every // 2


def _scaled(steps: int, factor: float, floor: int) -> int:
    """Scale a step count; the floor never raises it above what was configured."""
    return max(1, round(steps * factor), min(floor, steps))


def _scaled_until(config: TrainConfig, factor: float, iterations: int) -> int:
    longer = min(round(SHORT_DENSIFY_SHARE * iterations), LATEST_SHORT_DENSIFY)
    return _scaled(config.densify_until, factor, longer)


def _scaled_reset(config: TrainConfig, factor: float, iterations: int) -> int:
    every = _scaled(config.opacity_reset_every, factor, SHORTEST_RESET_EVERY)
    end = min(_scaled_until(config, factor, iterations), iterations)
    last = (end - 1) // every * every
    return every if 0 < last <= iterations - SHORTEST_RESET_EVERY else 0
