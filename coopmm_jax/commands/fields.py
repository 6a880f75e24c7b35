"""Help on the fields of a scenario that an override can name."""

from __future__ import annotations

from typing import Any, Literal, get_args, get_origin

from coopmm_jax.scenario.scenario import Scenario

OVERRIDES = "[--section.field VALUE ...]"


def fields_help() -> str:
    """Text that lists every field with its default, meaning and unit."""
    lines = ["overrides, after SCENARIO (values are TOML; several values make a list, one number fills a list):"]
    for name, section in _sections().items():
        lines += ["", section.__doc__ or f"[{name}]:"]  # Python may leave docstrings out
        for field, info in section.model_fields.items():
            choices = get_args(info.annotation) if get_origin(info.annotation) is Literal else ()
            meaning = info.description + (": " if choices else "") + " or ".join(choices)
            option = f"--{name}.{field.replace('_', '-')}"
            lines.append(f"  {option:28} {meaning} (default {_default(info.default)})")
    return "\n".join(lines)


def takes_names(key: str) -> bool:
    """True if the field of a dotted key takes a list of names.

    >>> takes_names("tuning.gains"), takes_names("law.u26")
    (True, False)
    """
    section, _, field = key.partition(".")
    fields = getattr(_sections().get(section), "model_fields", {})
    return field in fields and fields[field].annotation == tuple[str, ...]


def _sections() -> dict[str, Any]:
    fields = {name: field.annotation for name, field in Scenario.model_fields.items()}
    return {name: section for name, section in fields.items() if hasattr(section, "model_fields")}


def _default(value: Any) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_default, value))
    if value is None:
        return "the plant's"
    return f"{value:g}" if isinstance(value, float) else str(value)
