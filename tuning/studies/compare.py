"""Gain files on the same samples of a scenario's uncertainty: ``coopmm compare``.

>>> labels(["a/gains.toml", "b/gains.toml", "scenario"])
('a/gains', 'b/gains', 'scenario')
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.parameters import Parameters, PhaseSchedule, Schedule
from coopmm_jax.scenario.gains_file import read_gains
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.variation import vary
from coopmm_jax.sweeps.engine import carried_by
from tuning.cost.objective import Objective
from tuning.cost.problem import TEST, Problem, check_count, with_objective, with_scales
from tuning.cost.problem import scales as terms_scales
from tuning.studies.comparison import Comparison, compare, stacked

AnySchedule = Schedule | PhaseSchedule
OWN = "scenario"  # stands for the scenario's own gains in the place of a file


@dataclass(frozen=True)
class AnyGains:
    """All gains as a vector of their numbers, in their own units: unlike ``GainSpace``, those not tuned as well."""

    structure: Any  # of (``Gains``, their schedule or None) as a pytree

    @property
    def size(self) -> int:
        """Length of a vector."""
        return self.structure.num_leaves

    def applied(self, parameters: Parameters, vector: Any) -> Parameters:
        """Parameters with the gains that a vector (n,) stands for."""
        gains, schedule = jax.tree.unflatten(self.structure, [vector[i] for i in range(self.size)])
        return parameters._replace(gains=gains, schedule=schedule)


@dataclass(frozen=True)
class ComparedGains:
    """S sets of gains on the same samples, in the order in which they were named."""

    scenario: Scenario
    labels: tuple[str, ...]  # (S,)
    comparison: Comparison

    @property
    def samples(self) -> int:
        """N."""
        return self.comparison.costs.shape[1]

    def outcomes(self) -> dict[str, np.ndarray]:
        """Rollouts (S, N) that completed, that met each requirement, and all of that together, as booleans."""
        met = {"completed": self.comparison.completed}
        met |= {str(r): self.comparison.met(r) for r in self.scenario.requirements.parsed()}
        return met | {"all together": np.logical_and.reduce(list(met.values()))}


def compare_gains(
    scenario: Scenario | str | Path,
    sources: Sequence[str | Path],
    samples: int | None = None,
    executor: Executor | None = None,
) -> ComparedGains:
    """Run several sets of gains on the same samples of a scenario's [uncertainty], over the whole duration.

    Costs are those of the scenario's [tuning], their terms scaled as ``tuning.tune`` does; the samples are the head of
    what a sweep draws and no tuning with the same seed has chosen anything by.

    Args:
        scenario: a scenario, or the name or path of one.
        sources: paths of gains files or of folders that have them, laid over the scenario, or the word "scenario" for
            its own gains; at least two.
        samples: number of samples; by default the scenario's tuning.test_samples.
        executor: whose workers run the rollouts, see ``coopmm_jax/sweeps/engine.py``; left out, this process does.

    Raises:
        UserError: fewer than two sources, a file that does not hold gains of this scenario, nothing varies, or no
            validation sample completes with the scenario's own gains, which scale the cost.
    """
    if len(sources) < 2:
        raise UserError("GAINS", f"at least two gain files, or one and the word {OWN}", f"{len(sources)}")
    if samples is not None:
        check_count(samples, "--samples", len(sources))
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    sets = [_laid(scenario, source) for source in sources]
    with carried_by(executor):
        return compare_scenarios(scenario, sets, labels(sources), samples)


def compare_scenarios(
    scenario: Scenario, sets: Sequence[Scenario], names: Sequence[str], samples: int | None = None
) -> ComparedGains:
    """Compare scenarios that differ from one in [law], [gains] and [schedule] alone, as ``compare_gains`` does.

    Args:
        scenario: the one whose own gains scale the cost.
        sets: S of them.
        names: for the report (S,).
        samples: number of samples; by default the scenario's tuning.test_samples.

    Raises:
        UserError: as ``compare_gains``.
    """
    count = samples or scenario.tuning.test_samples
    groups: dict[Any, list[int]] = {_program(scenario): []}  # its own program runs whether or not it is compared
    for i, one in enumerate(sets):
        groups.setdefault(_program(one), []).append(i)
    scales, found = {}, {}
    for members in groups.values():
        first = scenario if not scales else sets[members[0]]
        own, *gains = alike([each.parameters() for each in (first, *(sets[i] for i in members))])
        problem = _unscaled(first, own)
        scales = scales or terms_scales(problem, _vector(own))
        if members:
            vectors = np.stack([_vector(each) for each in gains])
            compared = compare(with_scales(problem, scales), vectors, TEST, count)
            found |= {i: (compared, row) for row, i in enumerate(members)}
    return ComparedGains(scenario, tuple(names), stacked([found[i] for i in range(len(sets))]))


def _program(scenario: Scenario) -> Any:
    """Key that sets of gains share which one compiled program runs."""
    return scenario.structure(), scenario.law.controller, isinstance(scenario.parameters().schedule, PhaseSchedule)


def labels(sources: Sequence[str | Path]) -> tuple[str, ...]:
    """Short names of gains files or folders (S,): as much of the end of their paths as tells them apart.

    >>> labels(["a/fast.toml", "a/slow.toml", "a/slow.toml"])
    ('fast', 'slow', 'slow (2)')
    """
    paths = [Path(str(source).removesuffix(".toml")) for source in sources]
    depth = 1
    while depth < max(len(path.parts) for path in paths):
        if len({path.parts[-depth:] for path in paths}) == len(set(paths)):
            break
        depth += 1
    short = ["/".join(path.parts[-depth:]) for path in paths]
    again = [short[:i].count(name) + 1 for i, name in enumerate(short)]
    return tuple(name if count == 1 else f"{name} ({count})" for name, count in zip(short, again, strict=True))


def alike(sets: Sequence[Parameters]) -> list[tuple[Gains, AnySchedule | None]]:
    """Gains and schedules, all over time or all over the phase, that differ in their numbers alone.

    What changes in one does so in all:

    >>> ramp = Parameters(schedule=Schedule((0.0, 1.0), {"k2": (5.0, 7.0)}))
    >>> [schedule.values["k2"] for _, schedule in alike([Parameters(), ramp])]
    [(5.0, 5.0), (5.0, 7.0)]
    """
    schedules = [each.schedule for each in sets if each.schedule is not None]
    if not schedules:
        return [(each.gains, None) for each in sets]
    names = sorted({name for schedule in schedules for name in schedule.values})
    knots = max(len(schedule[0]) for schedule in schedules)
    return [(each.gains, _extended(each, type(schedules[0]), names, knots)) for each in sets]


def _extended(parameters: Parameters, over: type[AnySchedule], names: Sequence[str], knots: int) -> AnySchedule:
    """A schedule of these gains with so many knots: constant ones have the same value at all.

    Further knots stand between the first two, on the line that joins them.
    """
    places, values = parameters.schedule or over((0.0, 1.0), {})
    shares = np.arange(1, knots - len(places) + 1) / (knots - len(places) + 1)

    def filled(ends: tuple) -> tuple:
        first, second = ends[:2]
        between = (jax.tree.map(lambda a, b, x=float(x): a + x * (b - a), first, second) for x in shares)
        return (first, *between, *ends[1:])

    found = {name: values.get(name, (getattr(parameters.gains, name),) * len(places)) for name in names}
    return over(filled(tuple(places)), {name: filled(at) for name, at in found.items()})


def _laid(scenario: Scenario, source: str | Path) -> Scenario:
    """The scenario under a gains file."""
    if str(source) == OWN:
        return scenario
    try:
        tables = read_gains(source)
    except UserError as error:
        raise UserError("GAINS", f"{error.must}, or the word {OWN}", error.was) from None
    try:
        return scenario.with_overrides(tables)
    except UserError as error:
        raise UserError(f"{source}: {error.field}", error.must, error.was, error.more) from None


def _vector(gains: tuple[Gains, AnySchedule | None]) -> np.ndarray:
    return np.array(jax.tree.leaves(gains))


def _unscaled(scenario: Scenario, own: tuple[Gains, AnySchedule | None]) -> Problem:
    """The scenario's cost over its whole duration, as a function of any gains like its ``own``."""
    variation = vary(scenario)
    if not variation.numbers:
        raise UserError("uncertainty", "given, so that there are samples to compare on", "empty")
    space: Any = AnyGains(
        jax.tree.structure(own)
    )  # in the place of a GainSpace: only its size and what it applies are used
    settings = scenario.tuning
    objective = Objective(space, variation.structure(), scenario.sample_time, scenario.steps, settings.tracking_from)
    return with_objective(scenario, variation, objective)
