"""Help on the fields of a scenario that an override can name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from coopmm_jax.errors import UserError
from coopmm_jax.scenario import catalogue, places
from coopmm_jax.scenario.catalogue import NOT_GIVEN, Entry
from coopmm_jax.scenario.scenario import Scenario

OVERRIDES = "[--section.field VALUE ...]"


def fields_help() -> str:
    """Text that lists every field with its default, meaning and unit."""
    lines = ["overrides, after SCENARIO (values are TOML; several values make a list, one number fills a list):"]
    told: dict[str, str] = {}
    for name, title in catalogue.sections().items():
        lines += ["", title, *(told_of(entry) for entry in catalogue.entries(name, told))]
    return "\n".join(lines)


def section_help(name: str, label: str = "", scenario: Scenario | None = None) -> Iterator[str]:
    """Lines on one section's fields.

    Args:
        name: of the section.
        label: of the scenario, before its own values.
        scenario: whose values are told where they are not the defaults.
    """
    yield catalogue.sections()[name]
    kind = ""
    for entry in catalogue.entries(name):
        kind = entry.kind if entry.heading else kind
        if name == "gains" and scenario is not None and kind != scenario.law.controller:
            continue
        own = NOT_GIVEN if scenario is None else _own(scenario, entry)
        yield told_of(entry, label, own)


def told_of(entry: Entry, label: str = "", own: Any = NOT_GIVEN) -> str:
    """Line on a field, or heading above a kind's.

    Args:
        entry: the field.
        label: of a scenario.
        own: value that the scenario has there.
    """
    if entry.heading:
        return f"  {entry.text}" if entry.place == "gains" else f"  {entry.kind}: {entry.text}"
    meaning = entry.text + (": " if entry.choices else "") + " or ".join(entry.choices)
    alike = isinstance(entry.default, tuple) and entry.default == (own,) * len(entry.default)
    values = [] if own is NOT_GIVEN or own == entry.default or alike else [f"{label}: {shown(own, entry.place)}"]
    values += [] if entry.default is NOT_GIVEN else [f"default {shown(entry.default, entry.place)}"]
    told = f" ({', '.join(values)})" if values else ""
    more = f", with the fields of {option(entry.as_well)}" if entry.as_well else ""
    return f"  {option(entry.place):28} {meaning}{told}{more}"


def option(place: str) -> str:
    """Override of a field.

    >>> option("gains.K_I")
    '--gains.K-I'
    """
    return f"--{place.replace('_', '-')}"


def takes_names(key: str) -> bool:
    """True if the field of a dotted key takes a list of names.

    >>> takes_names("tuning.gains"), takes_names("platform.kind"), takes_names("law.u26")
    (True, True, False)
    """
    section, _, field = key.partition(".")
    known = Scenario.model_fields.get(section)
    fields = getattr(known.annotation if known else None, "model_fields", {})
    return field in fields and _lists_names(fields[field].annotation)


def _lists_names(kind: Any) -> bool:
    """True for the type of a list of names, or of a choice for each robot, also where it can be something else."""
    if get_origin(kind) is tuple:
        of_entry = get_args(kind)[0]
        return of_entry is str or get_origin(of_entry) is Literal
    return any(map(_lists_names, get_args(kind)))


def shown(value: Any, place: str) -> str:
    """Value of a field for a reader.

    >>> shown((1.0, 0.5), "plant.m_p"), shown(None, "nominal.m_p")
    ('1 0.5', "the plant's")
    """
    if isinstance(value, tuple):
        return " ".join(shown(entry, place) for entry in value)
    if value is None:
        return "the plant's" if place.startswith("nominal.") else "none"
    if place == "tuning.scales" and not any(number for _, number in value):
        return "the terms' means under the starting gains"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _own(scenario: Scenario, entry: Entry) -> Any:
    """Value of a field in a scenario, if it has the kind that the field belongs to."""
    path = entry.place.rpartition(".")[0]
    try:
        if entry.kind and path != "gains" and places.find(scenario, (*path.split("."), "kind")).value != entry.kind:
            return NOT_GIVEN
        return places.find(scenario, entry.place.split(".")).value
    except UserError:  # of a section that is left out
        return NOT_GIVEN
