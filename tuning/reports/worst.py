"""Report on the sample that hurts most: its scenario file, with tables, a figure and a page beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.files import write_csv, write_text
from coopmm_jax.kinds.software import loaded_plugins, record
from coopmm_jax.page import keep_page, read_page, write_page
from coopmm_jax.plotting import style
from coopmm_jax.plotting.bands import scale
from coopmm_jax.plotting.limits import draw_desired, draw_limits
from coopmm_jax.plotting.lines import TIME, extremes
from coopmm_jax.plotting.style import publish
from coopmm_jax.runs.course import Course, course
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.status import Status
from coopmm_jax.temporal_logic.signals import SIGNALS
from tuning.reports.asked import levels, signals
from tuning.reports.pages import falsify_page
from tuning.studies.falsify import Falsification


def write_results(
    folder: Path,
    name: str,
    found: Falsification,
    random: np.ndarray | None,
    scenario: Scenario,
    budget: tuple[int, int],
) -> None:
    """Write the scenario of the sample, its numbers as CSV, and what its page is made of.

    Args:
        folder: of the results.
        name: of the scenario file.
        found: the sample.
        random: costs (N,) of random samples, if there are any to compare with.
        scenario: that was searched.
        budget: rollouts and starts of the search.
    """
    write_text(folder / name, record(loaded_plugins()) + found.scenario.to_toml())
    stem = name.removesuffix(".toml")
    numbers = ([number, found.nominal[number], value] for number, value in found.numbers.items())
    write_csv(folder / f"{stem}.csv", ["number", "scenario", "found"], numbers)
    keep_page(folder, falsify_page(found, random, scenario, name, budget), f"{stem}.json")


def write_page_with_figure(path: Path, found: Falsification, scenario: Scenario) -> None:
    """Draw the sample's figure beside its scenario file, and write the page that has it.

    Args:
        path: of the scenario file, beside which ``write_results`` has kept what the page is made of.
        found: the sample.
        scenario: that was searched.
    """
    publish(path.parent, {path.with_suffix(".png").name: drawings([found], scenario)[0]})
    write_page(path.parent, read_page(path.with_suffix(".json")), path.with_suffix(".html").name)


def drawings(found: Sequence[Falsification], scenario: Scenario) -> list[Callable[[], Figure]]:
    """Functions that draw each of the samples found; one program runs all of them, and the scenario itself.

    Args:
        found: of one scenario.
        scenario: that was searched.
    """
    # Always those of the cost among them, so that mostly one program serves all searches of a scenario.
    names = list(
        dict.fromkeys(name for asked in (None, *(each.requirement for each in found)) for name in signals(asked))
    )
    nominal: list[Course] = []  # the scenario's own, once it is asked for

    def draw(each: Falsification) -> Figure:
        if not nominal:
            nominal.append(course(scenario, names))
        return over_time(each.scenario, each.requirement, course(each.scenario, names), nominal[0])

    return [lambda each=each: draw(each) for each in found]


@style.styled
def over_time(
    scenario: Scenario,
    requirement: Requirement | None,
    found: Course,
    nominal: Course,
    axes: style.GivenAxes = None,
) -> Figure:
    """Signals of a requirement over time, with its limits: in the sample found, and in the scenario itself.

    Args:
        scenario: of the sample found.
        requirement: that it was sought against; None: the cost.
        found: signals of the sample's run.
        nominal: the same of the scenario without uncertainty.
        axes: matplotlib axes to draw on, one for each signal.
    """
    names = signals(requirement)
    figure, panels = style.panels(axes, [[name] for name in names], height=2.6 * len(names) + 0.3)
    for panel, name in zip(panels, names, strict=True):
        _panel(panel, scenario, requirement, name, (nominal, found))
    panels[-1].set_xlabel(TIME)
    return figure


def _panel(
    axes: Axes, scenario: Scenario, requirement: Requirement | None, name: str, runs: tuple[Course, Course]
) -> None:
    t = max((run.t for run in runs), key=len)
    if name == "contact_force" and len(t):
        draw_desired(axes, scenario, t)
    looks = (("scenario itself", style.BEFORE), ("sample found", style.pen(0)))
    for run, (label, look) in zip(runs, looks, strict=True):
        kept = extremes(run.values[name])
        axes.plot(run.t[kept], run.values[name][kept], label=label, **look)
        if run.status is not Status.OK:
            end = run.t[-1] if len(run.t) else 0.0
            axes.axvline(end, label=f"{run.status.name} at {end:.3g} s, {label}", **style.FAILURE)
    about = SIGNALS[name]
    scale([axes], name, f"[{about.unit}]")
    if requirement is None:
        draw_limits(axes, scenario, name, t)
    else:
        _draw_levels(axes, requirement, name, scenario.simulation.duration)
    style.legend(axes, title=about.meaning[:1].upper() + about.meaning[1:])


def _draw_levels(axes: Axes, requirement: Requirement, name: str, duration: float) -> None:
    named: set[str] = set()
    for level in dict.fromkeys(levels(requirement, duration)):
        if level.signal != name or not np.isfinite(level.value):
            continue
        label = f"_{level.label}" if level.label in named else level.label
        mark = "_" if level.begin == level.end else None  # of one instant
        axes.plot([level.begin, level.end], [level.value] * 2, label=label, marker=mark, **style.LIMIT)
        named.add(level.label)
