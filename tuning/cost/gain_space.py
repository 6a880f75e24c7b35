"""Gains as an unconstrained vector: logarithmic inside their bounds, never outside them.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> space = gain_space(load_scenario("paper", tuning={"channels": "shared"}))
>>> [round(float(g), 3) for g in space.gains(space.start).K_lambda]
[0.3, 0.3, 0.3, 0.3]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import gains_of, initial
from coopmm_jax.kinds.paths import ROUND, span
from coopmm_jax.parameters import Parameters, PhaseSchedule, Schedule
from coopmm_jax.scenario.feasible import check_phase
from coopmm_jax.scenario.sections.controller import gain_tables
from coopmm_jax.scenario.sections.schedule import schedule_table

if TYPE_CHECKING:
    from coopmm_jax.scenario.scenario import Scenario


@dataclass(frozen=True)
class GainSpace:
    """The n numbers that are tuned and what they stand for; hashable.

    A number x stands for the gain exp(x) - offset: one unit of x is a factor of e. The offset is 1 for K_lambda, which
    only has to exceed -1, and 0 for positive gains. Gains that change over time or along the path have every number
    once for each of K knots: first all numbers of the first knot, then all of the second, and so on.
    """

    bases: tuple[Any, ...]  # the starting gains of a controller, at every knot (K,)
    names: tuple[str, ...]  # of the tuned gains
    owner: tuple[int, ...]  # (n,) position in ``names`` of the gain that a number belongs to
    low: tuple[float, ...]  # (n,) log(bound + offset)
    high: tuple[float, ...]  # (n,)
    shared: bool
    controller: type  # of ``bases``: gains of equal numbers compare equal
    places: tuple[float, ...] = ()  # of the knots (K,): times [s] or phases; empty for constant gains
    over: type = Schedule  # or ``PhaseSchedule``
    kept: tuple[str, ...] = ()  # gains that change and are not tuned

    @property
    def size(self) -> int:
        """n."""
        return len(self.owner)

    @property
    def knots(self) -> int:
        """K."""
        return len(self.bases)

    @property
    def start(self) -> np.ndarray:
        """The vector of the starting gains (n,)."""
        values = np.array([value for base in self.bases for name in self.names for value in self._entries(base, name)])
        return np.log(values + self._offsets())

    @property
    def moves(self) -> np.ndarray:
        """Directions (G, n) along which each of the G = n / K gains changes alone, at all knots."""
        return np.tile(np.eye(self.size // self.knots), self.knots)

    def inside(self, vectors: np.ndarray) -> np.ndarray:
        """The nearest vectors (..., n) between the bounds."""
        return np.clip(vectors, self.low, self.high)

    def values(self, vector: Any) -> Any:
        """The gains that n numbers stand for (n,), in their own units; differentiable."""
        return jnp.exp(vector) - self._offsets()

    def gains(self, vector: Any) -> Any:
        """All gains, at the first knot, with the tuned ones from ``vector`` (n,)."""
        return self._at_knots(vector)[0]

    def schedule(self, vector: Any) -> Schedule | PhaseSchedule | None:
        """The gains that change; None where all are constant."""
        if not self.places:
            return None
        at_knots = self._at_knots(vector)
        values = {name: tuple(getattr(gains, name) for gains in at_knots) for name in (*self.names, *self.kept)}
        return self.over(self.places, values)

    def applied(self, parameters: Parameters, vector: Any) -> Parameters:
        """Parameters with the gains of ``vector`` (n,)."""
        return parameters._replace(gains=self.gains(vector), schedule=self.schedule(vector))

    def tables(self, vector: Any) -> dict[str, Any]:
        """Tables of a scenario file with the tuned gains of ``vector`` (n,)."""
        tables = gain_tables(self.gains(vector), self.names)
        return tables | ({"schedule": schedule_table(self.schedule(vector))} if self.places else {})

    def _at_knots(self, vector: Any) -> list[Any]:
        values, each = self.values(vector), self.size // self.knots
        return [self._gains(base, values[k * each : (k + 1) * each]) for k, base in enumerate(self.bases)]

    def _gains(self, base: Any, values: Any) -> Any:
        """All gains at one knot, from their values there (n / K,)."""
        changed = {}
        for i, name in enumerate(self.names):
            entries = [values[k] for k in range(self.size // self.knots) if self.owner[k] == i]
            before = getattr(base, name)
            if isinstance(before, tuple):
                changed[name] = tuple(entries * len(before) if self.shared else entries)
            else:
                changed[name] = entries[0]
        return base._replace(**changed)

    def spread(self, fractions: np.ndarray) -> np.ndarray:
        """Vectors (..., n) whose gains lie at ``fractions`` (..., names) of their logarithmic ranges.

        Entries of one gain are alike: with one coordinate per gain, few points cover the space well.
        """
        low, high = np.array(self.low), np.array(self.high)
        return low + (high - low) * fractions[..., list(self.owner)]

    def starts(self, count: int, seed: int) -> np.ndarray:
        """Vectors to begin a search at (count, n): the starting gains, then scrambled Sobol points."""
        engine = qmc.Sobol(len(self.names), scramble=True, rng=seed)
        points = engine.random_base2(max(0, (count - 1).bit_length()))[:count]
        return np.concatenate([self.start[None], self.spread(points)[1:]])

    def labels(self) -> list[str]:
        """Name of each number (n,), as K_I[2], or K_I[2]@t=2.5 or K_I[2]@p=2.5 at a knot."""
        labels, axis = self.entry_labels(), "t" if self.over is Schedule else "p"
        return [f"{label}@{axis}={place:g}" for place in self.places for label in labels] if self.places else labels

    def entry_labels(self) -> list[str]:
        """Name of each gain, over all its knots (n / K,)."""
        owner = self.owner[: self.size // self.knots]
        counts = [owner.count(i) for i in owner]
        index = [k - owner.index(i) for k, i in enumerate(owner)]
        return [self.names[i] + (f"[{j}]" if c > 1 else "") for i, j, c in zip(owner, index, counts, strict=True)]

    def _entries(self, base: Any, name: str) -> tuple[float, ...]:
        value = getattr(base, name)
        if not isinstance(value, tuple):
            return (value,)
        return value[:1] if self.shared else value

    def _offsets(self) -> np.ndarray:
        about = gains_of(self.controller)
        return np.array([about[self.names[i]].offset for i in self.owner])


def gain_space(scenario: Scenario) -> GainSpace:
    """The numbers that the scenario's [tuning] wants tuned.

    Raises:
        UserError: a bound that excludes the starting gain, different entries to be tuned as one, knots other than
            those of the scenario's own schedule, or a reference whose phase stands still under knots over it.
    """
    settings, (places, over, bases, kept) = scenario.tuning, _knots(scenario)
    offsets = {name: about.offset for name, about in gains_of(bases[0]).items()}
    shared = settings.channels == "shared"
    owner, low, high = [], [], []
    for i, name in enumerate(settings.gains):
        bounds, entries = getattr(settings.bounds, name), _as_tuple(getattr(bases[0], name))
        for base in bases:
            _check_start(name, _as_tuple(getattr(base, name)), bounds, shared)
        for _ in entries[:1] if shared else entries:
            owner.append(i)
            low.append(float(np.log(bounds[0] + offsets[name])))
            high.append(float(np.log(bounds[1] + offsets[name])))
    count = len(bases)
    bounds = (tuple(low * count), tuple(high * count))
    return GainSpace(bases, settings.gains, tuple(owner * count), *bounds, shared, type(bases[0]), places, over, kept)


def _as_tuple(value: Any) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


def _check_start(name: str, entries: tuple[float, ...], bounds: tuple[float, float], shared: bool) -> None:
    if shared and len(set(entries)) > 1:
        raise UserError(f"gains.{name}", "one number where tuning.channels is shared", list(entries))
    for entry in entries:
        if not bounds[0] <= entry <= bounds[1]:
            must = f"bounds between which the starting gain {entry:g} lies"
            raise UserError(f"tuning.bounds.{name}", must, list(bounds))


class _Knots(NamedTuple):
    """Knots of the tuned gains."""

    places: tuple[float, ...] = ()
    over: type = Schedule
    bases: tuple[Any, ...] = ()  # the scenario's gains at each of them
    kept: tuple[str, ...] = ()  # gains that change without being tuned


def _knots(scenario: Scenario) -> _Knots:
    parameters, count = scenario.parameters(), scenario.tuning.schedule
    gains, own = parameters.gains, parameters.schedule
    if own is None and count == 1:
        return _Knots(bases=(gains,))
    for name in initial(gains):
        if name in scenario.tuning.gains:
            raise UserError("tuning.gains", f"without {name}, which acts at the start alone, where gains change", name)
    if own is None:
        places, over = _spread_out(scenario, count)
        return _Knots(places, over, (gains,) * count)
    places, at_knots = own
    if count not in (1, len(places)):
        raise UserError("tuning.schedule", f"left out, or {len(places)} as the scenario's [schedule] has", count)
    if scenario.tuning.schedule_over == "phase" and isinstance(own, Schedule):
        raise UserError("tuning.schedule_over", "time where the scenario has schedule.times", "phase")
    values = [{name: knots[k] for name, knots in at_knots.items()} for k in range(len(places))]
    kept = tuple(name for name in at_knots if name not in scenario.tuning.gains)
    return _Knots(tuple(map(float, places)), type(own), tuple(gains._replace(**at) for at in values), kept)


def _spread_out(scenario: Scenario, count: int) -> tuple[tuple[float, ...], type]:
    """Places of so many knots over the duration, or once round or along the path; and the class of their schedule."""
    if scenario.tuning.schedule_over == "time":
        return tuple(np.linspace(0.0, scenario.simulation.duration, count).tolist()), Schedule
    check_phase(scenario, "tuning.schedule_over")
    path = scenario.reference.path
    ends = ROUND if path is None else span(path.numbers())
    return tuple(np.linspace(*ends, count, endpoint=ends is not ROUND).tolist()), PhaseSchedule
