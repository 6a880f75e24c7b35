"""Figures of sweeps: bands over time, required metrics against their limits, causes, the worst samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.errors import UserError
from coopmm_jax.plotting import style
from coopmm_jax.plotting.bands import band, scale
from coopmm_jax.plotting.limits import draw_desired, draw_limits
from coopmm_jax.plotting.lines import TIME
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.sweeps import store
from coopmm_jax.sweeps.intervals import success
from coopmm_jax.sweeps.statistics import HIGH, LOW, Results, as_results, sensitivities, telling, worst_samples

if TYPE_CHECKING:
    import xarray

    from coopmm_jax.scenario.scenario import Scenario

BINS = 40
STRONGEST = 8  # draws in a panel
WORST = 10  # samples marked in a panel
_SERIES = ("tracking_error", "object_error", "contact_force", "torque")
_SHADES = ("#a5cbe3", "#d8e8f4")  # of the 90 % band and of the whole range


@style.styled
def sweep_bands(data: xarray.Dataset, axes: style.GivenAxes = None) -> Figure:
    """Median, 90 % band and range over time of tracking error, object error, contact force and largest torque.

    Drawn from the samples whose series a sweep keeps; one that fails counts until then.

    Args:
        data: of a sweep that keeps series.
        axes: four matplotlib axes to draw on.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: no series were kept, a corrupt chunk, or axes of the wrong number.
    """
    if not data.sizes["kept"]:
        raise UserError("keep", "at least 1 for bands over time", 0)
    figure, panels = style.panels(axes, [_SERIES[:2], _SERIES[2:]], height=5.0)
    computed = data.status.values[: data.sizes["kept"]] >= 0
    scenario = store.scenario_of(data)
    for panel, name in zip(panels, _SERIES, strict=True):
        _band_panel(panel, data[name], computed, data.t.values, scenario)
    return figure


@style.styled
def sweep_requirements(sweep: xarray.Dataset | Results, axes: style.GivenAxes = None) -> Figure:
    """Distribution of each required metric over the completed samples; the side that breaks its limit is hatched.

    Without requirements, the metrics of the report.

    Args:
        sweep: its data set, or the results read from it.
        axes: matplotlib axes to draw on, one for each metric.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: nothing computed yet, a corrupt chunk, or axes of the wrong number.
    """
    results = as_results(sweep)
    limits = list(results.requirements) or list(results.metrics)
    figure, panels = style.panels(axes, _grid(len(limits)), height=2.2 * -(-len(limits) // 2))
    for panel, limit in zip(panels, limits, strict=True):
        _distribution_panel(panel, results, limit)
    return figure


@style.styled
def sweep_importance(sweep: xarray.Dataset | Results, axes: style.GivenAxes = None) -> Figure:
    """Rank correlation of the draws with completion and with each required metric, and its 95 % interval.

    A metric that is the same in all samples has no panel. Arguments as for ``sweep_requirements``.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: as ``sweep_requirements``, or no samples that differ.
    """
    return _by_metric(_importance_panel, sweep, axes)


@style.styled
def sweep_worst(sweep: xarray.Dataset | Results, axes: style.GivenAxes = None) -> Figure:
    """Draws of the worst samples, as quantiles of their distributions: one panel for each required metric.

    A draw whose marks crowd at one end is one that breaks the requirement. A metric that is the same in all samples
    has no panel. Arguments as for ``sweep_requirements``.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: as ``sweep_requirements``, or no samples that differ.
    """
    return _by_metric(_worst_panel, sweep, axes)


def _by_metric(
    draw: Callable[[Axes, Results, str], None], sweep: xarray.Dataset | Results, axes: style.GivenAxes
) -> Figure:
    """One panel for each metric that differs between samples."""
    results = as_results(sweep)
    metrics = telling(results)
    if not metrics:
        raise UserError("sweep", "one with samples that differ in what is required", "one without")
    figure, panels = style.panels(axes, _grid(len(metrics)), height=2.4 * -(-len(metrics) // 2))
    for panel, metric in zip(panels, metrics, strict=True):
        draw(panel, results, metric)
    return figure


def _grid(count: int) -> list[list[str]]:
    """Rows of two panels; a last one alone is as wide as both."""
    names = [str(i) for i in range(count)]
    rows = [names[i : i + 2] for i in range(0, count, 2)]
    return [row * 2 if len(row) == 1 else row for row in rows]


def _band_panel(axes: Axes, series: xarray.DataArray, computed: np.ndarray, t: np.ndarray, scenario: Scenario) -> None:
    values, name = store.values(series)[computed], str(series.name)
    most, whole = ({"color": shade, "label": part} for shade, part in zip(_SHADES, ("5 to 95 %", "range"), strict=True))
    if not band(axes, t, values, (LOW, HIGH), style.pen(0) | {"label": "median"}, most, whole):
        style.remark(axes, f"all {len(values)} samples\nfailed at once")
    elif name == "contact_force":
        draw_desired(axes, scenario, t)
    scale([axes], name, f"[{series.attrs['units']}]")
    draw_limits(axes, scenario, name, t)
    axes.set_xlabel(TIME)
    style.legend(axes, title=f"{series.attrs['long_name']:.1}".upper() + series.attrs["long_name"][1:])


def _distribution_panel(axes: Axes, results: Results, limit: Requirement | str) -> None:
    metric = limit if isinstance(limit, str) else limit.metric
    values = results.metrics[metric][results.completed]
    if not len(values):
        style.remark(axes, f"all {len(results.index)} samples failed")
    # Bins reach to the limit, so that a bar keeps a width to be seen however far from it the values lie.
    reach = [*values, *(() if isinstance(limit, str) else (limit.limit,))]
    span = (min(reach), max(reach)) if reach else None
    counts, edges = np.histogram(values, bins=BINS, range=span)
    axes.stairs(counts, edges, fill=True, color=style.pen(0)["color"])
    if counts.any():
        axes.set_yscale("log")
        axes.set_ylim(0.7, 2.0 * counts.max())
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("")
    axes.locator_params(axis="x", nbins=5)  # more labels of small numbers do not fit side by side
    axes.xaxis.set_major_formatter("{x:g}")
    shown = "robustness" if isinstance(limit, Requirement) and limit.sentence else metric
    axes.set_xlabel(f"{shown} [{results.scenario.requirements.metrics()[metric].unit}]")
    axes.set_ylabel("samples")
    if isinstance(limit, Requirement):
        met = success(int(results.met(limit).sum()), len(results.index))
        axes.set_title(f"{limit.short}\nmet by {met.estimate:.3f} ({met.low:.3f} to {met.high:.3f})")
        hatch_beyond(axes, limit)


def hatch_beyond(axes: Axes, limit: Requirement) -> None:
    """Hatch the values on the x axis that break a limit, with the limit and a little of its far side in view."""
    left, right = axes.get_xlim()
    margin = 0.05 * (max(right, limit.limit) - min(left, limit.limit))
    left, right = min(left, limit.limit - margin), max(right, limit.limit + margin)
    axes.axvline(limit.limit, **style.LIMIT)
    if limit.relation != ">=" and limit.relation != ">":
        axes.axvspan(limit.limit, right, **style.BEYOND)
    if limit.relation != "<=" and limit.relation != "<":
        axes.axvspan(left, limit.limit, **style.BEYOND)
    axes.set_xlim(left, right)


def _importance_panel(axes: Axes, results: Results, metric: str) -> None:
    strongest = list(sensitivities(results, metric).items())[:STRONGEST][::-1]
    estimates = [interval.estimate for _, interval in strongest]
    sides = [[i.estimate - i.low for _, i in strongest], [i.high - i.estimate for _, i in strongest]]
    axes.barh([draw for draw, _ in strongest], estimates, xerr=sides, color=_SHADES[0], error_kw={"linewidth": 1.0})
    axes.axvline(0.0, color="0.2", linewidth=0.8)
    axes.set_xlim(-1.0, 1.0)
    axes.set_xlabel("rank correlation")
    axes.set_title(metric)


def _worst_panel(axes: Axes, results: Results, metric: str) -> None:
    draws = list(sensitivities(results, metric))[:STRONGEST][::-1]
    chosen = worst_samples(results, metric, WORST)
    quantiles = results.quantiles(chosen)
    for row, draw in enumerate(draws):
        axes.plot(
            quantiles[draw], np.full(len(chosen), row), "o", color=style.pen(3)["color"], markersize=3.5, alpha=0.7
        )
    axes.set_yticks(range(len(draws)), draws)
    axes.set_ylim(-0.6, len(draws) - 0.4)
    axes.set_xlim(-0.02, 1.02)
    axes.set_xlabel("quantile of the draw")
    axes.set_title(f"{len(chosen)} worst of\n{metric}")
