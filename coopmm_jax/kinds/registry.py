"""Kinds by group and name: what scenario files can choose with ``kind = "..."``, built in or from a plugin.

A kind is a NamedTuple class, as ``kinds/protocol.py`` describes it. An instance is a pytree that stands in
``Parameters``; its class is part of the pytree's structure, so that it selects the code while a rollout is traced.
Nothing here imports JAX.

>>> from coopmm_jax.kinds.protocol import Method
>>> group = declare(Group("bump", "height over distance", (Method("height", ("x",), "height at x", 0.0, ((0.5,),)),)))
>>> @register("bump", "round")
... class Round(NamedTuple):
...     def height(self, x):
...         return 1 - x * x
>>> find("bump", "round").made().height(0.5)
0.75
>>> del GROUPS["bump"]
"""

from __future__ import annotations

import contextlib
import difflib
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.protocol import Group, Kind, check_protocol, fields_of

Registered = TypeVar("Registered")

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


GROUPS: dict[str, Group] = {}
_KINDS: dict[str, dict[str, Kind]] = {}
_loading: list[str] = []  # the plugin that is being loaded


def declare(group: Group) -> Group:
    """Add a group of kinds."""
    GROUPS[group.name] = group
    _KINDS[group.name] = {}
    return group


def register(group: str, name: str) -> Callable[[Registered], Registered]:
    """Register a NamedTuple class as a kind, as a decorator above it: ``@register("path", "ellipse")``.

    Args:
        group: of ``GROUPS``: what the kind is one of.
        name: what a scenario file calls it.

    Raises:
        UserError: no such group, a name that is taken, a field without meaning, or a method that is missing.
    """

    def decorated(made: Registered) -> Registered:
        plugin = _loading[-1] if _loading else None
        place = "kind" if plugin is None else f"plugin {plugin}"
        if group not in GROUPS:
            must = f"registered as one of {', '.join(sorted(GROUPS))}{_closest(group, GROUPS)}"
            raise UserError(place, must, group)
        label = f'{place}: {group} "{name}"'
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise UserError(place, f"registered as {group} under a name of letters, digits and _", repr(name))
        if name in _KINDS[group]:
            raise UserError(label, "registered once", "registered twice")
        if not (isinstance(made, type) and issubclass(made, tuple) and hasattr(made, "_fields")):
            raise UserError(label, "a class that inherits from typing.NamedTuple", made)
        check_protocol(GROUPS[group], made, label)
        kind = Kind(group, name, made, fields_of(made, label), plugin)
        _KINDS[group][name] = kind
        accept = GROUPS[group].accept
        if accept is not None:
            accept(kind)
        return made  # pyright: ignore[reportReturnType] - what has been narrowed is still the class that was given

    return decorated


def register_constants(group: str, name: str, about: str, **constants: Any) -> None:
    """Register a kind without numbers, of which there are many alike.

    Args:
        group: of ``GROUPS``.
        name: of the kind.
        about: its docstring.
        constants: attributes and methods by name.
    """
    made: Any = NamedTuple("Constants", [])
    made.__doc__, made.__module__ = about, __name__
    for attribute, value in constants.items():
        setattr(made, attribute, value)
    register(group, name)(made)


def known(group: str) -> dict[str, Kind]:
    """Kinds of a group by name."""
    return _KINDS[group]


def find(group: str, name: Any, field: str = "kind") -> Kind:
    """One kind of a group.

    Args:
        group: of ``GROUPS``.
        name: of the kind, as the user gives it.
        field: where it is given, for the error.

    Raises:
        UserError: no kind of this name.
    """
    kinds = _KINDS[group]
    if not isinstance(name, str) or name not in kinds:
        close = _closest(name, kinds) if isinstance(name, str) else ""
        raise UserError(field, f"one of {', '.join(kinds)}{close}, or of a --plugin", name)
    return kinds[name]


def kind_of(made: type) -> Kind | None:
    """Kind that a class is registered as, if it is."""
    for kinds in _KINDS.values():
        for kind in kinds.values():
            if kind.made is made:
                return kind
    return None


@contextlib.contextmanager
def registering(plugin: str) -> Iterator[None]:
    """Let every kind registered inside belong to a plugin; none stays if the block ends with an exception."""
    before = {group: dict(kinds) for group, kinds in _KINDS.items()}
    _loading.append(plugin)
    try:
        yield
    except BaseException:
        _restore(before)
        raise
    finally:
        _loading.pop()


def _restore(before: Mapping[str, Mapping[str, Kind]]) -> None:
    for group, kinds in _KINDS.items():
        for name in [name for name in kinds if name not in before.get(group, {})]:
            del kinds[name]


def _closest(name: str, names: Any) -> str:
    matches = difflib.get_close_matches(name, list(names), n=1) if len(name) <= 60 else []
    return f" (did you mean {matches[0]}?)" if matches else ""
