"""Figures of a tuning: its convergence, its gains, bands of errors before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from coopmm_jax.parameters import Schedule
from coopmm_jax.plotting.bands import band, finished, scale
from coopmm_jax.plotting.limits import draw_desired, draw_limits
from coopmm_jax.plotting.lines import TIME
from coopmm_jax.plotting.style import BEFORE, legend, panels, pen, plain_numbers, styled
from coopmm_jax.sweeps.measure import SERIES
from coopmm_jax.sweeps.statistics import HIGH, LOW
from tuning.reports.owners import entry_owners, with_owner

if TYPE_CHECKING:
    from tuning.studies.result import TuningResult

_BANDS = ("contact_force", "tracking_error", "object_error", "relative_tip_error")


@styled
def convergence(result: TuningResult) -> Figure:
    """Risk by simulated steps: of each iteration's best candidate, and the lowest on the fixed samples so far."""
    figure, (axes,) = panels(None, [["risk"]], 3.0)
    steps = [row.steps / 1e6 for row in result.history]
    axes.semilogy(steps, [row.training for row in result.history], label="best of an iteration", marker=".", **pen(0))
    axes.semilogy(
        steps, [row.best for row in result.history], label="lowest on the fixed samples", marker=".", **pen(2)
    )
    axes.set(xlabel="simulated steps [million]", ylabel=result.scenario.tuning.minimised)
    plain_numbers(axes.yaxis)
    legend(axes)
    return figure


@styled
def gains(result: TuningResult) -> Figure:
    """Every tuned number before and after; over time or phase, where gains change."""
    if result.schedule is not None:
        return _at_knots(result)
    figure, (axes,) = panels(None, [["gains"]], 1.2 + 0.22 * len(result.labels))
    rows, owners = np.arange(len(result.labels))[::-1], entry_owners(result.scenario)
    for before, after, row in zip(result.before, result.after, rows, strict=True):
        axes.plot([before, after], [row, row], color="0.7", linewidth=1.0, zorder=1)
    axes.plot(result.before, rows, "o", mfc="white", color=BEFORE["color"], label="before")
    axes.plot(result.after, rows, "o", color=pen(0)["color"], label="after")
    axes.set_yticks(rows, [with_owner(label, owners) for label in result.labels])
    axes.set(xscale="log", xlabel="gain", ylim=(-0.6, len(rows) - 0.4))
    plain_numbers(axes.xaxis)
    legend(axes)
    return figure


def _at_knots(result: TuningResult) -> Figure:
    """Tuned gains over time or phase, a panel each."""
    places, names = np.array(result.schedule[0]), result.scenario.tuning.gains
    owner = [label.partition("@")[0].partition("[")[0] for label in result.labels]
    before, after = (values.reshape(len(places), -1) for values in (result.before, result.after))
    owners = entry_owners(result.scenario)
    figure, all_axes = panels(None, [[name] for name in names], 1.6 * len(names))
    for axes, name in zip(all_axes, names, strict=True):
        chosen = [k for k in range(before.shape[1]) if owner[k] == name]
        lines = axes.plot(places, before[:, chosen], **BEFORE)
        lines[0].set_label("before")
        for i, k in enumerate(chosen):
            owner_name = owners.get(f"{name}[{i}]", "after")
            axes.plot(places, after[:, k], marker="o", markersize=2.0, label=owner_name, **pen(i))
        axes.set(yscale="log", ylabel=name)
        plain_numbers(axes.yaxis)
        legend(axes)
    all_axes[-1].set_xlabel(TIME if isinstance(result.schedule, Schedule) else "phase of the path")
    return figure


@styled
def bands(result: TuningResult) -> Figure:
    """Median and 5 to 95 % of force and errors over the first test samples, before and after."""
    comparison = result.comparison
    figure, all_axes = panels(None, [[name] for name in _BANDS], 8.5)
    for axes, name in zip(all_axes, _BANDS, strict=True):
        if name == "contact_force":
            draw_desired(axes, result.scenario, comparison.times)
        for i, (label, line) in enumerate((("before", BEFORE), ("after", pen(0)))):
            values = finished(comparison.series[name][i])
            most = {"color": line["color"], "alpha": 0.2}
            band(axes, comparison.times, values, (LOW, HIGH), line | {"label": label}, most)
        scale([axes], name, f"[{SERIES[name][0]}]")
        draw_limits(axes, result.scenario, name, comparison.times)
        legend(axes, title=f"{SERIES[name][1]}: median and 5 to 95 %")
    all_axes[-1].set_xlabel(TIME)
    return figure
