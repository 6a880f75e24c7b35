"""Figures of a comparison of gains: required metrics against their limits, paired costs, bands over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.plotting.bands import band, finished, scale
from coopmm_jax.plotting.limits import draw_desired, draw_limits
from coopmm_jax.plotting.lines import TIME
from coopmm_jax.plotting.style import BEFORE, EQUAL, WIDTH, GivenAxes, legend, panels, pen, plain, plain_numbers, styled
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.sweeps.figures import hatch_beyond
from coopmm_jax.sweeps.measure import SERIES
from coopmm_jax.sweeps.statistics import HIGH, LOW

if TYPE_CHECKING:
    from tuning.studies.compare import ComparedGains

# (series, from which share of the duration on): the start's peak would hide how steady the force is later
_ROWS = (("contact_force", 0.0), ("contact_force", 0.5), ("tracking_error", 0.0), ("object_error", 0.0))
_MARKERS = "osD^v"
_GOLDEN = 0.6180339887498949  # multiples of it spread points evenly whatever their number


@styled
def requirements(compared: ComparedGains, axes: GivenAxes = None) -> Figure:
    """Each required metric of every completed sample, set by set, with median and 5 to 95 %; hatched beyond its limit.

    Args:
        compared: the comparison.
        axes: matplotlib axes to draw on, one for each requirement.
    """
    limits, sets = compared.scenario.requirements.parsed(), len(compared.labels)
    layout = [[str(i)] for i in range(len(limits))]
    figure, all_axes = panels(axes, layout, height=len(limits) * (0.75 + 0.3 * sets))
    for panel, limit in zip(all_axes, limits, strict=True):
        _strips(panel, compared, limit)
    return figure


@styled
def costs(compared: ComparedGains, axes: GivenAxes = None) -> Figure:
    """Every sample's cost under each set against that under the first, and the distribution of the ratios.

    Args:
        compared: the comparison.
        axes: two matplotlib axes to draw on.
    """
    figure, (pairs, shares) = panels(axes, [["pairs", "shares"]], height=3.2)
    first, completed = compared.comparison.costs[0], compared.comparison.completed
    labels = list(map(plain, compared.labels))
    for i, label in enumerate(labels[1:], 1):
        both = completed[0] & completed[i]
        before, after = first[both], compared.comparison.costs[i][both]
        colour = pen(i)["color"]
        name = label if both.all() else f"{label} ({(~both).sum()} failures left out)"
        pairs.plot(before, after, _MARKERS[(i - 1) % 5], color=colour, markersize=3.5, mfc="none", label=name)
        ratios = np.sort(after / before)
        shares.plot(ratios, np.arange(1, len(ratios) + 1) / max(1, len(ratios)), label=name, **pen(i))
    pairs.axline((1.0, 1.0), (2.0, 2.0), label="equal", **EQUAL)
    pairs.set(xscale="log", yscale="log", xlabel=f"cost under {labels[0]} [-]", ylabel="cost [-]")
    shares.axvline(1.0, label="equal", **EQUAL)
    shares.set(xscale="log", xlabel=f"cost over that under {labels[0]} [-]", ylabel="share of samples [-]")
    for axis in (pairs.xaxis, pairs.yaxis, shares.xaxis):
        plain_numbers(axis)
    legend(pairs, title=f"Cost of each sample, against that under {labels[0]}")
    legend(shares, title="Ratio of both costs: share of samples with a smaller one")
    return figure


@styled
def bands(compared: ComparedGains, axes: GivenAxes = None) -> Figure:
    """Median and 5 to 95 % over time of force and errors, a column for each set; the first set's median in all.

    Args:
        compared: the comparison.
        axes: matplotlib axes to draw on, four rows of as many as there are sets.
    """
    sets = len(compared.labels)
    layout = [[f"{row} {i}" for i in range(sets)] for row in range(len(_ROWS))]
    figure, all_axes = panels(axes, layout, height=7.0, width=max(WIDTH, 1.0 + 2.0 * sets))
    for row, (name, since) in enumerate(_ROWS):
        line = all_axes[row * sets : (row + 1) * sets]
        for i, panel in enumerate(line):
            _band(panel, compared, name, since, i)
            panel.sharey(line[0])
            panel.tick_params(labelleft=i == 0)
        scale(line, f"{name}, late" if since else name, f"[{SERIES[name][0]}]")
        for panel in line:
            draw_limits(panel, compared.scenario, name, compared.comparison.times, (panel.dataLim.x0, np.inf))
    figure.legend(handles=_key(all_axes), loc="outside upper left", ncols=5, fontsize=8)
    for name, top, bottom in zip(_names(compared), all_axes, all_axes[-sets:], strict=False):
        top.set_title(name)
        bottom.set_xlabel(TIME)
    return figure


def _key(all_axes: Sequence[Axes]) -> list[Artist]:
    """One legend for all panels: the first line of each label."""
    found: dict[str, Artist] = {}
    for axes in all_axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values())


def _names(compared: ComparedGains) -> list[str]:
    """Labels of the sets, with the number of rollouts that fail and so are not drawn."""
    failing, labels = (~compared.comparison.completed).sum(axis=1), map(plain, compared.labels)
    return [f"{label} ({n} fail)" if n else label for label, n in zip(labels, failing, strict=True)]


def _strips(axes: Axes, compared: ComparedGains, limit: Requirement) -> None:
    for i, completed in enumerate(compared.comparison.completed):
        values = compared.comparison.metrics[limit.metric][i][completed]
        if not len(values):
            continue
        heights = i + 0.5 * ((np.arange(len(values)) * _GOLDEN) % 1.0 - 0.5)
        axes.plot(values, heights, "o", color=pen(i)["color"], markersize=2.5, alpha=0.6, markeredgewidth=0.0)
        low, middle, high = np.quantile(values, [LOW, 0.5, HIGH])
        axes.plot([low, high], [i + 0.35] * 2, color="0.2", linewidth=1.2)
        axes.plot(middle, i + 0.35, "|", color="0.2", markersize=8, markeredgewidth=1.6)
    names = _names(compared)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xmargin(0.03)
    axes.grid(axis="y", visible=False)
    unit = compared.scenario.requirements.metrics()[limit.metric].unit
    axes.set_xlabel(f"{limit.short} [{unit}]")
    hatch_beyond(axes, limit)


def _band(axes: Axes, compared: ComparedGains, name: str, since: float, which: int) -> None:
    """Band of a set, the median of the first, and the desired force."""
    times = compared.comparison.times
    shown = times >= since * times[-1]
    if name == "contact_force":
        draw_desired(axes, compared.scenario, times[shown])
    for i in dict.fromkeys([which, 0]):
        values = finished(compared.comparison.series[name][i][:, shown])
        line, most = pen(0) | {"label": "median"}, {"color": pen(0)["color"], "alpha": 0.3, "label": "5 to 95 %"}
        if i != which:
            line, most = BEFORE | {"label": f"median, {plain(compared.labels[0])}"}, None
        band(axes, times[shown], values, (LOW, HIGH), line, most)
