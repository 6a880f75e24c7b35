"""Help on the fields of a scenario that an override can name."""

from __future__ import annotations

from typing import Any, Literal, get_args, get_origin

from pydantic import BeforeValidator

from coopmm_jax.kinds import registry
from coopmm_jax.scenario.kind_sections import Chosen, section
from coopmm_jax.scenario.scenario import Scenario

OVERRIDES = "[--section.field VALUE ...]"


def fields_help() -> str:
    """Text that lists every field with its default, meaning and unit."""
    lines = ["overrides, after SCENARIO (values are TOML; several values make a list, one number fills a list):"]
    for name, info in Scenario.model_fields.items():
        if hasattr(info.annotation, "model_fields"):
            lines += ["", info.annotation.__doc__ or f"[{name}]:"]  # Python may leave docstrings out
            lines += _of_section(name, info.annotation)
        elif choice := _choice(info):
            lines += ["", choice.base.__doc__ or f"[{name}]:", *_of_kinds(name, info)]
    return "\n".join(lines)


def _of_section(path: str, section: Any, *without: str) -> list[str]:
    lines = []
    for name, info in section.model_fields.items():
        place = f"{path}.{name}"
        if _choice(info):
            lines += _of_kinds(place, info)
        elif name not in without:
            lines.append(_line(place, info))
    return lines


def _of_kinds(path: str, info: Any) -> list[str]:
    """Lines on the fields that all kinds of a group have, then on those of each kind."""
    choice = _choice(info)
    assert choice is not None
    kinds = registry.known(choice.group)
    default = f" (default {choice.default})" if choice.default else ""
    lines = [f"  {_option(f'{path}.kind'):28} {registry.GROUPS[choice.group].meaning}: {' or '.join(kinds)}{default}"]
    lines += _of_section(path, choice.base, "kind")
    for name in kinds:
        described = section(choice.group, name, choice.base)
        meaning = " ".join((described.__doc__ or "").split())
        lines += [f"  {name}: {meaning}", *_of_section(path, described, *choice.base.model_fields)]
    return lines


def _choice(info: Any) -> Chosen | None:
    """Choice among kinds that a field is, if it is one."""
    validators = (note.func for note in info.metadata if isinstance(note, BeforeValidator))
    return next((function for function in validators if isinstance(function, Chosen)), None)


def _option(place: str) -> str:
    return f"--{place.replace('_', '-')}"


def _line(place: str, info: Any) -> str:
    choices = get_args(info.annotation) if get_origin(info.annotation) is Literal else ()
    meaning = (info.description or "") + (": " if choices else "") + " or ".join(choices)
    default = "" if info.is_required() else f" (default {_default(info.default, place)})"
    return f"  {_option(place):28} {meaning}{default}"


def takes_names(key: str) -> bool:
    """True if the field of a dotted key takes a list of names.

    >>> takes_names("tuning.gains"), takes_names("law.u26")
    (True, False)
    """
    section, _, field = key.partition(".")
    known = Scenario.model_fields.get(section)
    fields = getattr(known.annotation if known else None, "model_fields", {})
    return field in fields and fields[field].annotation == tuple[str, ...]


def _default(value: Any, place: str) -> str:
    if isinstance(value, tuple):
        return " ".join(_default(entry, place) for entry in value)
    if value is None:
        return "the plant's" if place.startswith("nominal.") else "none"
    return f"{value:g}" if isinstance(value, float) else str(value)
