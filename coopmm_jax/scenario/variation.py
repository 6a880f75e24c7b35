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

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from pydantic import BaseModel

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import MASS_NAMES, FrontInertia, Inertia, LinkInertia, Parameters, PathReference, Structure
from coopmm_jax.scenario import places
from coopmm_jax.scenario.base import BaseScenario
from coopmm_jax.scenario.kind_sections import KindSection, is_pair, is_vector
from coopmm_jax.scenario.overrides import is_number
from coopmm_jax.scenario.replaced import unread
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
    part: int | tuple[int, int] | None  # of a pair or a list, or robot and link of lists, from 0; None: of no list
    base: float  # the scenario's value
    unit: str
    meaning: str
    distribution: Distribution
    draw: str  # name of the random number behind it; numbers of one draw vary together

    @property
    def name(self) -> str:
        """Dotted name, as the user writes it."""
        parts = self.part if isinstance(self.part, tuple) else () if self.part is None else (self.part,)
        return self.place + "".join(f".{part + 1}" for part in parts)


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
                parts = changes.setdefault(number.place, list(_pair(_current(self.scenario, number.place)[1])))
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
    """Variation of a scenario, from its [uncertainty].

    Raises:
        UserError: a field that does not exist or cannot vary, a number that varies twice, or a distribution that
            reaches values which the field cannot have.
    """
    idle, entries = unread(scenario), scenario.uncertainty.entries()
    for entry in entries:
        if entry.place in idle:
            raise UserError(f"uncertainty.{entry.name}", idle[entry.place], "given")
    numbers = tuple(number for entry in entries for number in _numbers(scenario, entry))
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
        of_lists = scenario.arm.l_links is not None  # links 2 and 3 of [plant] are then of no arm
        fields = [f"plant.{name}" for name in MASS_NAMES if name != "m_obj" or entry.part != 0]
        fields = [name for name in fields if not (of_lists and name[-1] in "23")]
        found = [number for field in fields for number in _of_field(scenario, entry, field)]
        lists = [f"arm.{name}" for name in LinkInertia._fields if of_lists]
        whole = entry._replace(part=None)
        of_robot = "" if entry.part is None else f".{entry.part + 1}"
        return found + [number for name in lists for number in _of_field(scenario, whole, name + of_robot)]
    return _of_field(scenario, entry, entry.place)


def _of_field(scenario: BaseScenario, entry: Entry, place: str) -> list[Number]:
    place, robot = _whose(place)
    owner, value = _current(scenario, place)
    if robot is not None or _nested(value):
        return _of_lists(entry, place, robot, owner, value)
    kind, field, law = type(owner), place.rpartition(".")[2], entry.distribution
    count = _count(owner, field, value)
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


def _whose(place: str) -> tuple[str, int | None]:
    """Place of a field with a list for each robot, and the robot, of the place of that robot's list."""
    field, _, last = place.rpartition(".")
    return (field, int(last) - 1) if is_number(last) else (place, None)


def _nested(value: Any) -> bool:
    return isinstance(value, tuple) and isinstance(value[0], tuple)


def _of_lists(entry: Entry, place: str, robot: int | None, owner: BaseModel, value: Any) -> list[Number]:
    """Numbers of a field that has a list for each robot, or of one of them, or of one link of it."""
    lists, law = value if _nested(value) else (), entry.distribution
    robot, link = (entry.part, None) if robot is None else (robot, entry.part)
    robots = range(len(lists)) if robot is None else [robot] if robot < len(lists) else []
    parts = [(i, k) for i in robots for k in range(len(lists[i])) if link in (None, k)]
    if not parts:
        each = (f"{place}.{i}.1 to .{i}.{len(links)}" for i, links in enumerate(lists, 1))
        must = " or ".join(each) or f"{place}.1 to .{len(value)}"
        raise UserError(f"uncertainty.{entry.name}", must, entry.name)
    found = [
        Number(place, (i, k), lists[i][k], *_described(type(owner), place.rpartition(".")[2]), law, "")
        for i, k in parts
    ]
    return [number._replace(draw=number.name if law.each else law.group or entry.name) for number in found]


def _current(scenario: BaseScenario, place: str) -> tuple[BaseModel, Any]:
    """Section of a field, and its value, a number or a pair; of the controller's model the plant's if it has none."""
    allowed = [name for name in type(scenario).model_fields if name not in (*_EXCLUDED, "description")]
    section, *path = place.split(".")
    if section not in allowed:
        raise UserError(f"uncertainty.{section}", f"one of {', '.join(allowed)}{closest(section, allowed)}", section)
    owner, field, value = places.find(scenario, (section, *path), f"uncertainty.{place}")
    if value is None and section == "nominal":
        plant = getattr(scenario.plant, field, None)
        if plant is None:  # of front axles and links, which are those of the plant's own sections
            raise UserError(f"uncertainty.{place}", f"given in [nominal], where {field} is to vary", "left out")
        scale = scenario.nominal.scale
        return owner, tuple(scale * x for x in plant) if isinstance(plant, tuple) else scale * plant
    entries: tuple = value if isinstance(value, tuple) else (value,)
    if _nested(value):
        entries = tuple(itertools.chain(*entries))
    if not all(isinstance(x, float) for x in entries):
        raise UserError(f"uncertainty.{place}", "a field whose values are real numbers", _told(value))
    if isinstance(owner, KindSection) and owner.fixed(field):
        raise UserError(f"uncertainty.{place}", "a number that a rollout reads, not one that is read at load", place)
    return owner, value


def _told(value: Any) -> Any:
    """Value for a message: the name of a section's kind in its place."""
    return f"[{value.kind}]" if isinstance(value, KindSection) else value


def _count(owner: BaseModel, field: str, value: Any) -> int:
    """Numbers that a field takes: 2 where each robot has one, those of a list, else 0."""
    kind = type(owner)
    if issubclass(kind, KindSection) and field in kind.about().fields:
        type_ = kind.about().fields[field].type
        return 2 if is_pair(type_) else len(value) if is_vector(type_) else 0
    if field in getattr(kind, "per_link", ()):
        return len(value)
    try:
        validate(kind, owner.model_dump(exclude_none=True) | {field: _pair(value)})
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
