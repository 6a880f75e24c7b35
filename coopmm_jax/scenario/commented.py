"""A scenario as a file to start from: every value spelt out, with its meaning and unit beside it.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> print(commented(load_scenario("sensed")).split("[loop]")[1].splitlines()[1])
control_period = 0.001  # [s] time between samples, torque held; 0: in continuous time
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal, get_args, get_origin

import tomli_w
from pydantic import BaseModel

from coopmm_jax.kinds.registry import known
from coopmm_jax.scenario.kind_sections import KindSection, choice_of
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.sections.uncertainty import Distribution, UncertaintySection

_FIRST = ("description", "simulation", "plant", "coupling", "initial", "reference", "disturbance")
_HINTS = {  # sections in which names are the user's choice -> what they can be
    "schedule": ("times = [0.0, 5.0] in s, and any gain at each of these times: K_lambda = [1.0, 3.0]",),
    "uncertainty": (
        "distribution: uniform or log_uniform (low, high), normal (mean, std), truncated_normal (all four);",
        "relative = true: a factor on the value above; offset = true: added to it; each = true: one draw per robot",
    ),
    "requirements": ("coopmm metrics lists what can be required",),
}


def commented(scenario: Scenario) -> str:
    """Text of a scenario file that loads as an equal scenario, with a comment on every field."""
    lines = [f"description = {_toml(scenario.description)}"]
    fields = type(scenario).model_fields
    for name in sorted(fields, key=lambda name: (*_FIRST, name).index(name)):
        value = getattr(scenario, name)
        if isinstance(value, tuple):
            for entry in value:
                lines += ["", f"[[{name}]]{_about(type(entry))}", *_fields(name, entry)]
        elif isinstance(value, BaseModel):
            lines += ["", f"[{name}]{_about(fields[name].annotation)}", *(f"# {line}" for line in _HINTS.get(name, ()))]
            lines += _varying(value) if isinstance(value, UncertaintySection) else _fields(name, value)
    return "\n".join(lines) + "\n"


def _fields(path: str, section: BaseModel) -> Iterator[str]:
    """Lines of a section, and of the tables in it below its own fields."""
    inner = []
    for name, value in section:
        info = type(section).model_fields.get(name)
        if isinstance(value, BaseModel):
            inner.append((name, value))
        elif isinstance(section, KindSection) and name == "kind":
            others = ", ".join(other for other in known(section.about().group) if other != value)
            yield f"{name} = {_toml(value)}{_comment(others and f'or {others}')}"
        elif value is not None:
            yield f"{name} = {_toml(value)}{_comment(_meaning(info))}"
        elif info is not None and choice_of(info):
            yield f"# [{path}.{name}]{_comment(_meaning(info))}"
        elif path not in _HINTS:
            yield f"# {name} = ...{_comment(_meaning(info))}"
    for name, value in inner:
        yield from ("", f"[{path}.{name}]{_about(type(value))}", *_fields(f"{path}.{name}", value))


def _varying(section: UncertaintySection) -> Iterator[str]:
    """Line of each number that varies, without what is not said of it."""
    for entry in section.entries():
        given = entry.distribution.model_dump(exclude_none=True, exclude_defaults=True)
        shape = {"distribution": entry.distribution.distribution} | given
        text = ", ".join(f"{name} = {_toml(shape[name])}" for name in Distribution.model_fields if name in shape)
        yield f"{entry.name} = {{ {text} }}"


def _meaning(info: Any) -> str:
    """Meaning of a field with its unit before it and its choices behind it; nothing of a name that is free."""
    if info is None or not info.description:
        return ""
    meaning, bracket, unit = info.description.rpartition(" [")
    text = f"[{unit} {meaning}" if bracket and unit.endswith("]") else info.description
    choices = get_args(info.annotation) if get_origin(info.annotation) is Literal else ()
    return text + (f": {' or '.join(choices)}" if choices else "")


def _about(section: Any) -> str:
    """Comment on a section, without its name."""
    text = " ".join((section.__doc__ or "").split())
    head, colon, rest = text.partition(": ")
    return _comment((rest if colon and head.startswith("[") else text).removesuffix("."))


def _comment(text: str) -> str:
    return f"  # {text}" if text else ""


def _toml(value: Any) -> str:
    """Value as TOML, on one line."""
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{name} = {_toml(entry)}' for name, entry in value.items())} }}"
    return tomli_w.dumps({"value": value}).partition(" = ")[2].rstrip("\n")
