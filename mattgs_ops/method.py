"""What a method changes against plain 3DGS, and those that are built in.

``3dgs`` is Kerbl et al. 2023 and nothing of ours, ``mcmc`` Kheradmand et al. 2024, ``ours``
MATT-GS read literally, ``ours+`` the best that its idea gives so far, ``3dgs-tuned`` all of
``ours+`` that is neither mask nor attention, and so the control of what those two bring;
docs/method.md says why each setting is what it is. A method of a benchmark's TOML file may start
from one of them: ``like = "ours+"``.
"""

from typing import Literal

from pydantic import Field, model_validator

from mattgs_ops.frozen import Background, Frozen


class McmcConfig(Frozen):
    """3DGS-MCMC's own settings (Kheradmand et al. 2024); the defaults are their released values."""

    noise: float = Field(5e5, ge=0, description="times the positions' learning rate")
    opacity_loss: float = Field(0.01, ge=0, description="times the mean opacity")
    scale_loss: float = Field(0.01, ge=0, description="times the mean scale, world units")
    dead_opacity: float = Field(0.005, gt=0, lt=1, description="dead is up to this")
    growth: float = Field(0.05, ge=0, le=1, description="more splats at each relocation")
    start_opacity: float = Field(0.5, gt=0, lt=1)
    start_scale: float = Field(0.1, gt=0, description="times the distance to the neighbours")


class MethodConfig(Frozen):
    """What a method changes against plain 3DGS; the defaults change nothing.

    ``weighting``: ``paper`` is eq. 15, ``A * |y - y_hat|``; ``residual`` is
    ``(1 + weight * A + mask_weight * M) * |y - y_hat|`` normalised to mean weight 1 (eq. 6, with
    the mask M beside the attention A); ``within`` gives the object as much in all, and shares it
    out inside by ``1 + weight * A``; with ``weight_ssim`` the same weight is on SSIM's map.
    ``attention``: ``paper`` is eqs. 9–14 on the training image as it is; ``interior`` is computed
    on the photo before compositing, and suppressed on a band along the mask's edge; ``object`` is
    the same with everything outside the mask suppressed too, whatever the background; ``local`` is
    the object's edges relative to those around them.
    ``densify``: which screen-space gradient asks for more splats, the ``signed`` sum over pixels
    (Kerbl et al. 2023) or the ``absolute`` one (AbsGS, Ye et al. 2024).
    ``growth``: ``threshold`` densifies where that gradient is high, ``budget`` as many splats as a
    schedule towards ``max_splats`` asks for, those of the highest gradient (after Taming 3DGS,
    Mallick et al. 2024), ``mcmc`` relocates dead splats and adds to the opaque ones up to
    ``max_splats`` (Kheradmand et al. 2024).
    ``prune``: how splats are scored for removal, at the projected centre (``pixel``, the paper's)
    or by blending weight times attention (``blend``).
    """

    attention: Literal["paper", "interior", "object", "local"] = "paper"
    weighting: Literal["none", "paper", "residual", "within"] = "none"
    weight: float = Field(1.0, ge=0)
    mask_weight: float = Field(
        0.0, ge=0, description="of the object's pixels, `residual` and `within` only"
    )
    weight_ssim: bool = Field(
        False, description="D-SSIM is weighted as L1 is, `residual` and `within` only"
    )
    edge_tolerance: float = Field(
        0.0,
        ge=0,
        le=0.1,
        description="share of the image's longest side, rounded to pixels, in which emptiness "
        "around a cut-out weighs nothing, `residual` and `within` on `nobg`",
    )
    alpha_loss: float = Field(
        0.0, ge=0, description="times the mean of |opacity - mask|, on `nobg` only"
    )
    rates: float = Field(1.0, gt=0, description="times every learning rate but opacity's")
    rates_steps: int = Field(
        0,
        ge=0,
        description="the length of training that `rates` is meant for: in longer ones it falls in "
        "inverse proportion to the steps; 0: it is the same in all",
    )
    rates_final: float = Field(
        1.0,
        gt=0,
        le=1,
        description="share of all learning rates but the position's that is left at the end, see "
        "`Schedule.rate_share`",
    )
    growth: Literal["threshold", "budget", "mcmc"] = "threshold"
    mcmc: McmcConfig = Field(McmcConfig(), description="of growth `mcmc`")
    densify: Literal["signed", "absolute"] = "signed"
    densify_absolute: float = Field(
        8e-4, gt=0, description="threshold of the absolute gradient; gsplat's default"
    )
    densify_absolute_nobg: float | None = Field(
        None, gt=0, description="the same where the background was removed; None: no other"
    )
    prune: Literal["none", "pixel", "blend"] = "none"
    prune_initial: bool = False
    prune_attention: float = Field(0.05, ge=0, le=1, description="low attention is below this")
    prune_opacity: float = Field(0.1, ge=0, le=1, description="low confidence is below this")
    prune_contribution: float = Field(
        0.0, ge=0, description="pixels' worth of blending weight in a view that sees the splat"
    )

    @model_validator(mode="after")
    def _weighted_by_residual(self) -> "MethodConfig":
        if self.weight_ssim and not self.keeps_scale:
            # A alone is near 0 almost everywhere: D-SSIM would be switched off with L1
            raise ValueError(
                f"weight_ssim: expected weighting `residual` or `within`, found `{self.weighting}`"
            )
        return self

    @model_validator(mode="after")
    def _relocated_and_nothing_else(self) -> "MethodConfig":
        if self.growth != "mcmc":
            return self
        for name in ("densify", "prune", "prune_contribution"):
            taken, found = type(self).model_fields[name].default, getattr(self, name)
            if found != taken:
                raise ValueError(f"{name}: expected {taken!r} with growth `mcmc`, found {found!r}")
        return self

    def absolute_threshold(self, background: Background) -> float:
        """Return the absolute gradient from which a splat is cloned or split."""
        if background == "nobg" and self.densify_absolute_nobg is not None:
            return self.densify_absolute_nobg
        return self.densify_absolute

    def rates_in(self, iterations: int) -> float:
        """Return the factor of the learning rates in a training of so many steps."""
        if not self.rates_steps:
            return self.rates
        return self.rates * min(1.0, self.rates_steps / iterations)

    @property
    def wants_blending(self) -> bool:
        """Whether the rasteriser must sum blending weights (and attention) per splat."""
        return self.prune == "blend" or self.prune_contribution > 0

    @property
    def keeps_scale(self) -> bool:
        """Whether the loss is weighted with mean weight 1."""
        return self.weighting in ("residual", "within")


