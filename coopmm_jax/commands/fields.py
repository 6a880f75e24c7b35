"""Help on the fields of a scenario that an override can name."""

from __future__ import annotations

from typing import Any, Literal, get_args, get_origin

from coopmm_jax.kinds import registry
from coopmm_jax.scenario.kind_sections import Chosen, choice_of, section
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.sections.controller import GainsSection, all_controllers, gains_section

OVERRIDES = "[--section.field VALUE ...]"


def fields_help() -> str:
    """Text that lists every field with its default, meaning and unit."""
    lines = ["overrides, after SCENARIO (values are TOML; several values make a list, one number fills a list):"]
    told: dict[str, str] = {}
    for name, info in Scenario.model_fields.items():
        if info.annotation is GainsSection:
            lines += ["", GainsSection.__doc__ or "[gains]:", *_of_controllers(told)]
        elif hasattr(info.annotation, "model_fields"):
            lines += ["", info.annotation.__doc__ or f"[{name}]:"]  # Python may leave docstrings out
            lines += _of_section(name, type(info.default), told)  # of the default controller, if there are several
        elif choice := choice_of(info):
            lines += ["", choice.base.__doc__ or f"[{name}]:", *_of_kinds(name, info, choice, told)]
    return "\n".join(lines)


def _of_section(path: str, section: Any, told: dict[str, str], *without: str) -> list[str]:
    lines = []
    for name, info in section.model_fields.items():
        place = f"{path}.{name}"
        if choice := choice_of(info):
            lines += _of_kinds(place, info, choice, told)
        elif name not in without:
            lines.append(_line(place, info))
    return lines


def _of_controllers(told: dict[str, str]) -> list[str]:
    """Lines on the gains of each controller."""
    lines = []
    for name in all_controllers():
        section = gains_section(name)
        lines += [f"  {section.__doc__}", *_of_section("gains", section, told)]
    return lines


def _of_kinds(path: str, info: Any, choice: Chosen, told: dict[str, str]) -> list[str]:
    """Lines on the fields that all kinds of a group have, then on those of each kind.

    ``told`` says where those of a group stand already, by the group's name.
    """
    kinds = registry.known(choice.group)
    meaning = info.description or registry.GROUPS[choice.group].meaning
    default = f" (default {choice.default or 'none'})"
    first = f"  {_option(f'{path}.kind'):28} {meaning}: {' or '.join(kinds)}{default}"
    if choice.group in told:
        return [f"{first}, with the fields of {told[choice.group]}"]
    told[choice.group] = f"--{path}"
    lines = [first, *_of_section(path, choice.base, told, "kind")]
    for name in kinds:
        described = section(choice.group, name, choice.base)
        text = " ".join((described.__doc__ or "").split())
        lines += [f"  {name}: {text}", *_of_section(path, described, told, *choice.base.model_fields)]
    return lines


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
