"""Bands over time: the median of many rollouts, and how far most or all of them lie from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes


def band(
    axes: Axes,
    t: np.ndarray,
    values: np.ndarray,
    within: tuple[float, float],
    line: Mapping[str, Any],
    most: Mapping[str, Any] | None = None,
    whole: Mapping[str, Any] | None = None,
) -> bool:
    """Draw the median of N rollouts, as far as any is under way, and what lies between two quantiles.

    Args:
        axes: to draw on.
        t: times (T,) [s].
        values: of a quantity (N, T), in its unit; NaN from a rollout's failure on.
        within: shares of the rollouts at the lower and the upper quantile.
        line: matplotlib's settings for the median.
        most: for the area between the quantiles; none is drawn without.
        whole: for the area from the smallest to the largest value; none is drawn without.

    Returns:
        False if there is nothing to draw.
    """
    alive = np.isfinite(values).any(axis=0)
    if not alive.any():
        return False
    lowest, low, median, high, highest = np.nanquantile(values[:, alive], [0.0, within[0], 0.5, within[1], 1.0], axis=0)
    for edges, settings in (((lowest, highest), whole), ((low, high), most)):
        if settings is not None:
            axes.fill_between(t[alive], *edges, linewidth=0.0, **settings)
    axes.plot(t[alive], median, **line)
    return True


def finished(values: np.ndarray) -> np.ndarray:
    """Rows of values (N, T) of the rollouts that did not fail."""
    return values[~np.isnan(values).any(axis=1)]


def scale(panels: Sequence[Axes], name: str, unit: str) -> None:
    """Name the quantity that panels side by side show, and make their axes logarithmic for errors over a decade.

    Over less than a decade a logarithmic axis says nothing more, in numbers too long for its ticks.

    Args:
        panels: with everything drawn.
        name: of the quantity, as in ``SERIES``, and what else the label has to say.
        unit: of it, in brackets.
    """
    panels[0].set_ylabel(f"{name.replace('_', ' ')} {unit}")
    low = min(panel.dataLim.y0 for panel in panels)
    high = max(panel.dataLim.y1 for panel in panels)
    if "_error" in name and high > 10.0 * low > 0.0:
        for panel in panels:
            panel.set_yscale("log")
