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

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from pydantic import BaseModel

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import MASS_NAMES, FrontInertia, Inertia, Parameters, PathReference, Structure
from coopmm_jax.scenario import places
from coopmm_jax.scenario.base import BaseScenario
from coopmm_jax.scenario.kind_sections import KindSection, is_pair, is_vector
from coopmm_jax.scenario.sections.uncertainty import Distribution, Entry
from coopmm_jax.scenario.validation import closest, validate

Varied = TypeVar("Varied", bound=BaseScenario)
MASSES = "masses"  # plant.masses stands for all masses and inertias of the plant
_EXCLUDED = (
    "simulation",
    "law",
    "gains",
    "schedule",
    "uncertainty",
    "requirements",
)  # settings and design, not the world
# The ends of what can be drawn: no sampler comes closer to 0 and 1.
LOWEST, HIGHEST = 2.0**-54, 1.0 - 2.0**-53
_INSIDE = 0.6180339887498949  # a point of no symmetry


class Number(NamedTuple):
    """One number of a scenario that varies."""

    place: str  # dotted name of its field
    part: int | None  # of a pair of robots or a list, from 0; None: a number alone, or the same for both robots
    base: float  # the scenario's value
    unit: str
    meaning: str
    distribution: Distribution
    draw: str  # name of the random number behind it; numbers of one draw vary together

    @property
    def name(self) -> str:
        """Dotted name, as the user writes it."""
        return self.place + ("" if self.part is None else f".{self.part + 1}")


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
        spelt_out: dict[str, Any] = {name: [getattr(robot, name) for robot in nominal] for name in MASS_NAMES}
        spelt_out |= _front_masses(nominal)
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
                parts = changes.setdefault(number.place, list(_pair(_current(self.scenario, number.place)[1])))
                parts[number.part] = values[number.name]
        return changes

    def _nominal(self, values: dict[str, Any]) -> tuple[Inertia, Inertia]:
        """Masses and inertias that the controller believes in: of its own numbers, but not of the plant's."""
        kept = {"plant": self.scenario.plant, "platform": self.scenario.platform}
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
    """Variation of a scenario, from its [uncertainty].

    Raises:
        UserError: a field that does not exist or cannot vary, a number that varies twice, or a distribution that
            reaches values which the field cannot have.
    """
    numbers = tuple(number for entry in scenario.uncertainty.entries() for number in _numbers(scenario, entry))
    seen: set[str] = set()
    for number in numbers:
        both = {number.name, number.place} | (
            {f"{number.name}.1", f"{number.name}.2"} if number.part is None else set()
        )
        if seen & both:
            raise UserError(f"uncertainty.{number.name}", "given once", "given twice")
        seen.add(number.name)
    variation = Variation(scenario, numbers)
    with np.errstate(all="ignore"):  # what overflows is refused as not finite
        for end in (LOWEST, HIGHEST):
            _check_end(variation, end)
        _check_effects(variation)
    return variation


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


def _numbers(scenario: BaseScenario, entry: Entry) -> list[Number]:
    """Numbers that one entry stands for."""
    if entry.place == f"plant.{MASSES}":
        if not entry.distribution.relative:
            raise UserError(f"uncertainty.{entry.name}.relative", f"true for {MASSES}", "false")
        fields = [name for name in MASS_NAMES if name != "m_obj" or entry.part != 0]
        return [number for field in fields for number in _of_field(scenario, entry, f"plant.{field}")]
    return _of_field(scenario, entry, entry.place)


def _of_field(scenario: BaseScenario, entry: Entry, place: str) -> list[Number]:
    owner, value = _current(scenario, place)
    kind, field, law = type(owner), place.rpartition(".")[2], entry.distribution
    count = _count(kind, field, value)
    if entry.part is not None and entry.part >= count and not (field == "m_obj" and entry.part in (0, 1)):
        must = f"{place}.1 to .{count}" if count else f"{place}, which has no list of two"
        raise UserError(f"uncertainty.{entry.name}", must, entry.name)
    alike = not isinstance(value, tuple) and not law.each and entry.part is None
    parts = [entry.part] if entry.part is not None else range(count)
    numbers = []
    for part in [None] if alike or not count else parts:
        base: Any = value if part is None else _pair(value)[part]
        about = Number(place, part, base, *_described(kind, field), law, draw="")
        numbers.append(about._replace(draw=about.name if law.each else law.group or entry.name))
    return numbers


def _current(scenario: BaseScenario, place: str) -> tuple[BaseModel, Any]:
    """Section of a field, and its value, a number or a pair; of the controller's model the plant's if it has none."""
    allowed = [name for name in type(scenario).model_fields if name not in (*_EXCLUDED, "description")]
    section, *path = place.split(".")
    if section not in allowed:
        raise UserError(f"uncertainty.{section}", f"one of {', '.join(allowed)}{closest(section, allowed)}", section)
    owner, field, value = places.find(scenario, (section, *path), f"uncertainty.{place}")
    if value is None and section == "nominal":
        plant = getattr(scenario.plant, field)
        scale = scenario.nominal.scale
        return owner, tuple(scale * x for x in plant) if isinstance(plant, tuple) else scale * plant
    entries = value if isinstance(value, tuple) else (value,)
    if not all(isinstance(x, float) for x in entries):
        raise UserError(f"uncertainty.{place}", "a field whose values are real numbers", _told(value))
    if isinstance(owner, KindSection) and owner.fixed(field):
        raise UserError(f"uncertainty.{place}", "a number that a rollout reads, not one that is read at load", place)
    return owner, value


def _told(value: Any) -> Any:
    """Value for a message: the name of a section's kind in its place."""
    return f"[{value.kind}]" if isinstance(value, KindSection) else value


def _count(kind: type[BaseModel], field: str, value: Any) -> int:
    """Numbers that a field takes: 2 where each robot has one, those of a list, else 0."""
    if issubclass(kind, KindSection) and field in kind.about().fields:
        type_ = kind.about().fields[field].type
        return 2 if is_pair(type_) else len(value) if is_vector(type_) else 0
    try:
        validate(kind, {field: _pair(value)})
    except UserError:
        return 0
    return 2


def _pair(value: Any) -> tuple[Any, Any]:
    return value if isinstance(value, tuple) else (value, value)


def _described(kind: type[BaseModel], field: str) -> tuple[str, str]:
    """Unit and meaning from the description of a field, "meaning [unit]"."""
    text = kind.model_fields[field].description or ""
    match = re.fullmatch(r"(.*) \[(.*)\]", text)
    return (match[2], match[1]) if match else ("-", text)


def _value(number: Number, u: Any) -> Any:
    """Number where the cube's coordinate is u."""
    drawn = _quantile(number.distribution, u)
    if number.distribution.relative:
        return number.base * drawn
    return number.base + drawn if number.distribution.offset else drawn


def _quantile(law: Distribution, u: Any) -> Any:
    low, high = law.bounds()
    if law.distribution == "uniform":
        return low + (high - low) * u
    if law.distribution == "log_uniform":
        return low * (high / low) ** u
    mean, std = law.moments()
    if law.distribution == "truncated_normal":
        from scipy.special import ndtr  # as below: few scenarios need what takes long to import

        below, above = (float(ndtr((x - mean) / std)) for x in (low, high))
        u = below + (above - below) * u
    return mean + std * _normal_quantile(u)


def _normal_quantile(u: Any) -> Any:
    if isinstance(u, np.ndarray | np.floating):
        from scipy.special import ndtri
    else:
        from jax.scipy.special import ndtri
    return ndtri(u)
