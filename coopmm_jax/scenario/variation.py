"""Plausible robots: the numbers that vary from sample to sample of a scenario, and the parameters of any sample.

A sample is a point of the unit cube with one coordinate per draw; every varying number is a quantile of its
distribution there. Points come from ``scenario/sampling.py``, or from a search through the cube: the map works on
numpy and, differentiably, on JAX arrays. The controller's model stays the scenario's: it does not know the plant that
was drawn.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> mass = {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}
>>> variation = vary(load_scenario("paper", uncertainty={"plant.m_p": mass}))
>>> float(variation.values(np.array([0.75]))["plant.m_p"])
5.5
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import MASS_NAMES, FrontInertia, Inertia, LinkInertia, Parameters, PathReference, Structure
from coopmm_jax.scenario import places
from coopmm_jax.scenario.base import BaseScenario
from coopmm_jax.scenario.quantile import quantile
from coopmm_jax.scenario.replaced import unread
from coopmm_jax.scenario.varying import Number, current, numbers_of, pair

Varied = TypeVar("Varied", bound=BaseScenario)
# The ends of what can be drawn: no sampler comes closer to 0 and 1.
LOWEST, HIGHEST = 2.0**-54, 1.0 - 2.0**-53
_INSIDE = 0.6180339887498949  # a point of no symmetry


@dataclass(frozen=True)
class Variation(Generic[Varied]):
    """Everything that varies in a scenario; make one with ``vary``."""

    scenario: Varied
    numbers: tuple[Number, ...]

    @property
    def draws(self) -> tuple[str, ...]:
        """Names of the random numbers: the coordinates of the unit cube (D,)."""
        return tuple(dict.fromkeys(number.draw for number in self.numbers))

    def values(self, points: Any) -> dict[str, Any]:
        """Varying numbers by name, in the scenario's units.

        Args:
            points: numpy or JAX array (..., D) in the open unit cube.

        Returns:
            Arrays of shape (...).
        """
        column = {draw: i for i, draw in enumerate(self.draws)}
        return {number.name: _value(number, points[..., column[number.draw]]) for number in self.numbers}

    def parameters(self, points: Any) -> Parameters:
        """Parameters of the samples at ``points`` (..., D): what varies has shape (...), the rest is Python floats."""
        values = self.values(points)
        return self._with(values).parameters()._replace(nominal=self._nominal(values))

    def structure(self) -> Structure:
        """Static choices of the scenario, with every effect in force whose numbers vary."""
        return self.scenario.structure({number.place for number in self.numbers})

    def batch(self, points: np.ndarray, indices: Sequence[int]) -> Parameters:
        """Parameters of the samples ``indices`` (B,) at ``points`` (B, D), as ``batched``.

        Each sample has its own stream of measurement noise.
        """
        parameters = self.parameters(points)
        hardware = parameters.hardware._replace(noise_stream=np.array(indices, dtype=float))
        return batched(parameters._replace(hardware=hardware), len(indices))

    def sample(self, index: int, values: dict[str, float]) -> Varied:
        """Scenario of one sample, complete and certain, from its index and its numbers (scalars) by name.

        Its masses and inertias of the controller's model are spelt out, so that they stay what they were.
        """
        nominal = self._nominal(values)
        idle = unread(self.scenario)
        read = [name for name in MASS_NAMES if f"nominal.{name}" not in idle]
        spelt_out: dict[str, Any] = {name: [getattr(robot, name) for robot in nominal] for name in read}
        spelt_out |= _front_masses(nominal) | _link_masses(nominal)
        spelt_out["m_obj"] = nominal[1].m_obj
        changes = self._tables(values) | {f"nominal.{name}": value for name, value in spelt_out.items()}
        certain = self.scenario.model_copy(update={"uncertainty": type(self.scenario.uncertainty)()})
        return certain.with_overrides(changes | {"simulation.stream": index})

    def _tables(self, values: dict[str, Any]) -> dict[str, Any]:
        """Dotted fields to their new values: numbers of single robots as pairs, of lists as whole lists."""
        changes: dict[str, Any] = {}
        for number in self.numbers:
            if number.part is None:
                changes[number.place] = values[number.name]
            else:
                parts = changes.setdefault(number.place, list(pair(current(self.scenario, number.place)[1])))
                if isinstance(number.part, tuple):
                    robot, link = number.part
                    parts[robot] = (*parts[robot][:link], values[number.name], *parts[robot][link + 1 :])
                else:
                    parts[number.part] = values[number.name]
        return changes

    def _nominal(self, values: dict[str, Any]) -> tuple[Inertia, Inertia]:
        """Masses and inertias that the controller believes in: of its own numbers, but not of the plant's."""
        kept = {name: getattr(self.scenario, name) for name in ("plant", "platform", "arm")}
        return self._with(values).model_copy(update=kept).nominal_model()

    def _with(self, values: dict[str, Any]) -> Varied:
        """Scenario with unchecked values, arrays among them."""
        return places.replaced(self.scenario, self._tables(values))


