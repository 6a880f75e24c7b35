"""Errors of pydantic, in this package's one grammar: the field, what it must be, what it was.

>>> from coopmm_jax.scenario.sections.controller import gains_section
>>> validate(gains_section("robust_adaptive"), {"K_lambda": -2})
Traceback (most recent call last):
coopmm_jax.errors.UserError: K_lambda: must be greater than -1, was -2
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from coopmm_jax.errors import UserError, one_line

Model = TypeVar("Model", bound=BaseModel)

_MUST = {  # pydantic's type of error -> what the value must be
    "bool_type": "true or false",
    "dict_type": "a table of fields",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a string",
    "string_unicode": "readable text",
    "string_too_short": "a string that is not empty",
    "tuple_type": "a list",
    "finite_number": "finite",
    "greater_than": "greater than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
    "literal_error": "{expected}",
    "model_type": "a table of fields",
}
_TAGS = ("one", "list")  # of the alternatives in fields.Pair and its like
_LIKENED = 60  # characters of a name that may be a slip of the pen


def validate(model: type[Model], data: Mapping[str, Any]) -> Model:
    """Instance of ``model`` from ``data``.

    Raises:
        UserError: the first thing wrong with ``data``, with the names of the other fields that are wrong.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first, *others = (_user_error(model, details) for details in error.errors(include_url=False))
    named = (*first.more, *(other.field for other in others))
    more = dict.fromkeys(name for name in named if not f"{first.field}.".startswith(f"{name}."))
    raise UserError(first.field, first.must, first.was, list(more))


def closest(name: str, known: Iterable[str]) -> str:
    """Parenthesis with the known name most like ``name``, or nothing.

    >>> closest("gamm", ["gamma", "beta"])
    ' (did you mean gamma?)'
    """
    matches = difflib.get_close_matches(name, list(known), n=1) if len(name) <= _LIKENED else []
    return f" (did you mean {matches[0]}?)" if matches else ""


def _user_error(model: type[BaseModel], details: Mapping[str, Any]) -> UserError:
    path, one = _path(model, details["loc"])
    field = ".".join(str(part + 1) if isinstance(part, int) else part for part in path)  # entries count from 1
    kind, was, context = details["type"], details["input"], details.get("ctx", {})
    if isinstance(context.get("error"), UserError):
        own = context["error"]
        prefixed = [".".join(filter(None, (field, name))) for name in (own.field, *own.more)]
        return UserError(prefixed[0], own.must, own.was, prefixed[1:])
    if kind == "missing" and isinstance(was, list | tuple):
        return UserError(field.rpartition(".")[0], "a list with more entries", was)
    if kind == "missing":
        return UserError(field, "given", "missing")
    if kind == "extra_forbidden":
        return UserError(field, _known(model, path), "unknown")
    if "actual_length" in context:
        return UserError(field, _list_of(context, one), f"a list of {context['actual_length']}")
    numbers = {name: f"{x:.10g}" if isinstance(x, int | float) else x for name, x in context.items()}
    must = _MUST[kind].format(**numbers) if kind in _MUST else f"accepted: {details['msg']}"
    return UserError(field, must, f'"{one_line(was)}"' if isinstance(was, str) else was)


def _list_of(context: Mapping[str, Any], one: str) -> str:
    """Demand on the length of a list, in the place of which there may be ``one`` entry for both robots."""
    least, most = context.get("min_length"), context.get("max_length")
    if one and least != 1:
        return f"{one} or a list of {least or most}"
    if least == 1:
        return "a list that is not empty"
    if most == 2:  # a pair, of which pydantic does not say that it needs both
        return "a list of 2"
    return f"a list of at least {least}" if least else f"a list of at most {most}"


def _path(model: type[BaseModel], location: Iterable[str | int]) -> tuple[list[str | int], str]:
    """Keys of pydantic's location, and what else than a list it can be, if a tag that says so stood among them."""
    path: list[str | int] = []
    one, fields, leaf = "", model.model_fields, None
    for part in location:
        if leaf is not None and part in _TAGS:
            one = _one(leaf)
            continue
        path.append(part)
        if leaf is not None and isinstance(part, int):
            continue  # of a list, whose entries may be alternatives too
        kind = fields[part].annotation if isinstance(part, str) and part in fields else None
        leaf, fields = None if hasattr(kind, "model_fields") else kind, getattr(kind, "model_fields", {})
    return path, one


def _one(kind: Any) -> str:
    """Words for one entry of a field's list."""
    types = set(_types(kind))
    return "one name" if Literal in types else "true, false" if bool in types else "one number"


def _types(kind: Any) -> Iterator[Any]:
    yield get_origin(kind) or kind
    for inner in get_args(kind):
        yield from _types(inner)


def _known(model: type[BaseModel], path: list[str | int]) -> str:
    """Demand on an unknown key: a field of the section that it stands in, or a section."""
    *sections, key = map(str, path)
    fields = model.model_fields
    for section in sections:
        fields = getattr(fields[section].annotation, "model_fields", {})
    label = getattr(model, "label", "")
    inside = ".".join(filter(None, (getattr(model, "path", ""), *sections)))  # of a section that is validated alone
    place = label if label and not sections else f"a field of [{inside}]" if inside else "a section of the scenario"
    return place + closest(key, fields)
