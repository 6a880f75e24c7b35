"""Fields that stand in the place of others, which nothing reads beside them.

A scenario that gives one drops what its base gives of the others; what is given beside it is refused, as it would have
no effect. The others keep their defaults, so that a scenario with every value spelt out is one as well.

>>> from coopmm_jax.scenario.base import BaseScenario
>>> unread(BaseScenario().with_overrides({"reference.path.kind": "circle"}))["reference.radius"]
'left out where reference.path is given'
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from pydantic import BaseModel

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import controller

_STEERING = "k4"  # gain of shipped controllers on two axles


class _Rule(NamedTuple):
    """Fields that replace others where all of them are given."""

    given: tuple[tuple[str, str], ...]  # section and field
    replaced: dict[str, str]  # dotted name -> what it must be


def _rule(given: str, **replaced: str) -> _Rule:
    """Rule from dotted names, and names of the replaced fields by their section."""
    must = f"left out where {' and '.join(given.split())} {'are' if ' ' in given else 'is'} given"
    places = (f"{section}.{name}" for section, names in replaced.items() for name in names.split())
    return _Rule(tuple(_split(place) for place in given.split()), dict.fromkeys(places, must))


def _split(place: str) -> tuple[str, str]:
    section, _, name = place.partition(".")
    return section, name


_RULES = (
    _rule("arm.l_links", plant="l2 l3 m2 m3 I2 I3", nominal="m2 m3 I2 I3"),
    _rule("arm.l_links initial.pitch", initial="a2 a3"),
    _rule("arm.lift initial.pitch", initial="a2 a3"),
    _rule("reference.path", reference="rate radius arm_centre arm_swing arm_rate", coupling="guide_radius"),
    _rule("reference.force", reference="contact_force"),
    _rule("reference.height", coupling="guide_height"),
    _rule("coupling.surface", coupling="contact_radius"),
)
_FRONT = dict.fromkeys(("nominal.m_f", "nominal.I_f", "nominal.I_wf"), "left out of differential drives")


def affected(changed: Collection[str]) -> set[str]:
    """Sections in which changes of these sections can replace fields, and themselves."""
    found = set(changed)
    for rule in _RULES:
        given = {section for section, _ in rule.given}
        if not given.isdisjoint(changed):
            found |= given | {_split(place)[0] for place in rule.replaced}
    return found


def without_replaced(base: Mapping[str, Any], tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Tables of a base scenario without the fields that changes replace.

    What a file gives beside a field that replaces it stays, for ``check_read`` to refuse.

    Args:
        base: tables of sections.
        tables: the same with changes laid over them.
    """
    for rule in _RULES:
        if _applies(rule, tables) and not _applies(rule, base):
            for place in rule.replaced:
                base = _without(base, *_split(place))
    return base


def unread(scenario: BaseModel) -> dict[str, str]:
    """Fields that nothing reads in a scenario, by dotted name, each with what it must be.

    Args:
        scenario: with all its sections.
    """
    found: dict[str, str] = {}
    for rule in _RULES:
        if all(_in_force(getattr(getattr(scenario, section), name)) for section, name in rule.given):
            found |= rule.replaced
    return found | _FRONT if _drives_alone(scenario) else found


def check_read(scenario: BaseModel) -> None:
    """Check that whatever differs from its default is read.

    Args:
        scenario: with all its sections.

    Raises:
        UserError: a field without effect.
    """
    for place, must in unread(scenario).items():
        section, name = _split(place)
        owner = getattr(scenario, section)
        default, value = type(owner).model_fields[name].default, getattr(owner, name)
        if value not in (default, (default, default)):
            raise UserError(place, must, value)
    if _drives_alone(scenario):
        _check_tuned(scenario)


def _check_tuned(scenario: Any) -> None:
    """Check that no gain of two axles is tuned; it may be given, as gains of other robots are tried on these."""
    if _STEERING in scenario.tuning.gains and controller(scenario.law.controller).plugin is None:
        must = f"without {_STEERING}, which differential drives do without"
        raise UserError("tuning.gains", must, list(scenario.tuning.gains))


def _drives_alone(scenario: Any) -> bool:
    return scenario.platform.kinds == ("differential", "differential")


def _applies(rule: _Rule, tables: Mapping[str, Any]) -> bool:
    return all(_in_force(_at(tables, *place)) for place in rule.given)


def _in_force(value: Any) -> bool:
    """True if a field replaces others: it is given, and for both robots."""
    entries = value if isinstance(value, list | tuple) else (value,)
    return not any(entry is None or entry is False or entry == "none" for entry in entries)


def _at(tables: Mapping[str, Any], section: str, name: str) -> Any:
    table = tables.get(section)
    return table.get(name) if isinstance(table, Mapping) else None


def _without(tables: Mapping[str, Any], section: str, name: str) -> Mapping[str, Any]:
    """Tables without a field, copied where they differ."""
    if _at(tables, section, name) is None:
        return tables
    return {**tables, section: {key: value for key, value in tables[section].items() if key != name}}
