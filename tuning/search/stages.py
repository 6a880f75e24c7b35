"""The search's stages: scans of one gain at a time, and between them generations of CMA-ES or descents along gradients.

Measured on ``sensed`` (19 gains, 20 s): a scan from the best of 256 Sobol points halves the cost with a twentieth of
the budget, since one or two gains of such a point are far off; generations alone need four times as long for that, and
where they end, a scan still frees a gain that lies on a plateau.

``auto`` means descents along exact gradients from ``MANY`` numbers on, and generations below. From the best of 64 Sobol
points, without scans, on ``sensed`` over 4 s with 152 numbers, descents were at a cost of 0.467 after 7 s of CPU and at
0.424 after 17 s, generations at 0.504 after 38 s; on ``paper_full`` descents were at 0.362 after 6 s, generations at
0.360 after 41 s. With 19 numbers both were at 0.537 after 7.5 s, and generations use two cores.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> from tuning.cost.problem import unscaled
>>> chosen = plan(unscaled(load_scenario("sensed")))
>>> [type(chosen.stage(i)).__name__ for i in range(4)]
['Scan', 'Generations', 'Scan', 'Generations']
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from tuning.cost.trials import steps_of
from tuning.search import cma, method
from tuning.search.method import LBFGS, Candidate, Optax, Trials

if TYPE_CHECKING:
    from tuning.cost.problem import Problem

CHECK = 20  # generations between two checks of the mean on the fixed samples
WIDE, NARROW = 0.3, 0.15  # standard deviations of first generations
HALF = 0.5  # share of the budget at which the wide local search ends
MANY = 100  # numbers from which on exact gradients win
DECAY = 100  # descent steps over which a cosine schedule falls to zero
# Times as many samples for narrow generations: tuned gains of ``sensed`` may chatter on the few robots with the
# lightest masses and the strongest disturbances, and among four there is mostly none (see experiments/README.md).
FINE = 4
# Such generations that half of the budget must have room for; else narrow ones take no more samples than wide ones.
ROOM = 15
_SMALL = 1e-3  # standard deviation, a factor on a gain, below which generations have converged
_WORTH = 1e-4  # least improvement for which a scan moves a gain


class Place(NamedTuple):
    """Progress of a search; a pytree of numbers and arrays."""

    vector: np.ndarray  # (n,) that the stage set out from, or has come to
    stage: int
    step: int  # of the stage
    draw: int  # sets of samples drawn so far
    inner: Any  # what the stage remembers


class Outcome(NamedTuple):
    """Findings of one step of a stage."""

    place: Place
    value: float  # lowest risk of its candidates, on its own samples
    rejected: int = 0  # descent steps rejected or shortened


class Stage(Protocol):
    """A part of the search."""

    @property
    def name(self) -> str:
        """Name that the user sees."""
        ...

    @property
    def until(self) -> float:
        """Share of the budget at which it ends [-]."""
        ...

    def begin(self, vector: np.ndarray) -> Any:
        """State of the stage at its start, a vector (n,)."""
        ...
        ...

    def advance(self, place: Place, trials: Trials) -> Outcome:
        """Take the next step."""
        ...
        ...

    def due(self, place: Place) -> bool:
        """True if its findings so far should be checked on the fixed samples."""
        ...
        ...

    def offer(self, place: Place) -> np.ndarray:
        """Vectors (K, n) for such a check, at any of its steps but the 0th."""
        ...
        ...

    def ended(self, place: Place, stale: int) -> bool:
        """True if it has come to its own end; ``stale`` checks in a row have improved nothing."""
        ...
        ...


@dataclass(frozen=True)
class Scan:
    """Every gain in turn, in random order, at values over its whole range; the best one is kept.

    One that changes over time keeps its shape: all its knots move together.
    """

    seed: int
    samples: int = 8
    knots: int = 1  # of each gain, see ``GainSpace``
    points: int = 8  # the gain's present value and seven others
    until: float = 1.0
    precision: str = "float64"
    name = "scanning"

    def begin(self, vector: np.ndarray) -> tuple:
        """Nothing, at any vector (n,)."""
        return ()

    def advance(self, place: Place, trials: Trials) -> Outcome:
        """Try one gain."""
        n = place.vector.size // self.knots
        i = np.random.default_rng((self.seed, place.stage)).permutation(n)[place.step]
        tried = np.repeat(place.vector[None], self.points, axis=0)
        shape = place.vector[i::n] - place.vector[i::n].mean()
        levels = np.linspace(trials.low[i], trials.high[i], self.points - 1)
        tried[1:, i::n] = np.clip(levels[:, None] + shape, trials.low[i], trials.high[i])
        values = trials.values(tried, self.samples, place.draw, self.precision)
        best = int(np.argmin(values))
        if not values[best] < values[0] - _WORTH * abs(values[0]):
            best = 0
        return Outcome(place._replace(vector=tried[best], step=place.step + 1), float(values[best]))

    def due(self, place: Place) -> bool:
        """True if every gain has had its turn."""
        return place.step == place.vector.size // self.knots

    def offer(self, place: Place) -> np.ndarray:
        """The gains kept so far (1, n)."""
        return place.vector[None]

    def ended(self, place: Place, stale: int) -> bool:
        """True if every gain has had its turn."""
        return self.due(place)


class Evolving(NamedTuple):
    """Generations under way."""

    cloud: cma.Cloud
    sum: np.ndarray  # of the means since the last check (n,)


@dataclass(frozen=True)
class Generations:
    """CMA-ES around where the search is, each generation on samples drawn anew."""

    seed: int
    samples: int
    population: int
    spread: float  # of the first generation
    until: float
    precision: str = "float64"
    name = "searching"

    def begin(self, vector: np.ndarray) -> Evolving:
        """A cloud around a vector (n,)."""
        return Evolving(cma.begin(vector, self.spread), np.zeros(vector.size))

    def advance(self, place: Place, trials: Trials) -> Outcome:
        """One generation."""
        cloud, total = place.inner
        points = cma.ask(cloud, self.population, np.random.default_rng((self.seed, place.stage, place.step)))
        inside = np.clip(points, trials.low, trials.high)
        beyond = 1.0 + 0.1 * np.sum((points - inside) ** 2, axis=1)
        values = trials.values(inside, self.samples, place.draw, self.precision) * beyond
        cloud = cma.tell(cloud, points, values)
        total = cloud.mean + (total if place.step % CHECK else 0.0)
        place = place._replace(step=place.step + 1, draw=place.draw + 1, inner=Evolving(cloud, total))
        return Outcome(place, float(np.min(values)))

    def due(self, place: Place) -> bool:
        """True if ``CHECK`` generations have passed since the last check."""
        return place.step % CHECK == 0

    def offer(self, place: Place) -> np.ndarray:
        """The mean, and the average of the means since the last check (2, n)."""
        cloud, total = place.inner
        return np.stack([cloud.mean, total / ((place.step - 1) % CHECK + 1)])

    def ended(self, place: Place, stale: int) -> bool:
        """True if the cloud has become small."""
        return _converged(place.inner.cloud)


def _converged(cloud: cma.Cloud) -> bool:
    return bool(cloud.spread * np.sqrt(np.max(np.diag(cloud.shape))) < _SMALL)


@dataclass(frozen=True)
class Descents:
    """A descent along exact gradients, every few steps on samples drawn anew."""

    chosen: LBFGS | Optax
    samples: int
    steps: int  # on the same samples
    patience: int
    until: float
    name = "searching"

    def begin(self, vector: np.ndarray) -> Candidate:
        """A candidate at a vector (n,)."""
        return Candidate(vector, self.chosen.start(vector))

    def advance(self, place: Place, trials: Trials) -> Outcome:
        """A few steps."""
        candidate, value, rejected = method.descend(
            trials, self.chosen, place.inner, self.samples, place.draw, self.steps
        )
        place = place._replace(step=place.step + 1, draw=place.draw + 1, inner=candidate)
        return Outcome(place, value, rejected)

    def due(self, place: Place) -> bool:
        """After every few steps."""
        return True

    def offer(self, place: Place) -> np.ndarray:
        """Present vector of the descent (1, n)."""
        return place.inner.vector[None]

    def ended(self, place: Place, stale: int) -> bool:
        """True if nothing has improved for a while."""
        return stale >= self.patience


class Plan(NamedTuple):
    """A search: a scan, a wide local search, then scans and narrow local searches by turns."""

    first: Stage  # scan
    wide: Stage
    scan: Stage
    narrow: Stage

    def stage(self, number: int) -> Stage:
        """The stage of a number from 0 on."""
        if number < 2:
            return self.wide if number else self.first
        return self.narrow if number % 2 else self.scan


def plan(problem: Problem) -> Plan:
    """The search that [tuning] asks for.

    Raises:
        UserError: an optimiser that does not exist.
    """
    settings, seed, space = problem.scenario.tuning, problem.scenario.simulation.seed, problem.space
    scan, coarse = Scan(seed, 2 * settings.samples, space.knots), settings.coarse
    first, name = replace(scan, precision=coarse), settings.optimiser
    if name == "auto":
        name = "cma" if space.size < MANY else "lbfgs"
    if name == "cma":
        wide = Generations(seed, settings.samples, settings.population, WIDE, HALF, coarse)
        narrow = Generations(seed, _narrow_samples(problem), settings.population, NARROW, 1.0)
        return Plan(first, wide, scan, narrow)
    chosen = method.method(name, settings.learning_rate, settings.decay, settings.clip, DECAY)
    wide = Descents(chosen, settings.samples, settings.steps, settings.patience, HALF)
    return Plan(first, wide, scan, replace(wide, until=1.0))


def _narrow_samples(problem: Problem) -> int:
    settings = problem.scenario.tuning
    generation = FINE * settings.samples * settings.population * steps_of(problem)
    return settings.samples * (FINE if HALF * 1e6 * settings.budget >= ROOM * generation else 1)
