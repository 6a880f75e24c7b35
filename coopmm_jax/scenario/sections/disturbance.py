"""The section on disturbances: one table [disturbance], or any number of entries [[disturbance]].

An entry is known by its name, or by its number from 1; the fields of the first one need neither.

>>> DisturbanceSection.model_fields["scale"].default
1.0
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, SerializeAsAny

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.disturbances import Disturbance
from coopmm_jax.scenario.fields import Finite, Pair, quantity
from coopmm_jax.scenario.kind_sections import Chosen, KindSection, section
from coopmm_jax.scenario.overrides import entry_of, merged

DEFAULT = "sine"
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_AXES = ("x", "y", "z")


class DisturbanceSection(KindSection):
    """[disturbance] or [[disturbance]]: amplitude * scale * value over time, against actuators or on the object."""

    name: str | None = quantity(None, "to change, or vary, an entry of [[disturbance]] by")
    wheel: Pair[Finite] = quantity(0.0, "torque amplitude against each wheel [N m]")
    joint: Pair[Finite] = quantity(0.0, "torque amplitude against each arm joint [N m]")
    right_wheel: Pair[Finite] | None = quantity(None, "in the place of wheel for this one [N m]")
    left_wheel: Pair[Finite] | None = quantity(None, "in the place of wheel for this one [N m]")
    joint_1: Pair[Finite] | None = quantity(None, "in the place of joint for this one [N m]")
    joint_2: Pair[Finite] | None = quantity(None, "in the place of joint for this one [N m]")
    joint_3: Pair[Finite] | None = quantity(None, "in the place of joint for this one [N m]")
    force_x: Finite = quantity(0.0, "amplitude of a force on the object, along the world's x [N]")
    force_y: Finite = quantity(0.0, "amplitude of a force on the object, along the world's y [N]")
    force_z: Finite = quantity(0.0, "amplitude of a force on the object, upwards [N]")
    scale: Finite = quantity(1.0, "factor on all amplitudes [-]")

    def disturbance(self) -> Disturbance:
        """The entry as a rollout takes it: None in the place of amplitudes that are zero."""
        force = tuple(getattr(self, f"force_{axis}") for axis in _AXES)
        torques = {name: getattr(self, name) for name in _TORQUES}
        if all(value is None or _is_zero(value) for value in torques.values()):
            torques = dict.fromkeys(_TORQUES)
        return Disturbance(wave=self.numbers(), scale=self.scale, force=None if _is_zero(force) else force, **torques)


_TORQUES = ("wheel", "joint", "right_wheel", "left_wheel", "joint_1", "joint_2", "joint_3")
_ONE = Chosen("disturbance", DEFAULT, DisturbanceSection)


def _is_zero(value: Any) -> bool:
    """True if a number, or all of some, are zero and not arrays, which vary."""
    return all(map(_is_zero, value)) if isinstance(value, tuple) else isinstance(value, float) and value == 0.0


def _entries(value: Any) -> Any:
    """Sections of a table, of a list of tables, or of sections.

    Raises:
        UserError: something else, or an entry that cannot be used, under its name or number.
    """
    if isinstance(value, Mapping):
        return (_checked(_of_table(value), ""),)
    if not isinstance(value, list | tuple) or not all(
        isinstance(entry, Mapping | DisturbanceSection) for entry in value
    ):
        raise UserError("", "a table [disturbance], or a list of tables [[disturbance]]", value)
    names = [entry.get("name") if isinstance(entry, Mapping) else entry.name for entry in value]
    several = len(names) > 1
    return tuple(
        _checked(entry, f"{name if _is_name(name) else i}." if several else "")
        for i, (name, entry) in enumerate(zip(names, value, strict=True), 1)
    )


def _of_table(table: Mapping[str, Any]) -> dict[str, Any]:
    """A table's own fields; a table without ``kind`` is the paper's sine, with the paper's amplitudes."""
    paper = Disturbance()
    start = {} if "kind" in table else {"wheel": paper.wheel, "joint": paper.joint}
    inner = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    own = start | {key: value for key, value in table.items() if key not in inner}
    for key, value in inner.items():
        if entry_of([own.get("name")], str(key)) is None:
            raise UserError(key, "a field of [disturbance], or the name or number of an entry", "unknown")
        own = merged(own, value)
    return own


def _checked(entry: Any, place: str) -> Any:
    try:
        return _ONE(entry)
    except UserError as error:
        raise UserError(place + error.field, error.must, error.was, [place + name for name in error.more]) from None


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and _NAME.fullmatch(name) is not None


def _names_apart(entries: tuple[DisturbanceSection, ...]) -> tuple[DisturbanceSection, ...]:
    seen: set[str] = set()
    for i, entry in enumerate(entries, 1):
        place = "name" if len(entries) == 1 else f"{i}.name"
        if entry.name is None:
            continue
        if not _is_name(entry.name):
            raise UserError(place, "letters, digits and _, not a digit first", entry.name)
        if any(entry.name in type(other).model_fields for other in entries):
            raise UserError(place, "unlike the name of a field", entry.name)
        if entry.name in seen:
            raise UserError(place, "given to one entry", entry.name)
        seen.add(entry.name)
    return entries


class Listed(Chosen):
    """Function that turns a table, or a list of tables, into sections of the kinds that they name."""

    def __call__(self, value: Any) -> Any:
        """Sections (n,) of the entries."""
        return _entries(value)


Disturbances = Annotated[
    tuple[SerializeAsAny[DisturbanceSection], ...],
    BeforeValidator(Listed("disturbance", DEFAULT, DisturbanceSection)),
    AfterValidator(_names_apart),
]


def paper_disturbance() -> tuple[DisturbanceSection, ...]:
    """The disturbance of a scenario that says nothing about it: section IV's sine."""
    return (section("disturbance", DEFAULT, DisturbanceSection)(wheel=Disturbance().wheel, joint=Disturbance().joint),)