TUNED = MethodConfig(
    rates=2.0,
    rates_steps=7000,  # at full rates, 30,000 steps fit the photos' noise
    rates_final=0.03,
    densify="absolute",
    # weight on the object raises its gradient with it: more than AbsGS's threshold leaves half as
    # many splats as in `3dgs` and fewer, most of all where a background takes its share
    densify_absolute=2e-3,
    densify_absolute_nobg=3e-3,
)
METHODS: dict[str, MethodConfig] = {
    "3dgs": MethodConfig(),
    "3dgs-tuned": TUNED,
    "mcmc": MethodConfig(growth="mcmc"),
    "ours": MethodConfig(weighting="paper", prune="pixel", prune_initial=True),
    "ours+": TUNED.model_copy(
        update={
            "attention": "local",
            "weighting": "within",
            "weight": 2.0,  # 5 gains small parts a little more, and the whole object pays for it
            "mask_weight": 5.0,
            "weight_ssim": True,
            "edge_tolerance": 0.0025,  # a pixel of 400: less than one of what U²-Net sees
            "alpha_loss": 0.1,  # enough against white floaters; 0.5 costs the rover 0.1 dB
            "prune": "blend",
            "prune_opacity": 0.05,
        }
    ),
}


def unfolded(table: object) -> object:
    """Replace the key ``like`` of a method's table by the settings of that built-in method.

    Raises ValueError naming the known ones. What is not a table is left to validation.
    """
    if not isinstance(table, dict) or "like" not in table:
        return table
    name = table["like"]
    if not isinstance(name, str) or name not in METHODS:
        raise ValueError(f"like = {name!r}: expected one of {', '.join(METHODS)}")
    return METHODS[name].model_dump() | {k: v for k, v in table.items() if k != "like"}
