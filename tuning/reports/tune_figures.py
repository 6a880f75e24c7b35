"""Figures of a tuning: its convergence, its gains, bands of errors before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from coopmm_jax.parameters import Schedule
from coopmm_jax.plotting.bands import band, finished, scale
from coopmm_jax.plotting.lines import TIME
from coopmm_jax.plotting.style import legend, panels, pen, styled
from coopmm_jax.sweeps.measure import SERIES
from coopmm_jax.sweeps.statistics import HIGH, LOW

if TYPE_CHECKING:
    from tuning.studies.result import TuningResult

_BANDS = ("contact_force", "tracking_error", "object_error", "relative_tip_error")


@styled
def convergence(result: TuningResult) -> Figure:
    """Risk by simulated steps: of each iteration's best candidate, and the lowest on the fixed samples so far."""
    figure, (axes,) = panels(None, [["risk"]], 3.0)
    steps = [row.steps / 1e6 for row in result.history]
    axes.semilogy(steps, [row.training for row in result.history], label="best of an iteration", **pen(0))
    axes.semilogy(steps, [row.best for row in result.history], label="lowest on the fixed samples", **pen(2))
    axes.set(xlabel="simulated steps [million]", ylabel="cost")
    _plain_numbers(axes.yaxis)
    legend(axes)
    return figure


@styled
def gains(result: TuningResult) -> Figure:
    """Every tuned number before and after; over time or phase, where gains change."""
    if result.schedule is not None:
        return _at_knots(result)
    figure, (axes,) = panels(None, [["gains"]], 1.2 + 0.22 * len(result.labels))
    rows = np.arange(len(result.labels))[::-1]
    for before, after, row in zip(result.before, result.after, rows, strict=True):
        axes.plot([before, after], [row, row], color="0.7", linewidth=1.0, zorder=1)
    axes.plot(result.before, rows, "o", mfc="white", color=pen(0)["color"], label="before")
    axes.plot(result.after, rows, "o", color=pen(4)["color"], label="after")
    axes.set_yticks(rows, result.labels)
    axes.set(xscale="log", xlabel="gain", ylim=(-0.6, len(rows) - 0.4))
    _plain_numbers(axes.xaxis)
    legend(axes)
    return figure


def _at_knots(result: TuningResult) -> Figure:
    """Tuned gains over time or phase, a panel each; grey: before."""
    places, names = np.array(result.schedule[0]), result.scenario.tuning.gains
    owner = [label.partition("@")[0].partition("[")[0] for label in result.labels]
    before, after = (values.reshape(len(places), -1) for values in (result.before, result.after))
    figure, all_axes = panels(None, [[name] for name in names], 1.6 * len(names))
    for axes, name in zip(all_axes, names, strict=True):
        chosen = [k for k in range(before.shape[1]) if owner[k] == name]
        axes.plot(places, before[:, chosen], color="0.7", linewidth=1.0)
        for i, k in enumerate(chosen):
            axes.plot(places, after[:, k], marker="o", markersize=2.0, label=f"[{i}]", **pen(i))
        axes.set(yscale="log", ylabel=name)
        _plain_numbers(axes.yaxis)
        legend(axes)
    all_axes[-1].set_xlabel(TIME if isinstance(result.schedule, Schedule) else "phase of the path")
    return figure


def _plain_numbers(axis: Axis) -> None:
    """Set few and short labels on a logarithmic axis, where matplotlib's own overlap if it spans little."""
    low, high = axis.get_view_interval()
    if high < 10.0 * low:
        axis.set_major_locator(MaxNLocator(5))
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)) if 10.0 <= high / low < 1e3 else NullLocator())
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("{x:g}")


@styled
def bands(result: TuningResult) -> Figure:
    """Median and 5 to 95 % of force and errors over the first test samples, before and after."""
    comparison = result.comparison
    figure, all_axes = panels(None, [[name] for name in _BANDS], 7.0)
    for axes, name in zip(all_axes, _BANDS, strict=True):
        for i, label in enumerate(("before", "after")):
            line = pen(4 * i)
            values = finished(comparison.series[name][i])
            most = {"color": line["color"], "alpha": 0.2}
            band(axes, comparison.times, values, (LOW, HIGH), line | {"label": label}, most)
        scale([axes], name, f"[{SERIES[name][0]}]")
    legend(all_axes[0])
    all_axes[-1].set_xlabel(TIME)
    return figure
