"""Numbers of a scenario that vary: those that an entry of [uncertainty] stands for, each with its place and its value.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> mass = {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}
>>> scenario = load_scenario("paper", uncertainty={"plant.m_p.2": mass})
>>> [(number.name, number.base) for number in numbers_of(scenario, scenario.uncertainty.entries()[0])]
[('plant.m_p.2', 5.0)]
"""

from __future__ import annotations

import itertools
import re
from typing import Any, NamedTuple

from pydantic import BaseModel

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import MASS_NAMES, LinkInertia
from coopmm_jax.scenario import places
from coopmm_jax.scenario.base import BaseScenario
from coopmm_jax.scenario.kind_sections import KindSection, is_pair, is_vector
from coopmm_jax.scenario.overrides import is_number
from coopmm_jax.scenario.sections.uncertainty import Distribution, Entry
from coopmm_jax.scenario.validation import closest, validate

MASSES = "masses"  # plant.masses stands for all masses and inertias of the plant
# Settings and design, not the world.
_EXCLUDED = ("simulation", "law", "gains", "schedule", "uncertainty", "requirements")


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


def numbers_of(scenario: BaseScenario, entry: Entry) -> list[Number]:
    """Numbers that one entry stands for.

    Raises:
        UserError: a field that does not exist or cannot vary, or a number that it does not have.
    """
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
    owner, value = current(scenario, place)
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
        base: Any = value if part is None else pair(value)[part]
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


def current(scenario: BaseScenario, place: str) -> tuple[BaseModel, Any]:
    """Section of a field, and its value, a number or a list; of the controller's model the plant's if it has none.

    Raises:
        UserError: a field that does not exist or cannot vary.
    """
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
        validate(kind, owner.model_dump(exclude_none=True) | {field: pair(value)})
    except UserError:
        return 0
    return 2


def pair(value: Any) -> tuple[Any, ...]:
    """Numbers of both robots where one stands for both; a list (n,) as it is."""
    return value if isinstance(value, tuple) else (value, value)


def _described(kind: type[BaseModel], field: str) -> tuple[str, str]:
    """Unit and meaning from the description of a field, "meaning [unit]"."""
    text = kind.model_fields[field].description or ""
    match = re.fullmatch(r"(.*) \[(.*)\]", text)
    return (match[2], match[1]) if match else ("-", text)
