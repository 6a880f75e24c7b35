"""pydantic's errors, in this package's one grammar: which field, what it must be, what it was.

>>> from coopmm_jax.scenario.sections.schema import Gains
>>> validate(Gains, {"K_lambda": -2})
Traceback (most recent call last):
coopmm_jax.errors.UserError: K_lambda: must be greater than -1, was -2
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from coopmm_jax.errors import UserError

Model = TypeVar("Model", bound=BaseModel)

_MUST = {  # pydantic's type of error -> what the value must be
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a string",
    "finite_number": "finite",
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "literal_error": "{expected}",
    "too_short": "one number or a list of {min_length}",
    "too_long": "one number or a list of {max_length}",
    "model_type": "a table of fields",
}


def validate(model: type[Model], data: Mapping[str, Any]) -> Model:
    """An instance of ``model`` from ``data``.

    Raises:
        UserError: the first thing wrong with ``data``, with the number of further ones.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise _first_error(model, error) from None


def closest(name: str, known: Iterable[str]) -> str:
    """A parenthesis that names the known name most like ``name``, or nothing.

    >>> closest("gamm", ["gamma", "beta"])
    ' (did you mean gamma?)'
    """
    matches = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean {matches[0]}?)" if matches else ""


def _first_error(model: type[BaseModel], error: ValidationError) -> UserError:
    first, *others = error.errors()
    path = [part for part in first["loc"] if part not in ("one", "list")]  # the tags of scenario_schema's alternatives
    field = ".".join(str(part) for part in path if isinstance(part, str))
    field += "".join(f"[{part}]" for part in path if isinstance(part, int))
    kind, was, context = first["type"], first["input"], first.get("ctx", {})
    if isinstance(context.get("error"), UserError):
        own = context["error"]
        return UserError(".".join(name for name in (field, own.field) if name), own.must, own.was, len(others))
    if kind == "extra_forbidden":
        return UserError(field, _known(model, path), "unknown", len(others))
    must = _MUST[kind].format(**context) if kind in _MUST else f"accepted: {first['msg']}"
    if "actual_length" in context:
        shown = f"a list of {context['actual_length']}"
    else:
        shown = f'"{was}"' if isinstance(was, str) else was
    return UserError(field, must, shown, len(others))


def _known(model: type[BaseModel], path: list[str | int]) -> str:
    """What an unknown key must be: a field of the section, or a section, that it stands in."""
    *sections, key = path
    for section in sections:
        model = model.model_fields[section].annotation
    place = f"a field of [{'.'.join(sections)}]" if sections else "a section of the scenario"
    return place + closest(key, model.model_fields)
