"""Logarithmic axes with plain numbers: matplotlib's own are mathematical text.

Names of photos may hold dollars, so that figures draw text as it is; powers of ten that are written
in dollars would stand there as they are written.
"""

from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

NARROW, WIDE = 5, 30  # ratios of an axis' ends: even steps below, the powers of ten alone above
POWERS = range(-6, 10)  # of ten, that an axis may show
MOST = 6  # even steps on a narrow axis


def plain_numbers(axis: Axis) -> None:
    """Put plain numbers on a logarithmic axis, where there is room for them.

    Call when everything is drawn: the axis keeps these ticks.
    """
    low, high = sorted(axis.get_view_interval())
    steps = (1, 2, 5) if high / low < WIDE else (1,)
    ticks = [step * 10.0**power for power in POWERS for step in steps]
    if high / low < NARROW:  # not two of these may lie on it
        found = MaxNLocator(MOST, steps=(1, 2, 5, 10)).tick_values(low, high)
        ticks = [float(tick) for tick in found]
    axis.set_ticks([tick for tick in ticks if low <= tick <= high])
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,g}"))
    axis.set_minor_formatter(NullFormatter())
