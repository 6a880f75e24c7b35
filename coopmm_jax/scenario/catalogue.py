"""Every field that a scenario can have: its name, meaning, unit and default, section by section.

Help, the page of reference, shell completion and commented scenario files are made of this.

>>> next(entry for entry in entries("plant") if entry.place == "plant.m_p").default
5.0
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Literal, NamedTuple, get_args, get_origin

from coopmm_jax.kinds import protocol, registry
from coopmm_jax.scenario.kind_sections import Chosen, choice_of, section
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.sections.controller import GainsSection, all_controllers, gains_section

NOT_GIVEN: Any = protocol.MISSING  # default of a field that has to be given
_UNIT = re.compile(r"(?P<meaning>.*) \[(?P<unit>[^][]*)\]")


class Entry(NamedTuple):
    """A field, or the heading above those of one kind."""

    place: str  # dotted name
    text: str  # its meaning, with the unit in brackets at the end; a heading's is the kind's description
    default: Any = NOT_GIVEN
    choices: tuple[str, ...] = ()
    kind: str = ""  # name of the kind that has the field; "" for fields of the whole section
    heading: bool = False
    as_well: str = ""  # place of a field with the same kinds, where their fields are told

    @property
    def meaning(self) -> str:
        """Meaning without the unit."""
        match = _UNIT.fullmatch(self.text)
        return match["meaning"] if match else self.text

    @property
    def unit(self) -> str:
        """Unit, or nothing, as in meaning [unit]."""
        match = _UNIT.fullmatch(self.text)
        return match["unit"] if match else ""


def sections() -> dict[str, str]:
    """Sections of a scenario by name, each with a line on what it is about."""
    return {name: _title(name, info) for name, info in Scenario.model_fields.items() if _has_fields(info)}


def entries(name: str, told: dict[str, str] | None = None) -> Iterator[Entry]:
    """Fields of a section, in the order of its class.

    Args:
        name: of the section.
        told: kinds whose fields stand in an earlier section, as group -> place; it grows.
    """
    told = {} if told is None else told
    info = Scenario.model_fields[name]
    if info.annotation is GainsSection:
        yield from _of_controllers()
    elif choice := choice_of(info):
        yield from _of_kinds(name, info, choice, told)
    else:
        yield from _of_section(name, type(info.default), told)  # of the default controller, if there are several


def _has_fields(info: Any) -> bool:
    return hasattr(info.annotation, "model_fields") or choice_of(info) is not None


def _title(name: str, info: Any) -> str:
    choice = choice_of(info)
    described = choice.base if choice else info.annotation
    return described.__doc__ or f"[{name}]:"  # Python may leave docstrings out


def _of_section(path: str, described: Any, told: dict[str, str], *without: str, kind: str = "") -> Iterator[Entry]:
    for name, info in described.model_fields.items():
        place = f"{path}.{name}"
        if choice := choice_of(info):
            yield from _of_kinds(place, info, choice, told)
        elif name not in without:
            choices = get_args(info.annotation) if get_origin(info.annotation) is Literal else ()
            default = NOT_GIVEN if info.is_required() else info.default
            yield Entry(place, info.description or "", default, choices, kind)


def _of_controllers() -> Iterator[Entry]:
    """Gains of each controller, below a heading."""
    for name in all_controllers():
        described = gains_section(name)
        yield Entry("gains", described.__doc__ or "", kind=name, heading=True)
        yield from _of_section("gains", described, {}, kind=name)


def _of_kinds(path: str, info: Any, choice: Chosen, told: dict[str, str]) -> Iterator[Entry]:
    """Fields that all kinds of a group have, then those of each kind below a heading."""
    kinds = tuple(registry.known(choice.group))
    meaning = info.description or registry.GROUPS[choice.group].meaning
    first = Entry(f"{path}.kind", meaning, choice.default, kinds, as_well=told.get(choice.group, ""))
    yield first
    if first.as_well:
        return
    told[choice.group] = path
    yield from _of_section(path, choice.base, told, "kind")
    for name in kinds:
        described = section(choice.group, name, choice.base)
        text = " ".join((described.__doc__ or "").split())
        yield Entry(path, text, kind=name, heading=True)
        yield from _of_section(path, described, told, *choice.base.model_fields, kind=name)