def _front_masses(nominal: tuple[Inertia, Inertia]) -> dict[str, Any]:
    """Masses of the front axles by name, for both robots if one of them has two axles."""
    fronts = [robot.front for robot in nominal if robot.front is not None]
    if not fronts:
        return {}
    each = [robot.front or fronts[0] for robot in nominal]
    return {name: [getattr(front, name) for front in each] for name in FrontInertia._fields}


def _link_masses(nominal: tuple[Inertia, Inertia]) -> dict[str, Any]:
    """Masses of the links of [arm] by name, for both robots if one of them has such an arm."""
    if all(robot.links is None for robot in nominal):
        return {}
    each = [robot.links or LinkInertia((robot.m2, robot.m3), (robot.I2, robot.I3)) for robot in nominal]
    return {name: [list(getattr(links, name)) for links in each] for name in LinkInertia._fields}


def batched(parameters: Parameters, count: int) -> Parameters:
    """Parameters for ``jax.vmap`` over a batch: every leaf of shape (B,), with B = ``count``.

    Numbers of a reference along a path that do not vary have shape (): it is then computed once for all.

    >>> batched(Parameters(), 3).plant.gravity.shape
    (3,)
    """
    import jax

    many = jax.tree.map(lambda x: np.broadcast_to(np.asarray(x), count), parameters)
    if not isinstance(parameters.reference, PathReference):
        return many
    return many._replace(reference=jax.tree.map(np.asarray, parameters.reference))


def vary(scenario: Varied) -> Variation[Varied]:
    """Variation of a scenario, from its [uncertainty]; every ``Scenario`` has been through ``check``.

    Raises:
        UserError: a field that does not exist or cannot vary, or a number that varies twice.
    """
    idle, entries = unread(scenario), scenario.uncertainty.entries()
    for entry in entries:
        if entry.place in idle:
            raise UserError(f"uncertainty.{entry.name}", idle[entry.place], "given")
    given = [(entry, number) for entry in entries for number in numbers_of(scenario, entry)]
    seen: dict[str, str] = {}
    for entry, number in given:
        both = {number.name, number.place} | (
            {f"{number.name}.1", f"{number.name}.2"} if number.part is None else set()
        )
        for name in sorted(seen.keys() & both):
            twice = f"given twice, by {seen[name]} and {entry.name}"
            raise UserError(f"uncertainty.{number.name}", "given once", twice)
        seen[number.name] = entry.name
    return Variation(scenario, tuple(number for _, number in given))


def check(variation: Variation) -> None:
    """Check that the scenario can have all the values that its numbers reach, each of which changes something.

    Raises:
        UserError: a distribution that reaches values which the field cannot have, or that has no effect.
    """
    with np.errstate(all="ignore"):  # what overflows is refused as not finite
        for end in (LOWEST, HIGHEST):
            _check_end(variation, end)
        _check_effects(variation)


def _check_end(variation: Variation, end: float) -> None:
    """Check that every number alone is possible at its smallest or its largest."""
    for number in variation.numbers:
        alone = Variation(variation.scenario, (number,))
        values = {name: float(value) for name, value in alone.values(np.array([end])).items()}
        try:
            alone.sample(0, values)
        except UserError as error:
            own = error.field == number.place
            must = error.must if own else f"such that {error.field} is {error.must}"
            raise UserError(f"uncertainty.{number.name}", must, error.was) from None


def _check_effects(variation: Variation) -> None:
    """Check that every number alone changes something."""
    nominal = variation.scenario.parameters()
    for number in variation.numbers:
        if Variation(variation.scenario, (number,)).parameters(np.array([_INSIDE])) == nominal:
            must = "a number that changes the simulation (a factor on 0 does not: use offset)"
            raise UserError(f"uncertainty.{number.name}", must, number.base)


def _value(number: Number, u: Any) -> Any:
    """Number where the cube's coordinate is u."""
    drawn = quantile(number.distribution, u)
    if number.distribution.relative:
        return number.base * drawn
    return number.base + drawn if number.distribution.offset else drawn
