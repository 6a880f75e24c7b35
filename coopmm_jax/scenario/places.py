"""Places in a scenario by dotted name: ``plant.m_p``, ``reference.path.a``, ``disturbance.gust.scale``.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> find(load_scenario("paper"), ("plant", "m_p")).value
5.0
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from pydantic import BaseModel

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.overrides import entry_of
from coopmm_jax.scenario.validation import closest


class Place(NamedTuple):
    """A field of a section that is there."""

    owner: BaseModel
    field: str
    value: Any


def find(scenario: BaseModel, path: Sequence[str], field: str = "") -> Place:
    """Place that a path of names leads to.

    Args:
        scenario: with the sections.
        path: a section, those in it, and a field. In a list of sections, an entry's name or number, or, if it is
            neither, a field of the first entry.
        field: what the user knows the path as, for the error.

    Raises:
        UserError: a name that leads nowhere.
    """
    node, walked = scenario, []
    for name in path[:-1]:
        node = _child(node, name, walked, field)
        walked.append(name)
    if isinstance(node, tuple):
        node = _first(node, path[-1], walked, field)
    return Place(node, path[-1], _child(node, path[-1], walked, field))


def _child(node: Any, name: str, walked: list[str], field: str) -> Any:
    if isinstance(node, tuple):
        entry = entry_of(_names(node), name)
        if entry is not None and isinstance(node[entry], BaseModel):
            return node[entry]
        node = _first(node, name, walked, field)
    fields = type(node).model_fields if isinstance(node, BaseModel) else {}
    if name not in fields:
        where, place = field or ".".join((*walked, name)), ".".join(walked)
        raise UserError(where, f"a field of [{place}]{closest(name, fields)}", "unknown")
    return getattr(node, name)


def _first(entries: tuple[Any, ...], name: str, walked: list[str], field: str) -> Any:
    if entries and not isinstance(entries[0], BaseModel):
        place = ".".join(walked)
        raise UserError(field or f"{place}.{name}", f"{place}, or one of its numbers as {place}.1", "unknown")
    if not entries:
        raise UserError(field or ".".join((*walked, name)), f"in an entry of [[{'.'.join(walked)}]]", "unknown")
    return entries[0]


def _names(entries: tuple[Any, ...]) -> list[Any]:
    return [getattr(entry, "name", None) for entry in entries]


def replaced(node: Any, changes: Mapping[str, Any]) -> Any:
    """Copy of a scenario, or of a part of it, with unchecked values, arrays among them, at dotted names that exist."""
    if isinstance(node, tuple):
        by_entry: dict[int, dict[str, Any]] = {}
        for name, value in changes.items():
            first, _, rest = name.partition(".")
            entry = entry_of(_names(node), first) if rest else None
            by_entry.setdefault(entry or 0, {})[name if entry is None else rest] = value
        return tuple(replaced(entry, by_entry[i]) if i in by_entry else entry for i, entry in enumerate(node))
    own: dict[str, Any] = {}
    deeper: dict[str, dict[str, Any]] = {}
    for name, value in changes.items():
        first, _, rest = name.partition(".")
        if rest:
            deeper.setdefault(first, {})[rest] = value
        else:
            own[first] = tuple(value) if isinstance(value, list) else value
    inner = {name: replaced(getattr(node, name), parts) for name, parts in deeper.items()}
    return node.model_copy(update=own | inner)


def names(node: BaseModel, path: str = "") -> Iterator[str]:
    """Dotted names of all fields of a scenario, or of a section at a path; a list's first entry goes without number.

    >>> from coopmm_jax.scenario.scenario import load_scenario
    >>> "disturbance.frequency" in names(load_scenario("paper"))
    True
    """
    for field, value in node:
        place = f"{path}.{field}" if path else field
        entries = value if isinstance(value, tuple) else (value,)
        if not all(isinstance(entry, BaseModel) for entry in entries):
            yield place
            continue
        for number, entry in enumerate(entries, 1):
            yield from names(entry, place if number == 1 else f"{place}.{number}")
