"""Errors of pydantic, in this package's one grammar: the field, what it must be, what it was.

>>> from coopmm_jax.scenario.sections.controller import gains_section
>>> validate(gains_section("robust_adaptive"), {"K_lambda": -2})
Traceback (most recent call last):
coopmm_jax.errors.UserError: K_lambda: must be greater than -1, was -2
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

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
    "too_short": "a list of {min_length}",
    "too_long": "a list of {max_length}",
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
    more = dict.fromkeys(name for name in named if name != first.field)
    raise UserError(first.field, first.must, first.was, list(more))


def closest(name: str, known: Iterable[str]) -> str:
    """Parenthesis with the known name most like ``name``, or nothing.

    >>> closest("gamm", ["gamma", "beta"])
    ' (did you mean gamma?)'
    """
    matches = difflib.get_close_matches(name, list(known), n=1) if len(name) <= _LIKENED else []
    return f" (did you mean {matches[0]}?)" if matches else ""


def _user_error(model: type[BaseModel], details: Mapping[str, Any]) -> UserError:
    path, tagged = _path(model, details["loc"])
    field = ".".join(str(part) for part in path if isinstance(part, str))
    field += "".join(f"[{part}]" for part in path if isinstance(part, int))
    kind, was, context = details["type"], details["input"], details.get("ctx", {})
    if isinstance(context.get("error"), UserError):
        own = context["error"]
        prefixed = [".".join(filter(None, (field, name))) for name in (own.field, *own.more)]
        return UserError(prefixed[0], own.must, own.was, prefixed[1:])
    if kind == "missing":
        return UserError(field, "given", "missing")
    if kind == "extra_forbidden":
        return UserError(field, _known(model, path), "unknown")
    numbers = {name: f"{x:.10g}" if isinstance(x, int | float) else x for name, x in context.items()}
    must = _MUST[kind].format(**numbers) if kind in _MUST else f"accepted: {details['msg']}"
    if "actual_length" in context:
        return UserError(field, f"one number or {must}" if tagged else must, f"a list of {context['actual_length']}")
    return UserError(field, must, f'"{one_line(was)}"' if isinstance(was, str) else was)


def _path(model: type[BaseModel], location: Iterable[str | int]) -> tuple[list[str | int], bool]:
    """Keys of pydantic's location, and True if a tag that says "one number or a list" stood among them."""
    path: list[str | int] = []
    tagged, fields, leaf = False, model.model_fields, False
    for part in location:
        if leaf and part in _TAGS:
            tagged = True
            continue
        path.append(part)
        if leaf and isinstance(part, int):
            continue  # of a list, whose entries may be alternatives too
        kind = fields[part].annotation if isinstance(part, str) and part in fields else None
        leaf, fields = kind is not None and not hasattr(kind, "model_fields"), getattr(kind, "model_fields", {})
    return path, tagged


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
