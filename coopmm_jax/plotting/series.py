"""A figure of signals of your own, in the look of the others."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from coopmm_jax.errors import UserError
from coopmm_jax.plotting import style
from coopmm_jax.plotting.lines import TIME, extremes


@style.styled
def series(
    t: np.ndarray,
    values: Mapping[str, np.ndarray],
    unit: str,
    over: str = TIME,
    log: str = "",
    axes: style.GivenAxes = None,
) -> Figure:
    """Any signals over time, or over something else.

    Args:
        t: (T,) [s], or in the unit that ``over`` names.
        values: legend entry -> signal (T,).
        unit: label of the vertical axis, with its unit.
        over: label of the horizontal axis, with its unit.
        log: logarithmic axes: "x", "y" or "xy".
        axes: one matplotlib axes to draw on.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: values that are not as many as ``t``, or axes of the wrong number.

    >>> t = np.linspace(0.0, 1.0, 5)
    >>> figure = series(t, {"level": 1.0 - t, "inflow": t**2}, "volume [m^3]")
    """
    figure, (panel,) = style.panels(axes, [["series"]], height=3.2)
    for i, (name, signal) in enumerate(values.items()):
        if np.shape(signal) != np.shape(t):
            raise UserError(f"values[{name!r}]", f"of shape {np.shape(t)}, as t is", np.shape(signal))
        kept = extremes(np.asarray(signal))
        panel.plot(np.asarray(t)[kept], np.asarray(signal)[kept], label=name, **style.pen(i))
    panel.set(
        xlabel=over,
        ylabel=unit,
        xscale="log" if "x" in log else "linear",
        yscale="log" if "y" in log else "linear",
    )
    style.legend(panel)
    return figure
