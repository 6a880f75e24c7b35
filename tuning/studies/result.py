"""The outcome of a tuning: gains, how they were found, and what they are worth on untouched samples."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from coopmm_jax.kinds.software import loaded_plugins, versions
from coopmm_jax.scenario.gains_file import gains_text
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.sweeps.engine import carried_by
from tuning.cost.problem import TEST
from tuning.studies.chatter import Slopes, slopes
from tuning.studies.comparison import Comparison, compare
from tuning.studies.conflict import Conflict
from tuning.studies.margins import Margin, margins

if TYPE_CHECKING:
    from tuning.cost.problem import Problem

_AT = 0.01  # share of a logarithmic range within which a gain sits at its bound


class Row(NamedTuple):
    """One line of the history."""

    iteration: int  # 0: screening
    stage: str
    training: float  # lowest risk of this iteration's candidates, on its own samples
    best: float  # lowest risk so far on the fixed samples
    rejected: int  # descent steps that were rejected or shortened
    steps: int  # simulated so far
    seconds: float  # of wall time so far


@dataclass(frozen=True)
class TuningResult:
    """The tuned gains, how they were found, and what they are worth."""

    scenario: Scenario  # with the tuned gains
    labels: list[str]  # of the tuned numbers
    before: np.ndarray  # their values under the starting gains
    after: np.ndarray
    comparison: Comparison  # on the untouched test samples
    margins: list[Margin]  # of the tuned numbers
    slopes: Slopes  # of the cost, where they say whether the gains chatter
    at_bounds: list[str]  # names of those that sit at a bound of [tuning.bounds]
    history: list[Row] = field(default_factory=list)
    stopped: str = ""  # why the search ended
    resumable: bool = False  # whether it ended early
    conflict: Conflict | None = None  # of hard requirements; None where all are kept, or there are none

    @property
    def gains(self) -> Any:
        """The tuned gains, ``coopmm_jax.kinds.robust_adaptive.Gains``."""
        return self.scenario.parameters().gains

    @property
    def schedule(self) -> Any:
        """Tuned gains that change, a ``Schedule`` of ``coopmm_jax.parameters``; None where all are constant."""
        return self.scenario.parameters().schedule

    def _repr_html_(self) -> str:
        from tuning.studies.html import page  # what it needs is slow to import, and only a notebook asks

        return page(self)


def report(
    problem: Problem,
    vector: np.ndarray,
    history: list[Row] | None = None,
    stopped: str = "",
    resumable: bool = False,
    conflict: Conflict | None = None,
) -> TuningResult:
    """The gains of a vector (n,) against the scenario's own, on the untouched test samples.

    Args:
        problem: of the scenario.
        vector: logarithms of gains; moved between the bounds.
        history: of the search that found it.
        stopped: why that ended.
        resumable: whether it ended early.
        conflict: of hard requirements that the search could not keep.
    """
    with jax.enable_x64(True), carried_by(problem.executor):
        space, scenario = problem.space, problem.scenario
        vector = space.inside(vector)
        vectors = np.stack([space.start, vector])
        before, after = (np.asarray(space.values(each)) for each in vectors)
        return TuningResult(
            scenario=scenario.with_overrides(space.tables(vector)),
            labels=space.labels(),
            before=before,
            after=after,
            comparison=compare(problem, vectors, TEST, scenario.tuning.test_samples),
            margins=margins(problem, vector),
            slopes=slopes(problem, vector),
            at_bounds=_at_bounds(problem, vector),
            history=history or [],
            stopped=stopped,
            resumable=resumable,
            conflict=conflict,
        )


def gains_file(result: TuningResult) -> str:
    """The text of gains.toml: every gain, tuned or not, below what it was made from."""
    before, after = result.comparison.costs.mean(axis=1)
    scenario, count = result.scenario, result.comparison.costs.shape[1]
    made = ", ".join(f"{name} {version}" for name, version in versions().items() if name not in loaded_plugins())
    lines = [
        f"scenario: {scenario.description or 'that of scenario.toml beside this file'}",
        f"seed {scenario.simulation.seed}; {len(result.labels)} numbers tuned: {', '.join(scenario.tuning.gains)}",
        f"mean cost on {count} untouched samples: {before:.6g} before, {after:.6g} after",
        f"search: {result.stopped or 'none'}",
        made,
    ]
    return "".join(f"# {' '.join(line.split())}\n" for line in lines) + gains_text(result.gains, result.schedule)


def _at_bounds(problem: Problem, vector: np.ndarray) -> list[str]:
    reach = _AT * (problem.high - problem.low)
    near = (vector <= problem.low + reach) | (vector >= problem.high - reach)
    return [name for name, at in zip(problem.names, near, strict=True) if at]
